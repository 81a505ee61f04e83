"""The rules that make bodies move."""

import hashlib
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from drapeline.bodies.kinematics import mirror_poses
from drapeline.bodies.model import save_body
from drapeline.bodies.sequence import load_body_sequence
from drapeline.bodies.smpl_files import read_body_arrays
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import REST_POSE
from drapeline.motions.motion import Motion, load_motion, save_motion


def swing(frames=24):
    """Both arms down and swinging, the root walking along -Y."""
    poses = np.repeat(REST_POSE[None], frames, 0)
    phase = np.linspace(0, 2 * np.pi, frames)
    poses[:, 3 * 16 + 2] = -1.1
    poses[:, 3 * 17 + 2] = 1.1
    poses[:, 3 * 1] = 0.3 * np.sin(phase)
    trans = np.stack([0 * phase, -phase / 6, 0.95 + 0 * phase], 1)
    return Motion(poses, trans, 30.0, "swing", "nobody", "made", "swing")


@pytest.fixture
def motion_file(tmp_path):
    path = tmp_path / "swing.npz"
    save_motion(path, swing())
    return path


def test_convert_body_keeps_every_array(run_rule, tmp_path, toy_body):
    save_body(tmp_path / "female.npz", toy_body)
    output = tmp_path / "smpl/SMPL_FEMALE.pkl"
    run_rule("convert_body", input=[tmp_path / "female.npz"], output=[output], params={})
    before, after = (read_body_arrays(path) for path in (tmp_path / "female.npz", output))
    for key, array in before.items():
        np.testing.assert_array_equal(after[key], array)


def test_import_motion_reads_a_clip_and_labels_it(run_rule, motion_file, tmp_path):
    output = tmp_path / "out.npz"
    run_rule(
        "import_motion",
        input={"motion": motion_file},
        output=[output],
        params={
            "motion": {"frames": None, "action": "dance", "subject": "", "sequence": "mine"},
            "sums": {"motion": hashlib.sha256(motion_file.read_bytes()).hexdigest()},
        },
    )
    motion = load_motion(output)
    assert (motion.action, motion.subject, motion.sequence) == ("dance", "nobody", "mine")
    assert len(motion) == 24


def test_import_motion_refuses_nan_in_one_sentence_and_writes_nothing(
    run_rule, motion_file, tmp_path
):
    with np.load(motion_file) as archive:
        arrays = dict(archive)
    arrays["poses"][7, 3 * 18] = np.nan
    np.savez(tmp_path / "nan.npz", **arrays)
    output = tmp_path / "out.npz"
    with pytest.raises(SystemExit, match=r"drapeline: .*nan.npz.*frame 7.*left_elbow"):
        run_rule(
            "import_motion",
            input={"motion": tmp_path / "nan.npz"},
            output=[output],
            params={
                "motion": {"frames": None, "action": "", "subject": "", "sequence": ""},
                "sums": {},
            },
        )
    assert not output.exists()


def test_import_motion_refuses_another_recording_than_the_table_names(
    run_rule, motion_file, tmp_path
):
    output = tmp_path / "out.npz"
    with pytest.raises(SystemExit, match=r"has the SHA-256 sum [0-9a-f]{64}, expected 0{64}"):
        run_rule(
            "import_motion",
            input={"motion": motion_file},
            output=[output],
            params={
                "motion": {"frames": None, "action": "", "subject": "", "sequence": ""},
                "sums": {"motion": "0" * 64},
            },
        )
    assert not output.exists()


def test_plot_skeleton_draws_the_joints_of_a_clip(run_rule, tmp_path):
    clip = Path(__file__).parents[2] / "examples/data/jump.bvh"
    output = tmp_path / "jump.svg"
    run_rule("plot_skeleton", input={"motion": clip}, output=[output])
    assert "jump.bvh: 22 joints of 24, none for left_hand" in output.read_text()


def animate(run_rule, toy_body, motion_file, tmp_path, seed=3, **changes):
    body = tmp_path / "body.npz"
    save_body(body, toy_body)
    plan = SamplePlan("00001", "male", "Tshirt+Trousers", "", "swing", 1, 6, 18)
    run_rule(
        "animate_bodies",
        input={"female": body, "male": body, "motions": [motion_file]},
        output=[tmp_path / "bodies"],
        params={
            "seed": seed,
            "plans": [asdict(replace(plan, **changes))],
            "settings": {
                "shape_range": 1.0,
                "bmi_range": None,
                "shape_draws": 2,
                "segment_gap_m": 0.004,
                "fit_motion": False,
            },
        },
    )
    return load_body_sequence(tmp_path / "bodies" / "00001.npz")


def test_animate_bodies_cuts_the_clip_and_draws_a_shape(run_rule, toy_body, motion_file, tmp_path):
    record = animate(run_rule, toy_body, motion_file, tmp_path)
    np.testing.assert_allclose(record.poses, swing().poses[6:18])
    assert record.gender == "male"
    assert record.labels.sequence == "swing_s1"
    assert record.labels.start_frame == 6
    assert np.abs(record.shape).max() <= 1
    assert np.ptp(record.shape) > 0.3


def test_animate_bodies_makes_a_piece_slower_and_mirrors_it(
    run_rule, toy_body, motion_file, tmp_path
):
    plain = animate(run_rule, toy_body, motion_file, tmp_path)
    record = animate(run_rule, toy_body, motion_file, tmp_path, speed=0.5, mirrored=True)
    assert len(record.poses) == 23
    np.testing.assert_allclose(record.poses[::2], mirror_poses(plain.poses), atol=1e-9)
    assert (record.labels.speed, record.labels.mirrored) == (0.5, True)
    np.testing.assert_array_equal(record.shape, plain.shape)


def test_animate_bodies_gives_each_seed_its_own_shape(run_rule, toy_body, motion_file, tmp_path):
    first = animate(run_rule, toy_body, motion_file, tmp_path)
    again = animate(run_rule, toy_body, motion_file, tmp_path)
    other = animate(run_rule, toy_body, motion_file, tmp_path, seed=4)
    np.testing.assert_array_equal(first.shape, again.shape)
    np.testing.assert_array_equal(first.trans, again.trans)
    assert np.abs(first.shape - other.shape).max() > 0.1
