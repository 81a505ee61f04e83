"""Displacements of toy skirts, whose truth is known, and how they are kept."""

import shutil

import numpy as np
import pytest

from drapeline.bodies.kinematics import axis_angle_to_matrix
from drapeline.bodies.skinning import skin_points
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.mesh import edges
from drapeline.geometry.point_cache import write_point_cache
from drapeline.learning_data.pose_displacements import (
    POSE_JOINTS,
    POSE_NUMBERS,
    DisplacementData,
    collect_displacements,
    encode_poses,
    simulated_files,
)
from drapeline.seeding import rng_for
from toys.displacement import (
    FRAMES,
    collect_skirts,
    known_displacement,
    write_moving_skirt,
    write_moving_skirts,
)
from toys.smplicit import toy_bodies


@pytest.fixture(scope="module")
def samples(tmp_path_factory, toy_body):
    return write_moving_skirts(tmp_path_factory.mktemp("samples"), toy_body)


@pytest.fixture(scope="module")
def data(tmp_path_factory, samples, toy_body):
    return collect_skirts(tmp_path_factory.mktemp("collected") / "data", samples, toy_body)


def turned(poses, axis, angle):
    """The same poses of bodies that are turned as a whole."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(angle * np.asarray(axis, dtype=float))
    root = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    return np.concatenate([root, poses[:, 3:]], axis=1)


def test_the_pose_of_rest_is_zero():
    assert encode_poses(REST_POSE[None]) == pytest.approx(np.zeros((1, POSE_NUMBERS)), abs=1e-7)


def test_poses_are_told_by_joints_and_gravity():
    poses = REST_POSE + 0.3 * rng_for(0, "poses").normal(size=(4, 72))
    found = encode_poses(poses)
    facing_elsewhere = encode_poses(turned(poses, [0, 0, 1], 1.0))
    assert facing_elsewhere == pytest.approx(found, abs=1e-6)
    leaning = encode_poses(turned(poses, [1, 0, 0], 0.5))
    assert leaning[:, :-3] == pytest.approx(found[:, :-3], abs=1e-6)
    assert np.abs(leaning - found)[:, -3:].max() > 0.1
    knee = POSE_JOINTS.index(JOINT_NAMES.index("left_knee"))
    joint = JOINT_NAMES.index("left_knee")
    expected = axis_angle_to_matrix(poses[:, 3 * joint : 3 * joint + 3]) - np.eye(3)
    assert found[:, 9 * knee : 9 * knee + 9] == pytest.approx(expected.reshape(4, 9), abs=1e-6)


def test_ends_of_limbs_do_not_count():
    names = {JOINT_NAMES[joint] for joint in POSE_JOINTS}
    assert {"left_knee", "right_hip", "spine2", "left_elbow"} <= names
    assert not names & {"pelvis", "head", "left_hand", "right_foot", "left_wrist", "neck"}


def test_displacements_are_those_that_the_cloth_was_made_with(data, samples):
    for row in range(len(data)):
        tiny = samples[data.garment_index[row]]
        expected = known_displacement(tiny.poses)[row % FRAMES]
        found = data.displacements(row)
        assert found == pytest.approx(np.broadcast_to(expected, found.shape), abs=1e-4)


def test_a_batch_gives_the_simulated_cloth_back(data, samples):
    rows = np.array([1, FRAMES + 2])
    batch = data.batch(rows, 30, seed=0)
    moved = [
        skin_points(straight + away, motions[None], weights)[0]
        for straight, away, motions, weights in zip(
            *(batch[key] for key in ("straight", "displacement", "motions", "weights")), strict=True
        )
    ]
    for index, tiny in enumerate(samples[:2]):
        rest, frame = tiny.meshes["Skirt"], rows[index] % FRAMES
        ids = [int(np.abs(rest.vertices - p).sum(1).argmin()) for p in batch["points"][index]]
        assert moved[index] == pytest.approx(tiny.vertices["Skirt"][frame][ids], abs=1e-5)
        known = {tuple(pair) for pair in edges(rest.triangles).tolist()}
        assert {*zip(ids[:30], ids[30:], strict=True)} <= known
    assert batch["names"] == ["00001/Skirt", "00002/Skirt"]
    assert batch["garment_index"].tolist() == [0, 1]


def test_rows_have_their_own_edges_and_keep_them(data):
    one, again, other = (data.batch(np.array([0, 1]), 8, seed)["points"] for seed in (0, 0, 1))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    assert not np.array_equal(one[0], one[1])


def test_test_samples_are_left_out(data):
    assert data.sample.tolist() == ["00001", "00002", "00003"]
    assert data.rows("train").tolist() == [*range(2 * FRAMES)]
    assert data.rows("val").tolist() == [*range(2 * FRAMES, 3 * FRAMES)]


def test_without_validation_garments_ends_of_sequences_are_held_back(tmp_path, samples, toy_body):
    data = collect_skirts(tmp_path / "data", samples[:2], toy_body)
    assert data.rows("val").tolist() == [FRAMES - 1, 2 * FRAMES - 1]
    assert sorted([*data.rows("train"), *data.rows("val")]) == [*range(2 * FRAMES)]


def test_every_so_many_th_frame_is_taken(tmp_path, samples, data, toy_body):
    some = collect_skirts(tmp_path / "data", samples, toy_body, frame_step=4)
    assert len(some) == 6
    assert np.array_equal(some.displacements(3), data.displacements(FRAMES + 4))
    assert np.array_equal(some.pose[3], data.pose[FRAMES + 4])


def test_rejected_samples_are_left_out(tmp_path, toy_body):
    from toys.tiny_sample import write_tiny_sample

    rejected = write_tiny_sample(tmp_path, toy_body, "00009", status="rejected")
    kept = write_moving_skirt(tmp_path, toy_body, "00001", "train")
    found = simulated_files([rejected.folder, kept.folder], ["Skirt"], ["train"], frame_step=2)
    assert [(one.sample, one.name, one.frames.tolist()) for one in found] == [
        ("00001", "Skirt", [0, 2, 4])
    ]


def test_no_training_garment_is_refused(tmp_path, samples, toy_body):
    bodies = toy_bodies(toy_body)
    for folders, garments in (
        ([samples[2].folder], ["Skirt"]),
        ([samples[0].folder], ["Dress", "Jumpsuit"]),
    ):
        with pytest.raises(InputError, match=f"wears {' or '.join(garments)}, expected one"):
            collect_displacements(tmp_path / "out", folders, garments, bodies, frame_step=1)
    assert not (tmp_path / "out").exists()


def test_cloth_that_is_not_finite_is_named(tmp_path, toy_body):
    tiny = write_moving_skirt(tmp_path, toy_body, "00001", "train")
    cloth = tiny.vertices["Skirt"].astype(np.float32)
    cloth[2, 5] = np.nan
    write_point_cache(tiny.folder / "extras" / "Skirt.f32", cloth)
    with pytest.raises(InputError, match="00001: Skirt holds NaN"):
        collect_skirts(tmp_path / "data", [tiny], toy_body)


def test_files_of_other_lengths_are_refused(tmp_path, data):
    shutil.copytree(data.folder, tmp_path / "data")
    short = np.load(data.folder / "displacement.npy")[:-1]
    np.save(tmp_path / "data" / "displacement.npy", short)
    with pytest.raises(InputError, match=rf"displacement.npy: has {len(short)} rows, expected"):
        DisplacementData(tmp_path / "data")
