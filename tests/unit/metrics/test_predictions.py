"""Files and types that figures are drawn from."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import (
    FIRST_GARMENT_PIXEL,
    FittedPicture,
    PersonShown,
    Reconstruction,
    first_reconstructions,
    label_of,
    load_fitted_picture,
    load_fitted_scans,
    load_reconstruction,
    save_fitted_scans,
)
from drapeline.metrics.properties import CLASSES, scan_class
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from drapeline.storage import save_npz


def test_reconstructions_survive_a_file(tmp_path):
    rng = rng_for(0, "garment4d file")
    cloth, body = rng.normal(size=(2, 4, 3)), rng.normal(size=(2, 5, 3))
    made = Reconstruction(
        name="00001",
        garment="Skirt",
        faces=np.array([[0, 1, 3]]),
        canonical=cloth[0],
        proposal=cloth,
        final=cloth + 1,
        true=np.zeros((0, 3)),
        true_canonical=np.zeros((0, 3)),
        points=rng.normal(size=(2, 6, 3)),
        labels=np.zeros((2, 6), np.uint8),
        body=body,
        rest_body=body[0],
        body_faces=np.array([[0, 1, 4]]),
        root_rotation=np.zeros((2, 3)),
        root_height=np.zeros(2),
        number=np.arange(2),
    )
    made.save(tmp_path / "r.npz")
    back = load_reconstruction(tmp_path / "r.npz")
    assert (back.name, back.garment) == ("00001", "Skirt")
    assert back.true.shape == (0, 3)
    np.testing.assert_array_equal(back.number, made.number)
    save_npz(tmp_path / "r.npz", name="00001")
    with pytest.raises(InputError, match="garment"):
        load_reconstruction(tmp_path / "r.npz")


def test_of_each_type_with_a_reconstruction_the_first_is_shown_in_both_variants(tmp_path):
    folders = [tmp_path / name for name in ("Skirt", "Tshirt", "Trousers")]
    for folder, names in zip(folders, (["00002", "00001"], [], ["x"]), strict=True):
        made = folder / "reconstructions"
        made.mkdir(parents=True)
        for name in names:
            for file in (f"{name}.npz", f"{name}_ours.npz"):
                (made / file).touch()
    assert first_reconstructions(folders) == [
        tuple(folders[0] / f"reconstructions/00001{end}.npz" for end in ("", "_ours")),
        tuple(folders[2] / f"reconstructions/x{end}.npz" for end in ("", "_ours")),
    ]
    with pytest.raises(InputError, match="Tshirt: no sequence of any type is in the test split"):
        first_reconstructions(iter(folders[1:2]))


@pytest.mark.parametrize(
    ("region", "properties", "expected"),
    [
        ("upper", {"sleeve": 0.2}, "short upper"),
        ("upper", {"sleeve": 0.9}, "long upper"),
        ("lower", {"leg": 0.4}, "short lower"),
        ("lower", {"leg": 1.0}, "long lower"),
        ("whole", {"sleeve": 0.0, "leg": 1.0}, "whole body"),
    ],
)
def test_classes_go_by_limbs(region, properties, expected):
    assert scan_class(region, properties) == expected
    assert expected in CLASSES


def test_files_keep_fits(tmp_path):
    mesh = Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))
    none = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    found = {"00001_015": {"ours": {"Skirt": mesh, "Top": none}, "theirs": {"Skirt": mesh}}}
    save_fitted_scans(tmp_path / "fits.npz", found)
    again = load_fitted_scans(tmp_path / "fits.npz")
    assert {k: {v: set(g) for v, g in f.items()} for k, f in again.items()} == {
        "00001_015": {"ours": {"Skirt", "Top"}, "theirs": {"Skirt"}}
    }
    np.testing.assert_array_equal(again["00001_015"]["ours"]["Skirt"].vertices, mesh.vertices)
    assert len(again["00001_015"]["ours"]["Top"].faces) == 0


def test_a_name_that_is_none_of_a_fit_is_refused(tmp_path):
    np.savez(tmp_path / "fits.npz", keys=np.array(["00001_015"]))
    with pytest.raises(InputError, match=r"fits\.npz: names a fit '00001_015', expected scan/"):
        load_fitted_scans(tmp_path / "fits.npz")


def triangle(height_m):
    vertices = np.array([[0, 0, height_m], [1, 0, height_m], [0, 1, height_m]], np.float32)
    return Mesh(vertices, np.array([[0, 1, 2]], np.int32))


def person(garments, true):
    return PersonShown(np.diag([90.0, 90, 1]), np.eye(4), triangle(0), garments, true)


@pytest.mark.parametrize("photo", [None, np.full((4, 6, 3), 7, np.uint8)])
def test_a_picture_is_as_it_was_written(tmp_path, photo):
    labels = np.arange(24, dtype=np.uint8).reshape(4, 6) % 5
    nothing = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    people = (
        person({"Skirt": triangle(1), "Top": nothing}, {"Skirt": triangle(2)}),
        person({}, {}),
    )
    FittedPicture("street", labels, photo, people).save(tmp_path / "street.npz")
    again = load_fitted_picture(tmp_path / "street.npz")
    assert again.name == "street"
    assert np.array_equal(again.labels, labels)
    assert np.array_equal(again.photo, photo) if photo is not None else again.photo is None
    for found, written in zip(again.people, people, strict=True):
        assert np.array_equal(found.intrinsics, written.intrinsics)
        assert np.array_equal(found.world_to_camera, written.world_to_camera)
        assert np.array_equal(found.body.vertices, written.body.vertices)
        for kind in ("garments", "true"):
            meshes, expected = getattr(found, kind), getattr(written, kind)
            assert list(meshes) == list(expected)  # the order is that of the layers
            for name, mesh in expected.items():
                assert np.array_equal(meshes[name].vertices, mesh.vertices)
                assert np.array_equal(meshes[name].faces, mesh.faces)


def test_other_files_are_refused(tmp_path):
    save_npz(tmp_path / "other.npz", name="street")
    with pytest.raises(InputError, match=r"other\.npz.*labels"):
        load_fitted_picture(tmp_path / "other.npz")


def test_every_garment_has_a_label():
    assert [label_of(name) for name in GARMENTS] == [
        FIRST_GARMENT_PIXEL + index for index in range(len(GARMENTS))
    ]
