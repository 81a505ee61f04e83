"""Conditions of frames, and codes of their garments at rest."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from drapeline.bodies.kinematics import mirror_poses
from drapeline.frames import gender_names
from drapeline.learning_data.static import static_cvar
from drapeline.models.gcvae.codec import encode_rows
from drapeline.models.gcvae.data import DynamicGarments
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for

GARMENT_COUNT, FRAME_COUNT, CODE = 20, 50, 3


@pytest.fixture
def data():
    rng = rng_for(0, "frames")
    shape = rng.normal(size=(GARMENT_COUNT, 10)).astype(np.float32)
    gender = gender_names(rng.integers(0, 2, GARMENT_COUNT))
    tightness = rng.normal(size=(GARMENT_COUNT, 2)).astype(np.float32)

    def cvar(garments):
        return static_cvar(shape[garments], gender[garments], tightness[garments])

    return SimpleNamespace(
        sample=np.array([f"{k:05d}" for k in range(GARMENT_COUNT)]),
        garment=rng.integers(0, len(GARMENTS), GARMENT_COUNT),
        garment_index=rng.integers(0, GARMENT_COUNT, FRAME_COUNT),
        frame=rng.integers(0, 300, FRAME_COUNT),
        poses=rng.normal(size=(FRAME_COUNT, 4, 72)).astype(np.float32),
        cvar=cvar,
        static_batch=lambda garments: {"cvar": cvar(garments), "names": ["x"] * len(garments)},
    )


@pytest.mark.parametrize("frames", [1, 4])
def test_conditions_are_static_ones_then_poses_then_the_static_code(data, frames):
    codes = rng_for(1, "codes").normal(size=(GARMENT_COUNT, CODE)).astype(np.float32)
    garments, rows = DynamicGarments(data, codes, frames), np.array([7, 3, 7, 40])
    cvar, of = garments.cvar(rows), data.garment_index[rows]
    assert cvar.shape == (4, 13 + 72 * frames + CODE)
    assert cvar.dtype == np.float32
    np.testing.assert_array_equal(cvar[:, :13], data.cvar(of))
    np.testing.assert_array_equal(cvar[:, 13:-CODE], data.poses[rows, :frames].reshape(4, -1))
    np.testing.assert_array_equal(cvar[:, -CODE:], codes[of])
    # A mirror image has mirrored poses and is otherwise the same garment.
    mirrored = garments.mirrored_cvar(rows)
    np.testing.assert_array_equal(mirrored[:, :13], cvar[:, :13])
    np.testing.assert_array_equal(mirrored[:, -CODE:], cvar[:, -CODE:])
    np.testing.assert_allclose(
        mirrored[:, 13:-CODE].reshape(4, frames, 72),
        mirror_poses(data.poses[rows, :frames]),
        atol=1e-6,
    )


def test_names_tell_sample_garment_and_frame(data):
    garments = DynamicGarments(data, np.zeros((GARMENT_COUNT, CODE), np.float32), 1)
    of = data.garment_index[5]
    expected = f"{of:05d}/{GARMENTS[data.garment[of]]}/{data.frame[5]}"
    assert garments.names(np.array([5])) == [expected]


def test_static_codes_are_those_of_every_garment_in_their_order(data):
    """More garments than fit into a batch; the code is the first conditions."""

    def encode(batch):
        return SimpleNamespace(mean=batch["cvar"][:, :CODE], log_variance=batch["cvar"])

    model = SimpleNamespace(encode=encode)
    codes = encode_rows(model, data.static_batch, np.arange(len(data.garment))).mean
    np.testing.assert_array_equal(codes, data.cvar(np.arange(GARMENT_COUNT))[:, :CODE])
    assert not isinstance(codes, torch.Tensor)
