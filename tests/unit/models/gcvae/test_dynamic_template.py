"""The body template of garments in motion, on made-up frames of a few garments."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body
from drapeline.learning_data.static import static_cvar
from drapeline.models.gcvae.data import DynamicGarments, dynamic_body_template
from drapeline.seeding import rng_for

SPLIT = np.array(["train", "train", "test", "train"])  # of the garments
OF_FRAME = np.repeat(np.arange(4), 3)


@pytest.fixture(scope="module")
def bodies(toy_body):
    wider = replace(toy_body, v_template=toy_body.v_template * [1.1, 1, 1.1])
    return {"female": toy_body, "male": wider}


def frames(vertices, held_out_shift=0.0):
    """Three frames each of four garments; what belongs to the held-out one may be shifted."""
    rng = rng_for(0, "frames")
    held_out = SPLIT == "test"
    shape = rng.normal(size=(4, 10)) + held_out_shift * held_out[:, None]
    gender = np.array(["female", "male", "male", "female"])
    tightness = rng.normal(size=(4, 2))
    offsets, base = rng.normal(size=(2, 12, vertices, 3)).astype(np.float32)
    for arrays in (offsets, base):
        arrays[held_out[OF_FRAME]] += held_out_shift
    data = SimpleNamespace(
        offsets=offsets,
        base=base,
        mask=np.ones((4, vertices), dtype=bool),
        garment_index=OF_FRAME,
        sample=np.array([f"{number:05d}" for number in range(4)]),
        garment=np.zeros(4, dtype=int),
        frame=np.tile(np.arange(3), 4),
        poses=rng.normal(size=(12, 4, 72)).astype(np.float32),
        shape=shape,
        gender=gender,
        cvar=lambda g: static_cvar(shape[g], gender[g], tightness[g]),
        topology=lambda rows: OF_FRAME[rows] % 2,
        rows=lambda split: np.flatnonzero(SPLIT[OF_FRAME] == split),
    )
    return DynamicGarments(data, np.zeros((4, 3), dtype=np.float32), 1)


def template_of(garments, bodies):
    faces = bodies["female"].faces
    return dynamic_body_template(
        garments,
        SimpleNamespace(faces=faces, skirt_faces=faces[:-1]),
        SimpleNamespace(edges={"body": []}, parents={"body": []}),
        bodies,
    )


def test_offsets_and_bases_have_the_training_frames_statistics(bodies):
    garments = frames(len(bodies["female"].v_template))
    template, train = template_of(garments, bodies), garments.rows("train")
    base = garments.data.base[train]
    np.testing.assert_allclose(template.base_mean, base.mean(axis=0), atol=1e-5)
    np.testing.assert_allclose(template.base_std, np.maximum(base.std(axis=0), 0.01), atol=0.01)
    for code in np.unique(garments.topology(train)):
        offsets = garments.data.offsets[train[garments.topology(train) == code]]
        mean, std = template.offset_mean[code], template.offset_std[code]
        np.testing.assert_allclose(mean, offsets.mean(axis=0), atol=1e-5)
        np.testing.assert_allclose(std, np.maximum(offsets.std(axis=0), 0.005), atol=0.01)
    np.testing.assert_allclose(template.cvar_mean, garments.cvar(train).mean(axis=0), atol=1e-5)
    assert len(template.faces["skirt"]) == len(template.faces["body"]) - 1


def test_bodies_have_the_statistics_of_the_training_garments_wearers_at_rest(bodies):
    garments = frames(len(bodies["female"].v_template))
    template, data = template_of(garments, bodies), garments.data
    rest = np.stack(
        [
            rest_body(bodies[data.gender[garment]], data.shape[garment])
            for garment in np.flatnonzero(SPLIT == "train")
        ]
    )
    np.testing.assert_allclose(template.body_mean, rest.mean(axis=0), atol=1e-5)
    np.testing.assert_allclose(template.body_std, np.maximum(rest.std(axis=0), 0.01), atol=1e-5)


def test_held_out_frames_do_not_count(bodies):
    vertices = len(bodies["female"].v_template)
    template, same = (template_of(frames(vertices, shift), bodies) for shift in (0.0, 5.0))
    for name in ("offset", "base", "body", "cvar"):
        for moment in ("mean", "std"):
            key = f"{name}_{moment}"
            np.testing.assert_array_equal(getattr(template, key), getattr(same, key), err_msg=key)
