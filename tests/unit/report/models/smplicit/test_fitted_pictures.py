"""Figures of pictures: what they show, not that there are any."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import BODY_PIXEL, FittedPicture, PersonShown, label_of
from drapeline.outfits.garment_types import GARMENTS
from drapeline.rendering.raytracer import ray_share
from drapeline.report.colours import garment_colour
from drapeline.report.models.scene import label_colours
from drapeline.report.models.smplicit.figures import (
    plot_known_pictures,
    plot_own_picture,
)
from toys.views import TUBE, coloured

WIDTH, HEIGHT = 120, 160
INTRINSICS = np.array([[150.0, 0, WIDTH / 2], [0, 150, HEIGHT / 2], [0, 0, 1]])
# Looks along +Y at the origin from 3 m away.
TO_CAMERA = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1.0]])


@pytest.fixture(autouse=True)
def few_rays():
    with ray_share(0.02):
        yield


def moved(mesh, x_m):
    return Mesh(mesh.vertices + np.array([x_m, 0, 0], np.float32), mesh.faces)


def person(x_m=0.0, garments=None, true=None):
    """A thin body in a skirt."""
    centred = TUBE.vertices - TUBE.vertices.mean(axis=0)
    tube = Mesh((centred / np.abs(centred).max() * 0.5).astype(np.float32), TUBE.faces)
    body = Mesh(0.5 * tube.vertices, tube.faces)
    garments = {"Skirt": moved(tube, x_m)} if garments is None else garments
    return PersonShown(INTRINSICS, TO_CAMERA, moved(body, x_m), garments, true or {})


def shown(*people, photo=None):
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[20:140, 15:105] = BODY_PIXEL
    return FittedPicture("00001_002", labels, photo, people)


def cells(path, columns):
    image = np.asarray(Image.open(path).convert("RGB")).astype(int)
    return np.array_split(image, columns, axis=1)


def test_labels_have_the_colours_of_garments():
    labels = np.array([[0, label_of("Skirt")], [label_of("Top"), BODY_PIXEL]], np.uint8)
    colours = label_colours(labels)
    assert (colours[0, 0] == 255).all()
    assert colours[0, 1] == pytest.approx(255 * np.array(garment_colour("Skirt")), abs=0.51)
    assert colours[1, 0] == pytest.approx(255 * np.array(garment_colour("Top")), abs=0.51)
    assert len(np.unique(label_colours(np.arange(3 + len(GARMENTS))), axis=0)) == 3 + len(GARMENTS)


def test_garments_are_drawn_over_the_picture_and_from_the_side(tmp_path):
    plot_own_picture(tmp_path / "one.png", shown(person()))
    before, found, side = cells(tmp_path / "one.png", 3)
    assert not coloured(before).any()
    assert coloured(found).mean() > 0.02
    assert coloured(side).mean() > 0.02


def test_a_photo_is_shown_instead_of_labels(tmp_path):
    photo = np.full((HEIGHT, WIDTH, 3), (200, 40, 40), np.uint8)
    plot_own_picture(tmp_path / "one.png", shown(person(garments={}), photo=photo))
    before, _, _ = cells(tmp_path / "one.png", 3)
    red = (before[..., 0] > 180) & (before[..., 1] < 60)
    assert red.mean() > 0.3


def test_garments_are_where_the_camera_sees_them(tmp_path):
    """On the left of the picture, if the person stands there."""
    photo = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    picture = replace(shown(person(-0.4)), photo=photo, labels=np.ones((HEIGHT, WIDTH), np.uint8))
    plot_own_picture(tmp_path / "one.png", picture)
    _, found, _ = cells(tmp_path / "one.png", 3)
    columns = np.nonzero(coloured(found))[1] / found.shape[1]
    assert columns.mean() < 0.45


def test_all_people_are_drawn_the_nearest_over_the_others(tmp_path):
    near = person(0.1)
    far_view = TO_CAMERA.copy()
    far_view[2, 3] = 5
    far = replace(
        person(0.1, garments={"Top": person(0.1).garments["Skirt"]}), world_to_camera=far_view
    )
    for order in ((near, far), (far, near)):
        plot_own_picture(tmp_path / "one.png", shown(*order))
        _, found, _ = cells(tmp_path / "one.png", 3)
        middle = found[found.shape[0] // 2, found.shape[1] // 2 - 8 : found.shape[1] // 2 + 8]
        skirt = np.array(garment_colour("Skirt"))
        top = np.array(garment_colour("Top"))
        mean = middle.mean(axis=0) / 255
        assert np.abs(mean - skirt).sum() < np.abs(mean - top).sum()


def test_the_truth_stands_beside_what_was_found(tmp_path):
    true = {"Skirt": person().garments["Skirt"]}
    pictures = [shown(person(garments={}, true=true)), shown(person(garments=true, true={}))]
    plot_known_pictures(tmp_path / "all.png", pictures)
    image = np.asarray(Image.open(tmp_path / "all.png").convert("RGB")).astype(int)
    drawn = coloured(image[:, image.shape[1] // 12 :])
    first, second = np.array_split(drawn, 2)

    def shares(row):
        return [cell.mean() for cell in np.array_split(row, 5, axis=1)]

    none_found, all_found = shares(first), shares(second)
    # segmentation, found, simulated, found from the side, simulated from the side
    for row, empty, full in ((none_found, (1, 3), (2, 4)), (all_found, (2, 4), (1, 3))):
        for one, other in zip(empty, full, strict=True):
            assert row[other] > max(0.02, 3 * row[one])
