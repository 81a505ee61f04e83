"""Trained networks used without the data of their training, and which scans hold a garment."""

import logging
import shutil

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.models.garment4d.reconstruct import (
    ReconstructionModel,
    check_labels,
    reconstruct,
    refine,
)
from drapeline.models.garment4d.stages import (
    PosedStage,
    load_posed_files,
    load_stage,
    save_posed_files,
)
from drapeline.registration.settings import RefineSettings
from toys.garment4d import GARMENT


def taken(*shares):
    """(F, 1000) of which these shares are taken for the garment."""
    return np.arange(1000) < 1000 * np.array(shares)[:, None]


def test_scans_without_the_garment_are_refused_by_their_share_over_all_frames():
    with pytest.raises(InputError, match=r"^walk: 1\.9% of the points are taken for Skirt, exp"):
        check_labels("walk", taken(0.0, 0.038), "Skirt")
    check_labels("walk", taken(0.0, 0.040), "Skirt")


def test_single_frames_without_it_are_named(caplog):
    with caplog.at_level(logging.WARNING, logger="drapeline"):
        check_labels("walk", taken(0.3, 0.019, 0.02, 0.3), "Skirt")
    (record,) = caplog.records
    assert record.getMessage() == (
        "walk: frame 2: 1.9 % of the points are taken for Skirt; it follows other frames there"
    )


@pytest.fixture
def model(trained_posed, sequences, tmp_path):
    """From a folder of a garment type, whose data nobody needs."""
    folder = tmp_path / GARMENT
    shutil.copytree(trained_posed, folder / "posed")
    skinning = load_stage(trained_posed, PosedStage).settings.skinning
    save_posed_files(folder / "posed", sequences, skinning)
    return ReconstructionModel(folder, "cpu")


@pytest.fixture
def worn(toy_skirts):
    return toy_skirts[-1]


def test_a_garment_is_what_the_networks_and_our_step_make_of_the_clouds(model, worn, given):
    made = model.reconstruct(given["points"], worn.poses, worn.shape)
    steps = reconstruct(model.stage, made.points, worn.poses, given["body"])
    files = load_posed_files(model.folder)
    wanted = refine(
        steps,
        made.points,
        worn.poses,
        given["body"],
        model.stage.label,
        made.faces,
        RefineSettings(),
        files.worn_statistics,
    )
    np.testing.assert_allclose(made.vertices, wanted, atol=1e-5)
    np.testing.assert_array_equal(made.canonical, steps.canonical)
    assert made.garment == GARMENT
    assert made.labels.shape == made.points.shape[:2] == given["points"].shape[:2]
    # The same points in another order.
    for own, asked in zip(made.points, given["points"], strict=True):
        np.testing.assert_allclose(np.sort(own, axis=0), np.sort(asked, axis=0), atol=1e-6)
    plain = model.reconstruct(given["points"], worn.poses, worn.shape, refining=None)
    np.testing.assert_allclose(plain.vertices, steps.final, atol=1e-5)


def test_clouds_of_any_size_that_are_somewhere_are_answered_where_they_are(model, worn, given):
    trans = np.array([3.0, -2.0, 0.9]) + 0.01 * np.arange(len(worn.poses))[:, None]
    clouds = [
        np.concatenate([points, points[:count]]) + root
        for count, (points, root) in enumerate(zip(given["points"], trans, strict=True))
    ]
    moved = model.reconstruct(clouds, worn.poses, worn.shape, trans=trans)
    here = model.reconstruct(given["points"], worn.poses, worn.shape)
    away = moved.vertices - here.vertices - trans[:, None]
    assert np.abs(away).mean() < 0.02
    assert np.abs(moved.points.mean(axis=1) - trans).max() < 1.5


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"gender": "child"}, "points: the body: gender is 'child', expected female, male"),
        ({"shape": np.zeros(9)}, r"points: the body: shape has shape \(9,\)"),
        ({"trans": np.ones((7, 2))}, r"points: the body: trans has shape \(7, 2\)"),
        ({"poses": np.zeros((6, 72))}, "points: 7 frames, but 6 poses"),
        ({"points": np.full((7, 9, 3), np.nan)}, "points: frame 1: 9 of 9 points hold NaN"),
        ({"points": 1000 * np.eye(3)[None].repeat(7, 0)}, "millimetres"),
        ({"least_share": 0.9}, "of the points are taken for Skirt, expected 90% or more"),
    ],
)
def test_what_cannot_be_answered_is_refused_in_one_sentence(model, worn, given, changed, message):
    asked = {"points": given["points"], "poses": worn.poses, "shape": worn.shape, **changed}
    with pytest.raises(InputError, match=message):
        model.reconstruct(asked.pop("points"), asked.pop("poses"), asked.pop("shape"), **asked)
