"""The network that predicts wrinkles from motion: what it sees, and what its codes mean."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from drapeline.bodies.kinematics import mirror_poses
from drapeline.models.gcvae.data import BodyTemplate
from drapeline.models.gcvae.settings import WrinkleMlpSettings
from drapeline.models.gcvae.wrinkle_mlp import CodeRows, WrinkleMlp, motion_features
from drapeline.models.training.batches import as_tensors
from toys.gcvae import ToyGarments, toy_template, tube_mirror

CODE = 3
JOINTS = slice(13, 13 + 6 * 23)
UP = slice(JOINTS.stop, JOINTS.stop + 3)
TURNS = slice(UP.stop, UP.stop + 72)


def conditions(now, before, seed=0):
    """(1, 13 + 2 * 72 + CODE) of two poses (24, 3)."""
    rng = np.random.default_rng(seed)
    parts = [rng.normal(size=13), np.ravel(now), np.ravel(before), rng.normal(size=CODE)]
    return torch.from_numpy(np.concatenate(parts).astype(np.float32))[None]


def poses(seed):
    return 0.6 * np.random.default_rng(seed).normal(size=(24, 3))


def turned(pose, by):
    """A pose whose root is turned in the world."""
    root = by * Rotation.from_rotvec(pose[0])
    return np.concatenate([root.as_rotvec()[None], pose[1:]])


class MovingToys(ToyGarments):
    """The same garments in poses."""

    def __init__(self):
        super().__init__()
        rng = np.random.default_rng(1)
        self.poses = rng.normal(size=(len(self.split), 2, 72)).astype(np.float32)
        self.static = rng.normal(size=(len(self.split), CODE)).astype(np.float32)

    def cvar(self, rows, poses=None):
        poses = self.poses[rows] if poses is None else poses
        flat = poses.reshape(len(rows), -1)
        return np.concatenate([super().cvar(rows), flat, self.static[rows]], 1)

    def mirrored_cvar(self, rows):
        return self.cvar(rows, mirror_poses(self.poses[rows]))


@pytest.fixture
def garments():
    return MovingToys()


@pytest.fixture
def fresh(monkeypatch, garments):
    """With its PCA fitted; the network predicts zero."""
    monkeypatch.setattr(BodyTemplate, "mirror", property(lambda self: tube_mirror()))
    size = 13 + 2 * 72 + CODE
    template = replace(
        toy_template(),
        cvar_mean=np.zeros(size, dtype=np.float32),
        cvar_std=np.ones(size, dtype=np.float32),
    )
    model = WrinkleMlp(WrinkleMlpSettings(latent=5, width=8, seed=2), template)
    model.fit(garments)
    model.prepare(garments.cvar(garments.rows("train")))
    return model.eval()


@pytest.fixture
def model(fresh):
    """The same, and the network predicts anything."""
    rng = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for weight in fresh.parameters():
            weight.add_(0.3 * torch.randn(weight.shape, generator=rng))
    return fresh


def test_static_conditions_and_code_are_seen_as_they_are():
    cvar = conditions(poses(0), poses(1))
    seen = motion_features(cvar)
    assert torch.equal(seen[:, :13], cvar[:, :13])
    assert torch.equal(seen[:, -CODE:], cvar[:, -CODE:])
    assert seen.shape[1] == TURNS.stop + CODE


def test_joints_are_seen_as_two_columns_of_their_matrices():
    now = poses(0)
    wanted = Rotation.from_rotvec(now[1:]).as_matrix()[:, :, :2]
    seen = motion_features(conditions(now, poses(1)))[0, JOINTS]
    np.testing.assert_allclose(seen.numpy(), wanted.ravel(), atol=1e-6)


@pytest.mark.parametrize(
    ("turn", "wanted"),
    [(90, [0, 1, 0]), (-90, [0, -1, 0]), (0, [0, 0, 1])],
    ids=["upright", "on the head", "on the back"],
)
def test_which_way_is_up_is_seen_from_the_body(turn, wanted):
    """Its y is along the spine, its z to the front; in the world, z is up."""
    pose = np.zeros((24, 3))
    pose[0, 0] = np.radians(turn)
    seen = motion_features(conditions(pose, pose))[0, UP]
    np.testing.assert_allclose(seen.numpy(), wanted, atol=1e-6)


def test_a_joint_that_turns_is_seen_by_sine_and_axis():
    before = poses(4)
    now = before.copy()
    axis, angle = np.array([0.6, 0.0, 0.8]), 0.4
    own = Rotation.from_rotvec(before[7]) * Rotation.from_rotvec(angle * axis)
    now[7] = own.as_rotvec()
    seen = motion_features(conditions(now, before))[0, TURNS].reshape(24, 3).numpy()
    np.testing.assert_allclose(seen[7], np.sin(angle) * axis, atol=1e-6)
    np.testing.assert_allclose(np.delete(seen, 7, axis=0), 0, atol=1e-6)


def test_which_way_a_body_faces_is_not_seen():
    now, before, by = poses(5), poses(6), Rotation.from_rotvec([0, 0, 1.3])
    one = motion_features(conditions(now, before))
    other = motion_features(conditions(turned(now, by), turned(before, by)))
    torch.testing.assert_close(one, other, atol=1e-5, rtol=0)


def unpredicting(model):
    """The same PCA, and a network that predicts zero."""
    plain = WrinkleMlp(model.settings, model.body_template).eval()
    plain.ppca.load_state_dict(model.ppca.state_dict())
    return plain


def test_a_code_says_how_far_a_frame_is_from_the_prediction(model, garments):
    batch = as_tensors(garments.batch(garments.rows("test")))
    code, predicted = model.encode(batch), model.predict(batch["cvar"])
    assert predicted.abs().max() > 0.1
    plain = unpredicting(model)
    torch.testing.assert_close(code.mean + predicted, plain.encode(batch).mean)
    zero = torch.zeros_like(code.mean)
    made, mask = model.decode(zero, batch["cvar"], batch["topology"])
    wanted, _ = plain.decode(predicted, batch["cvar"], batch["topology"])
    torch.testing.assert_close(made, wanted)
    assert mask is None


def test_the_loss_is_the_root_mean_square_distance_of_the_fields(model, garments):
    rows = garments.rows("val")
    batch = as_tensors(garments.batch(rows))
    z = torch.randn(len(rows), 5, generator=torch.Generator().manual_seed(3))
    model.validation_step({**batch, "z": z})
    plain = unpredicting(model)
    topology = batch["topology"]
    made, _ = plain.decode(model.predict(batch["cvar"]), batch["cvar"], topology)
    true, _ = plain.decode(z, batch["cvar"], topology)
    wanted = 1000 * (made - true).square().sum(2).mean(1).sqrt().mean()
    torch.testing.assert_close(
        model.logged[-1].values["val_loss"], wanted.detach(), rtol=1e-4, atol=0
    )


def test_frames_and_mirror_images_are_learned_from(fresh, garments):
    rows = CodeRows(fresh, garments)
    train, val = garments.rows("train"), garments.rows("val")
    assert len(rows.rows("train")) == 2 * len(train)
    assert len(rows.rows("val")) == len(val)
    learned = rows.batch(rows.rows("train"))
    one, image = (
        {key: value[part] for key, value in learned.items()}
        for part in (slice(len(train)), slice(len(train), None))
    )
    np.testing.assert_array_equal(one["cvar"], garments.cvar(train))
    np.testing.assert_array_equal(image["cvar"], garments.mirrored_cvar(train))
    assert one["names"] == image["names"] == garments.names(train)
    # Codes of images are those of the offsets' mirror images.
    batch = garments.batch(train)
    flipped = batch["offsets"][:, tube_mirror()] * np.array([-1, 1, 1], dtype=np.float32)
    mask = batch["mask"][:, tube_mirror()]
    there = fresh.encode(as_tensors({**batch, "offsets": flipped, "mask": mask})).mean.numpy()
    np.testing.assert_allclose(image["z"], there, rtol=1e-4, atol=1e-4)
    here = fresh.encode(as_tensors(batch)).mean.numpy()
    np.testing.assert_allclose(one["z"], here, rtol=1e-4, atol=1e-4)


def test_no_test_row_is_read(fresh, garments):
    read = []

    class Watched(MovingToys):
        def batch(self, rows):
            read.extend(rows)
            return super().batch(rows)

    watched = Watched()
    fresh.fit(watched)
    CodeRows(fresh, watched)
    assert set(read) == {*garments.rows("train"), *garments.rows("val")}


def test_a_step_that_is_taken_again_drops_the_same_numbers(model, garments):
    rows = CodeRows(model, garments)
    batch = as_tensors(rows.batch(rows.rows("train")))
    model.train()
    first, again = model.training_step(batch), model.training_step(batch)
    assert first == again
    model.progress = model.progress._replace(step=1)
    assert model.training_step(batch) != first
