import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import (
    FIRST_GARMENT_PIXEL,
    FittedPicture,
    PersonShown,
    label_of,
    load_fitted_picture,
)
from drapeline.outfits.garment_types import GARMENTS
from drapeline.storage import save_npz


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
