"""Sequences from samples and from static outfits, of all garments or of one type."""

import numpy as np
import pytest

from drapeline.bodies.model import save_body
from drapeline.dataset.point_clouds import load_clouds, write_clouds
from drapeline.dataset.reader import Sample
from drapeline.dataset.settings import CloudSettings
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import triangulate
from drapeline.job import Job
from drapeline.learning_data.sequence_sources import (
    collect_all,
    garments_in_samples,
    garments_skinned,
    simulated_sequences,
    skinned_sequences,
)
from drapeline.learning_data.sequences import CloudData, GarmentSequence
from drapeline.learning_data.settings import SkinnedSettings
from drapeline.learning_data.skinned import load_skinned, write_skinned
from drapeline.outfits.garment_types import LABELS
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static import StaticOutfit
from drapeline.registration.to_template.remesh import RemeshTable
from toys.outfits_at_rest import save_static
from toys.tiny_sample import tube, write_tiny_sample

CLOUDS = CloudSettings(points=50)
SHAPE = np.full(10, 0.2)


def middles(faces):
    """A table that puts a template vertex into the middle of every fifth triangle."""
    corners = triangulate(faces)[::5]
    return RemeshTable(corners, np.full(corners.shape, 1 / 3, np.float32))


def expected_garment(vertices, table):
    """(..., N, 3) of vertices (..., V, 3)."""
    return vertices[..., table.corners, :].mean(axis=-2)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory, toy_body):
    """An accepted training sample and a rejected one; folders of samples and of their clouds."""
    stages = tmp_path_factory.mktemp("simulated")
    tiny = [
        write_tiny_sample(stages, toy_body, "00001", "train"),
        write_tiny_sample(stages, toy_body, "00002", "test", status="rejected"),
    ]
    clouds = [stages / "clouds" / one.folder.name for one in tiny]
    for one, folder in zip(tiny, clouds, strict=True):
        write_clouds(folder, one.folder, CLOUDS)
    return tiny, [one.folder for one in tiny], clouds


def test_accepted_samples_that_wear_the_garment_are_sequences(simulated):
    tiny, samples, clouds = simulated
    table = middles(tiny[0].meshes["Skirt"].faces)
    (one,) = garments_in_samples("Skirt", samples, clouds, {"00001": table})
    assert (one.name, one.source, one.split, one.gender) == ("00001", "blender", "train", "female")
    assert one.clip == "walk"
    assert one.number.tolist() == list(range(6))
    np.testing.assert_allclose(one.poses, tiny[0].poses, atol=1e-6)
    np.testing.assert_allclose(one.shape, tiny[0].shape, atol=1e-6)
    cloud = load_clouds(clouds[0])
    np.testing.assert_array_equal(one.points, cloud.points)
    np.testing.assert_array_equal(one.labels, cloud.labels)
    with Sample(samples[0]) as sample:
        rest, posed = sample.mesh("Skirt"), sample.vertices("Skirt", frame="root")
    np.testing.assert_allclose(one.canonical, expected_garment(rest.vertices, table), atol=1e-5)
    np.testing.assert_allclose(one.garment(), expected_garment(posed, table), atol=1e-5)
    np.testing.assert_array_equal(one.original.vertices, rest.vertices)
    np.testing.assert_array_equal(one.original.faces, rest.triangles)
    assert list(garments_in_samples("Trousers", samples, clouds, {})) == []


def test_accepted_samples_are_sequences_whatever_is_worn_in_them(simulated):
    tiny, samples, clouds = simulated
    ((sample, seen),) = simulated_sequences(samples, clouds)
    assert sample.id == seen.name == "00001"
    assert not isinstance(seen, GarmentSequence)
    for garment in sample.garments:
        table = middles(tiny[0].meshes[garment].faces)
        (one,) = garments_in_samples(garment, samples, clouds, {"00001": table})
        for key, value in vars(seen).items():
            np.testing.assert_array_equal(getattr(one, key), value)


def test_a_sample_whose_garment_is_not_registered_is_named(simulated):
    _, samples, clouds = simulated
    with pytest.raises(InputError, match="00001: its Skirt is not registered, expected a remesh"):
        list(garments_in_samples("Skirt", samples, clouds, {}))


@pytest.fixture(scope="module")
def skinned(simulated, tmp_path_factory, toy_body):
    """A skirt with a top, and a top alone, as they lie at rest; the folders of both stages."""
    stages = tmp_path_factory.mktemp("skinned")
    none = np.zeros(0, np.float32)
    skirt, top = (
        Garment(name, m.vertices, m.faces, np.zeros((0, 2)), np.zeros((0, 4)), none, none, none)
        for name, m in (("Skirt", tube(0.25, -0.6, 0.0)), ("Top", tube(0.28, 0.05, 0.35)))
    )
    outfits = [
        StaticOutfit(name, "train", Outfit(worn, SHAPE, np.zeros(2), np.zeros(2), "female"))
        for name, worn in (("s1", (skirt, top)), ("s2", (top,)))
    ]
    save_static(stages / "outfits_at_rest", outfits)
    write_skinned(
        stages / "000",
        stages / "outfits_at_rest",
        simulated[1],
        {"female": toy_body},
        SkinnedSettings(frames=3, step=2, clouds=CLOUDS),
    )
    return skirt, stages / "000", stages / "outfits_at_rest"


def test_static_outfits_in_motion_that_have_the_garment_are_sequences(skinned):
    skirt, folder, shard = skinned
    table = middles(skirt.faces)
    (one,) = garments_skinned("Skirt", [folder], [shard], {"s1": table})
    written = next(iter(load_skinned(folder)))
    assert (one.name, one.source, one.split, one.gender) == ("s1", "skinned", "train", "female")
    np.testing.assert_array_equal(one.number, written.number)
    assert np.diff(one.number).tolist() == [2, 2]
    np.testing.assert_array_equal(one.points, written.points)
    np.testing.assert_array_equal(one.shape, SHAPE)
    np.testing.assert_allclose(one.canonical, expected_garment(skirt.vertices, table), atol=1e-5)
    posed = expected_garment(written.garments["Skirt"], table)
    np.testing.assert_allclose(one.garment(), posed, atol=1e-5)
    np.testing.assert_array_equal(one.original.faces, triangulate(skirt.faces))
    with pytest.raises(InputError, match="s1: its Top is not registered"):
        list(garments_skinned("Top", [folder], [shard], {}))


def test_static_outfits_in_motion_are_sequences_whatever_is_worn(skinned):
    _, folder, _ = skinned
    found = list(skinned_sequences([folder]))
    assert [(one.name, seen.name) for one, seen in found] == [("s1", "s1"), ("s2", "s2")]
    for one, seen in found:
        assert (seen.source, seen.clip) == ("skinned", "00001")
        np.testing.assert_array_equal(seen.points, one.points)
        np.testing.assert_array_equal(seen.labels, one.labels)


class Files(dict):
    """Files of a job by name, as attributes too."""

    def __getattr__(self, name):
        return self[name]


def test_all_sequences_are_collected_without_a_template_or_a_fit(
    simulated, skinned, toy_body, tmp_path
):
    _, samples, clouds = simulated
    _, folder, _ = skinned
    bodies = {gender: tmp_path / f"{gender}.npz" for gender in GENDERS}
    for path in bodies.values():
        save_body(path, toy_body)
    places = {"samples": [samples[0].parent], "clouds": [clouds[0].parent], "skinned": [folder]}
    collect_all(Job(Files(**places, **bodies), [tmp_path / "labelled"], None))
    data = CloudData(tmp_path / "labelled")
    assert data.name.tolist() == ["00001", "s1", "s2"]
    assert data.source.tolist() == ["blender", "skinned", "skinned"]
    np.testing.assert_array_equal(data.points[data.rows(0)], load_clouds(clouds[0]).points)
    worn = [set(np.unique(data.labels[data.rows(one)])) - {0} for one in range(3)]
    names = (("Tshirt", "Skirt"), ("Skirt", "Top"), ("Top",))
    assert worn == [{LABELS.index(name) for name in each} for each in names]
