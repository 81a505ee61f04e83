"""Garments in motion: what trivial predictions must reach on data made for them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.bodies.skinning import skin_points
from drapeline.errors import InputError
from drapeline.frames import GENDERS, REST_POSE
from drapeline.learning_data.moving import MovingGarment, load_moving, moving_files_test_first
from drapeline.metrics.dynamic import Measured, measure_motion, moving_summary
from drapeline.metrics.dynamic_baselines import MEAN, STILL, mean_wrinkles, moving_baseline_summary
from drapeline.metrics.table import HIGH, LOW, find_value
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from drapeline.storage import write_json
from gcvae_files import torso_registration
from tiny_sample import write_tiny_sample

WRINKLE_M = 0.01


@pytest.fixture(scope="module")
def topology(toy_body):
    return SimpleNamespace(faces=toy_body.faces, faces_of=lambda name: toy_body.faces)


def moving_garment(body, split, name, *, wrinkle=0.0, seed=0):
    """Cloth 2 cm over the torso that the body's own weights carry, wrinkles along X in rest."""
    rng = rng_for(seed, "moving", split, name)
    shape = rng.uniform(-1, 1, 10)
    poses = np.tile(REST_POSE, (6, 1)) + rng.normal(0, 0.2, (6, 72))
    registered = torso_registration(body, shape)
    vertex = registered.vertex
    still = rest_body(body, shape)[vertex] + registered.offsets[vertex] + [wrinkle, 0, 0]
    cloth = skin_points(still, rest_to_pose(body, shape, poses), registered.weights)
    return MovingGarment(
        f"{split}{seed}",
        split,
        name,
        "female",
        shape,
        poses,
        registered,
        np.zeros((0, 3), dtype=np.int32),
        cloth.astype(np.float32),
    )


def test_a_perfect_prediction_has_no_error_and_is_outside(toy_body, topology):
    moving = moving_garment(toy_body, "test", "Tshirt")
    frames = np.array([1, 4])
    rows = measure_motion(moving, frames, moving.points(frames), toy_body, topology)
    assert [row["surface_error_mm"] for row in rows] == [0, 0]
    assert rows[0]["inside_1cm_share"] == 0
    assert "inside_share" not in rows[1]  # only every fifth frame


def test_cloth_inside_the_body_is_seen_in_its_pose(toy_body, topology):
    moving = moving_garment(toy_body, "test", "Tshirt")
    frames = np.array([3])
    body = rest_body(toy_body, moving.shape)[moving.registered.vertex]
    inside = skin_points(
        body * [0.7, 0.7, 1],
        rest_to_pose(toy_body, moving.shape, moving.poses[frames]),
        moving.registered.weights,
    )
    (row,) = measure_motion(moving, frames, inside, toy_body, topology)
    assert row["inside_1cm_share"] > 0.8
    assert row["surface_error_mm"] > 20


def test_frames_of_one_sample_make_no_interval_narrower():
    names = {"model": "dvae", "variant": "v", "split": "test", "seed": 0}

    def width(copies):
        measured = [
            Measured(f"s{k}", "Top", [{"surface_error_mm": value}] * copies)
            for k, value in enumerate((1.0, 2.0, 5.0, 9.0))
        ]
        rows = moving_summary(measured, **names)
        low, high = (
            find_value(rows, "v", "test", "all", "surface_error_mm" + end) for end in (LOW, HIGH)
        )
        assert low.n == 4 * copies
        return high.value - low.value

    assert width(50) == pytest.approx(width(1))
    assert width(1) > 3


def test_mean_wrinkles_are_those_of_the_type_freed_from_pose(toy_body):
    garments = [
        moving_garment(toy_body, "train", "Tshirt", wrinkle=wrinkle, seed=seed)
        for seed, wrinkle in enumerate((0.0, WRINKLE_M))
    ] + [moving_garment(toy_body, "train", "Dress", wrinkle=3 * WRINKLE_M)]
    bodies = dict.fromkeys(GENDERS, toy_body)
    mean = mean_wrinkles(garments, bodies, step=2)
    mask = garments[0].registered.mask
    for name, expected in (("Tshirt", WRINKLE_M / 2), ("Dress", 3 * WRINKLE_M), ("Top", 0)):
        wrinkles = mean[GARMENTS.index(name)]
        np.testing.assert_allclose(
            wrinkles[mask], np.tile([expected, 0, 0], (mask.sum(), 1)), atol=1e-5
        )
        assert (wrinkles[~mask] == 0).all()


def test_mean_wrinkles_are_means_over_the_garments_that_cover_a_vertex(toy_body):
    whole, short = (
        moving_garment(toy_body, "train", "Tshirt", wrinkle=WRINKLE_M, seed=seed) for seed in (0, 1)
    )
    kept = np.arange(len(short.registered.vertex)) % 2 == 0
    mask = np.zeros_like(short.registered.mask)
    mask[short.registered.vertex[kept]] = True
    parts = {
        name: getattr(short.registered, name)[kept]
        for name in ("vertex", "corner", "bary", "weights")
    }
    short = replace(short, registered=replace(short.registered, mask=mask, **parts))
    mean = mean_wrinkles([whole, short], dict.fromkeys(GENDERS, toy_body), step=2)
    wrinkles = mean[GARMENTS.index("Tshirt")][whole.registered.mask]
    np.testing.assert_allclose(wrinkles, np.tile([WRINKLE_M, 0, 0], (len(wrinkles), 1)), atol=1e-5)


def test_baselines_reach_what_their_data_allows(toy_body, topology):

    def garments(split, *seeds):
        for seed in seeds:
            yield moving_garment(toy_body, split, "Tshirt", wrinkle=WRINKLE_M, seed=seed)

    rows = moving_baseline_summary(
        garments("train", 0, 1),
        {"test": garments("test", 2, 3)},
        dict.fromkeys(GENDERS, toy_body),
        topology,
        step=1,
        seed=0,
    )
    still, mean = (
        find_value(rows, name, "test", "all", "surface_error_mm") for name in (STILL, MEAN)
    )
    # Blended joint motions shorten a shift a little, never lengthen it.
    assert 0.85 * 1000 * WRINKLE_M < still.value <= 1000 * WRINKLE_M + 1e-3
    assert mean.value < 1e-2
    assert still.n == 12
    assert find_value(rows, "moving", "test", "all", "surface_error_mm") is None
    assert find_value(rows, "moving", "test", "all", "inside_share").model == "truth"


def test_without_training_garments_there_is_one_sentence(toy_body, topology):
    with pytest.raises(InputError, match="no sample of the training split was accepted"):
        moving_baseline_summary(
            [],
            {"test": [moving_garment(toy_body, "test", "Tshirt")]},
            dict.fromkeys(GENDERS, toy_body),
            topology,
            step=1,
            seed=0,
        )


@pytest.fixture
def files(toy_body, tmp_path):
    """An accepted training sample and a rejected test sample, with their registrations."""
    samples, registrations = [], []
    for name, split, status in (("00001", "train", "accepted"), ("00002", "test", "rejected")):
        tiny = write_tiny_sample(tmp_path, toy_body, name, split, status=status)
        folder = tmp_path / "registration" / name
        write_json(folder / "status.json", {"id": name, "status": status, "split": split})
        if status == "accepted":
            made = moving_garment(toy_body, split, "Tshirt").registered
            for garment in ("Tshirt", "Skirt"):
                made.save(folder / f"{garment}.npz")
        samples.append(tiny)
        registrations.append(folder)
    return samples, registrations


def test_only_accepted_samples_are_loaded_root_relative(files):
    samples, registrations = files
    folders = [tiny.folder for tiny in samples]
    found = list(load_moving(folders, registrations, "train"))
    assert {(m.sample, m.split) for m in found} == {("00001", "train")}
    assert {m.name for m in found} == {"Tshirt", "Skirt"}
    for moving in found:
        np.testing.assert_allclose(moving.cloth, samples[0].vertices[moving.name], atol=1e-5)
        assert moving.faces.max() < moving.cloth.shape[1]
    assert not list(load_moving(folders, registrations, "test"))
    # Each is read when it is its turn.
    turns = load_moving(folders, registrations, "train")
    first = next(turns).name
    (last,) = {"Tshirt", "Skirt"} - {first}
    (registrations[0] / f"{last}.npz").unlink()
    with pytest.raises(InputError, match=rf"{last}\.npz: no such file"):
        next(turns)


def test_pictures_take_held_out_garments_first(toy_body, files, tmp_path):
    samples, registrations = files
    folders = [tiny.folder for tiny in samples]
    assert {m.split for m in moving_files_test_first(folders, registrations)} == {"train"}
    tiny = write_tiny_sample(tmp_path, toy_body, "00003", "test")
    held_out = tmp_path / "registration" / "00003"
    write_json(held_out / "status.json", {"id": "00003", "status": "accepted", "split": "test"})
    for garment in ("Tshirt", "Skirt"):
        moving_garment(toy_body, "test", "Tshirt").registered.save(held_out / f"{garment}.npz")
    found = moving_files_test_first([*folders, tiny.folder], [*registrations, held_out])
    assert [m.split for m in found] == ["test", "test", "train", "train"]
    loaded = found[1].load()
    assert (loaded.sample, loaded.name) == ("00003", found[1].name)
    np.testing.assert_allclose(loaded.cloth, tiny.vertices[loaded.name], atol=1e-5)
    with pytest.raises(InputError, match="none of 1 samples was accepted"):
        moving_files_test_first(folders[1:], registrations[1:])
