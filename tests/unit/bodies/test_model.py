"""Posing by linear blend skinning."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import smplx
import torch
from scipy.spatial.transform import Rotation

from drapeline.bodies import model
from drapeline.bodies.model import (
    keep_body,
    load_body,
    load_kept_body,
    posed_vertices,
    save_body,
    shape_body,
)
from drapeline.bodies.smpl_files import convert_to_pickle
from drapeline.errors import InputError
from drapeline.frames import PARENTS, REST_POSE


def slow_posed(body, shape, pose, trans):
    """One frame by the textbook: a chain of 4x4 matrices, vertex by vertex."""
    rest = body.v_template.astype(float) + body.shapedirs.astype(float) @ shape
    joints = body.J_regressor.astype(float) @ rest
    turns = Rotation.from_rotvec(pose.reshape(24, 3)).as_matrix()
    rest = rest + body.posedirs.astype(float) @ (turns[1:] - np.eye(3)).ravel()
    world = []
    for joint, parent in enumerate(PARENTS):
        local = np.eye(4)
        local[:3, :3] = turns[joint]
        local[:3, 3] = joints[joint] - (joints[parent] if joint else 0)
        world.append(world[parent] @ local if joint else local)
    out = []
    for vertex, weights in zip(rest, body.weights.astype(float), strict=True):
        place = np.zeros(3)
        for joint in np.flatnonzero(weights):
            frame = world[joint]
            place += weights[joint] * (frame[:3, :3] @ (vertex - joints[joint]) + frame[:3, 3])
        out.append(place - joints[0] + trans)
    return np.array(out)


@pytest.fixture(scope="module")
def poses():
    return np.random.default_rng(0).normal(0, 0.6, (5, 72))


@pytest.fixture(scope="module")
def blended_body(toy_body):
    """The toy with pose blend shapes, so that they are tested too."""
    noise = np.random.default_rng(1).normal(0, 0.002, toy_body.posedirs.shape)
    return replace(toy_body, posedirs=noise.astype(np.float32))


def test_posing_equals_its_slow_twin(blended_body, poses):
    shape, trans = np.linspace(-2, 2, 10), np.arange(15.0).reshape(5, 3)
    fast, _ = posed_vertices(blended_body, shape, poses, trans, chunk=2)
    slow = [slow_posed(blended_body, shape, p, t) for p, t in zip(poses, trans, strict=True)]
    np.testing.assert_allclose(fast, slow, atol=2e-5)


def test_many_frames_are_posed_as_one_by_one(blended_body):
    poses = np.random.default_rng(2).normal(0, 0.6, (150, 72))
    together, _ = posed_vertices(blended_body, np.zeros(10), poses)
    alone = [posed_vertices(blended_body, np.zeros(10), pose[None])[0][0] for pose in poses]
    np.testing.assert_allclose(together, alone, atol=1e-5)


def test_a_body_without_pose_blend_shapes_is_told_apart(toy_body, blended_body):
    assert not toy_body.has_posedirs
    assert blended_body.has_posedirs


def test_posing_does_not_wait_for_torch():
    code = "import sys, drapeline.bodies.sequence; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_batch_equals_single_frames(blended_body, poses):
    together, joints = posed_vertices(blended_body, np.ones(10), poses)
    for frame in range(len(poses)):
        alone, joint = posed_vertices(blended_body, np.ones(10), poses[frame : frame + 1])
        np.testing.assert_allclose(together[frame], alone[0], atol=1e-6)
        np.testing.assert_allclose(joints[frame], joint[0], atol=1e-6)


def test_root_joint_is_where_trans_says(toy_body, poses):
    trans = np.random.default_rng(2).normal(size=(5, 3))
    _, joints = posed_vertices(toy_body, np.zeros(10), poses, trans)
    np.testing.assert_allclose(joints[:, 0], trans, atol=1e-6)


def test_rest_pose_stands_upright_facing_minus_y(toy_body):
    vertices, joints = posed_vertices(toy_body, np.zeros(10), REST_POSE[None])
    assert np.ptp(vertices[0, :, 2]) == pytest.approx(np.ptp(toy_body.v_template[:, 1]), rel=0.02)
    left_hand, left_foot, left_ankle = joints[0, 22], joints[0, 10], joints[0, 7]
    assert left_hand[0] > 0.5
    assert left_foot[1] < left_ankle[1] - 0.05


def test_turning_the_root_turns_everything(toy_body, poses):
    turn = Rotation.from_rotvec([0.3, -0.5, 0.9])
    turned = poses.copy()
    turned[:, :3] = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    before, _ = posed_vertices(toy_body, np.zeros(10), poses)
    after, _ = posed_vertices(toy_body, np.zeros(10), turned)
    np.testing.assert_allclose(after, before @ turn.as_matrix().T, atol=1e-5)


def test_smplx_opens_a_converted_body_in_every_way_that_the_docs_name(baked_bodies, tmp_path):
    body, file = baked_bodies["female"], tmp_path / "female.npz"
    save_body(file, body)
    convert_to_pickle(file, tmp_path / "smpl/SMPL_FEMALE.pkl")
    shape = np.linspace(-1, 1, 10)
    expected = shape_body(body, shape)[0]
    with np.load(file) as arrays:
        opened = [
            smplx.SMPL(str(tmp_path / "smpl/SMPL_FEMALE.pkl")),
            smplx.SMPL(str(tmp_path / "smpl"), gender="female"),
            smplx.create(str(tmp_path), model_type="smpl", gender="female"),
            smplx.SMPL("", data_struct=smplx.utils.Struct(**arrays)),
        ]
    for theirs in opened:
        found = theirs(betas=torch.tensor(shape, dtype=torch.float32)[None]).vertices[0].detach()
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_smplx_opens_the_baked_file_and_agrees(baked_bodies, tmp_path, poses):
    for gender, body in baked_bodies.items():
        save_body(tmp_path / f"{gender}.npz", body)
        convert_to_pickle(tmp_path / f"{gender}.npz", tmp_path / f"SMPL_{gender.upper()}.pkl")
        assert load_body(tmp_path / f"{gender}.npz").name == body.name
        theirs = smplx.SMPL(str(tmp_path), gender=gender, batch_size=len(poses))
        shape, trans = np.linspace(-2, 2, 10), np.ones((5, 3))
        ours, joints = posed_vertices(body, shape, poses, trans)
        pose = torch.tensor(poses, dtype=torch.float32)
        root = torch.from_numpy(shape_body(body, shape)[1][0])
        result = theirs(
            betas=torch.tensor(shape, dtype=torch.float32).expand(5, -1),
            global_orient=pose[:, :3],
            body_pose=pose[:, 3:],
            transl=torch.tensor(trans, dtype=torch.float32) - root,
        )
        np.testing.assert_allclose(ours, result.vertices.detach(), atol=1e-5)
        np.testing.assert_allclose(joints, result.joints.detach()[:, :24], atol=1e-5)


def assert_equal(body, expected):
    """Array by array, to the bit."""
    assert body.name == expected.name
    for name, array in vars(expected).items():
        if isinstance(array, np.ndarray):
            np.testing.assert_array_equal(getattr(body, name), array, err_msg=name)


def test_of_the_free_body_its_version_is_kept_alone(baked_bodies, tmp_path):
    for gender, body in baked_bodies.items():
        path = tmp_path / "bodies" / f"{gender}.npz"
        keep_body(path, body, gender)
        assert path.stat().st_size < 1000
        assert_equal(load_kept_body(path, gender), body)


@pytest.mark.parametrize("part", ["v_template", "shapedirs", "posedirs", "J_regressor", "weights"])
def test_a_body_that_was_made_of_the_free_one_is_kept_whole(baked_bodies, tmp_path, part):
    body = baked_bodies["female"]
    array = getattr(body, part).copy()
    array[[0, -1]] = array[[-1, 0]]
    other = replace(body, **{part: array})
    keep_body(tmp_path / "body.npz", other, "female")
    assert_equal(load_kept_body(tmp_path / "body.npz", "female"), other)


def test_any_other_body_is_kept_whole(toy_body, baked_bodies, tmp_path):
    for body in (toy_body, baked_bodies["male"]):  # as the female one
        keep_body(tmp_path / "body.npz", body, "female")
        assert_equal(load_kept_body(tmp_path / "body.npz", "female"), body)


def test_a_body_that_was_kept_of_another_version_is_refused(baked_bodies, tmp_path, monkeypatch):
    path = tmp_path / "body.npz"
    keep_body(path, baked_bodies["female"], "female")
    monkeypatch.setattr(model, "FREE_BODY_VERSION", 7)
    with pytest.raises(
        InputError, match="body.npz: made with version 1 of the free body, expected 7"
    ):
        load_kept_body(path, "female")


def test_a_kept_body_that_is_missing_or_none_is_named(tmp_path):
    path = tmp_path / "body.npz"
    with pytest.raises(InputError, match="body.npz: no such file"):
        load_kept_body(path, "female")
    np.savez(path, x=1)
    with pytest.raises(InputError, match="body.npz: lacks"):
        load_kept_body(path, "female")
