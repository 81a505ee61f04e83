"""The network of displacements: what it is given, what its loss is, and that it learns."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from drapeline.bodies.rest_skinning import tpose_motions
from drapeline.bodies.skinning import skin_points
from drapeline.frames import REST_POSE
from drapeline.learning_data.pose_displacements import POSE_NUMBERS
from drapeline.models.smplicit.displacement_network import (
    TURN_NUMBERS,
    DisplacementField,
    blend_motions,
    encode_turns,
    move,
)
from drapeline.models.training.batches import as_tensors
from drapeline.models.training.module import RATE_SHARE, Position
from toys.displacement_trainings import toy_displacement
from toys.learning import (
    assert_a_step_lowers,
    assert_learned_by_heart,
    assert_true_gradients,
    doubles,
    shake_weights,
)


@pytest.fixture
def model(displacements, toy_body):
    return toy_displacement(displacements, toy_body)


@pytest.fixture(scope="module")
def batch(displacements):
    return as_tensors(displacements.batch(displacements.rows("train"), 16, seed=0))


def with_loss(model, **changes):
    settings = model.settings.replace(loss=changes)
    model.settings = settings
    return model


def turns_of(batch):
    return encode_turns(blend_motions(batch["weights"], batch["motions"]), batch["motions"])


def test_points_move_as_the_skinning_moves_them(batch):
    moved = move(batch["straight"], blend_motions(batch["weights"], batch["motions"]))
    expected = skin_points(
        batch["straight"][0].numpy(), batch["motions"][:1].numpy(), batch["weights"][0].numpy()
    )
    assert moved[0] == pytest.approx(expected[0], abs=1e-5)


def test_turns_are_told_by_gravity_and_the_root(toy_body):
    """Of points that follow the left hip alone, in the pose of rest and others."""
    poses = np.tile(REST_POSE, (3, 1))
    poses[:, 3:6] = [[0, 0, 0], [0, 0, 0], [0.7, 0, 0]]
    poses[1, :3] = (
        Rotation.from_rotvec([0, 0, 1.0]) * Rotation.from_rotvec(poses[1, :3])
    ).as_rotvec()
    joints = torch.from_numpy(tpose_motions(toy_body, np.zeros(10), poses))
    weights = torch.zeros(3, 1, 24, dtype=torch.float64)
    weights[..., 1] = 1
    still, facing_elsewhere, raised = encode_turns(blend_motions(weights, joints), joints)[:, 0]
    assert still == pytest.approx(np.zeros(TURN_NUMBERS), abs=1e-7)
    assert facing_elsewhere == pytest.approx(np.zeros(TURN_NUMBERS), abs=1e-7)
    turn = Rotation.from_rotvec([0.7, 0, 0]).as_matrix()
    assert raised[3:] == pytest.approx((turn - np.eye(3)).ravel(), abs=1e-7)
    assert raised[:3] == pytest.approx(turn.T @ [0, -1, 0] - [0, -1, 0], abs=1e-7)


def test_gradients_are_true_and_a_step_lowers_the_loss(model, batch):
    model = with_loss(shake_weights(model.double(), 0.05), latent=0.1, unknown=0.3)
    model.place_basis = model.place_basis.double()
    given = doubles(batch)
    loss = lambda module: module.training_step(given)  # noqa: E731
    assert_true_gradients(model, loss)
    assert_a_step_lowers(model, loss)


def test_a_batch_is_learned_by_heart(displacements, toy_body, batch):
    model = with_loss(
        toy_displacement(displacements, toy_body, learning_rate=5e-3), edge=0.0, pose_dropout=0.0
    )
    few = {key: value[:2] for key, value in batch.items()}
    assert_learned_by_heart(model, few, "vertex_error_mm", steps=1000)


def test_the_truth_has_no_error(model, batch, monkeypatch):
    monkeypatch.setattr(DisplacementField, "forward", lambda *_: batch["displacement"])
    terms = model._terms(batch, torch.zeros(len(batch["shape"]), 3))
    assert float(terms["vertex_error_mm"]) == 0
    assert float(terms["edge"]) == 0


def test_errors_are_measured_in_the_pose(model, batch, monkeypatch):
    """A shift by 1 cm in the T-pose is one by 1 cm wherever the skinning is rigid."""
    rigid = torch.zeros_like(batch["weights"])
    rigid[..., 1] = 1
    given = {**batch, "weights": rigid}
    shift = torch.tensor([0.006, 0.0, 0.008])
    monkeypatch.setattr(DisplacementField, "forward", lambda *_: batch["displacement"] + shift)
    terms = model._terms(given, torch.zeros(len(batch["shape"]), 3))
    torch.testing.assert_close(terms["vertex_error_mm"], torch.tensor(10.0))
    assert float(terms["edge"]) < 1e-6


def test_half_as_long_edges_are_off_by_half(model, batch, monkeypatch):
    given = {**batch, "straight": torch.zeros_like(batch["straight"])}
    starts, ends = torch.zeros(16, 3), torch.tensor([0.0, 0.04, 0.0]).expand(16, 3)
    true = torch.cat([starts, ends]).expand_as(batch["displacement"])
    one = torch.zeros_like(batch["weights"])
    one[..., 0] = 1
    given |= {"displacement": true, "weights": one}
    monkeypatch.setattr(DisplacementField, "forward", lambda *_: true / 2)
    terms = model._terms(given, torch.zeros(len(batch["shape"]), 3))
    torch.testing.assert_close(terms["edge"], torch.tensor(0.25))
    torch.testing.assert_close(terms["vertex_error_mm"], torch.tensor(10.0))


def test_every_input_counts(model, batch):
    given = {name: batch[name].clone() for name in ("points", "pose", "shape")}
    given["turns"] = turns_of(batch)
    given["z"] = torch.zeros(len(given["shape"]), 3)
    for value in given.values():
        value.requires_grad_(True)
    moved = model(gender=batch["gender"], **given)
    assert moved.shape == batch["points"].shape
    slopes = torch.autograd.grad(moved.square().sum(), [*given.values()])
    for name, slope in zip(given, slopes, strict=True):
        assert slope.abs().amax(dim=tuple(range(1, slope.ndim))).min() > 0, name


def test_batched_equals_single(model, batch):
    given = [batch["points"], turns_of(batch), *(batch[k] for k in ("pose", "shape", "gender"))]
    z = torch.randn(len(batch["shape"]), 3, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        together = model(*given, z)
        alone = [model(*(x[k : k + 1] for x in (*given, z)))[0] for k in range(len(z))]
    torch.testing.assert_close(together, torch.stack(alone), atol=1e-6, rtol=1e-4)


@pytest.mark.parametrize("name", ["unknown", "pose_dropout"])
def test_some_codes_and_poses_are_replaced_by_zero_anew_in_each_step(model, batch, name):
    found = {}
    with torch.no_grad():
        model.codes += 1
        for share in (0.0, 0.5, 1.0):
            with_loss(model, **{"unknown": 0.0, "pose_dropout": 0.0, name: share})
            for step in (0, 1, 0):
                model.position = Position(0, step, 0)
                loss = float(model.training_step(batch))
                found.setdefault(share, []).append(loss)
        first, _, again = found[0.5]
    assert first == again
    assert len({*found[0.5]}) == 2
    assert len({*found[0.0]}) == len({*found[1.0]}) == 1


def test_validation_knows_no_code(model, batch):
    results = []
    for size in (0.0, 1.0):
        with torch.no_grad():
            model.codes[:] = size
        model.validation_step(batch)
        (logged,) = model.logged
        model.logged.clear()
        results.append(float(logged.values["val_loss"]))
    assert results[0] == results[1]


def test_codes_take_larger_steps(model):
    groups = model.optimizer().param_groups
    known = [id(p) for group in groups for p in group["params"]]
    assert sorted(known) == sorted(id(p) for p in model.parameters())
    (codes,) = [g for g in groups if any(p is model.codes for p in g["params"])]
    assert codes[RATE_SHARE] == 5.0


def test_the_pose_takes_the_place_of_the_cut(model):
    assert model.decoder.cut == TURN_NUMBERS + POSE_NUMBERS
    assert model.decoder.style == model.codes.shape[1] == 3
