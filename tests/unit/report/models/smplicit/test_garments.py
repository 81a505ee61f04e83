"""Sheets of a gallery: what they show, not that there are any."""

import numpy as np
import pytest
from PIL import Image

from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import GalleryGarment, WornGarment
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.smplicit.figures import animate_clip, plot_clip, plot_gallery
from toys.views import TUBE, coloured

NOTHING = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))


def shown(row, column, mesh=TUBE, caption=""):
    wearer = Mesh(0.5 * TUBE.vertices, TUBE.faces)
    return GalleryGarment("samples", row, column, caption, "Skirt", mesh, wearer)


def picture(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


@pytest.fixture(autouse=True)
def few_rays():
    with ray_share(0.02):
        yield


def test_rows_and_columns_are_places_of_garments(tmp_path):
    empty = [shown("first", "a", NOTHING), shown("first", "b")]
    plot_gallery(
        tmp_path / "one.png", [*empty, shown("second", "a"), shown("second", "b", NOTHING)]
    )
    drawn = coloured(picture(tmp_path / "one.png"))
    height, width = drawn.shape
    quarter = {
        (row, column): drawn[
            row * height // 2 : (row + 1) * height // 2,
            column * width // 2 : (column + 1) * width // 2,
        ].mean()
        for row in (0, 1)
        for column in (0, 1)
    }
    assert min(quarter[0, 1], quarter[1, 0]) > 5 * max(quarter[0, 0], quarter[1, 1])


def test_all_garments_are_within_the_pictures(tmp_path):
    """The picture's borders show nothing of the largest garment."""
    large = Mesh(1.5 * TUBE.vertices + [0, 0, 3], TUBE.faces)
    plot_gallery(tmp_path / "one.png", [shown("", "", large)])
    drawn = coloured(picture(tmp_path / "one.png"))
    assert drawn.any()
    assert not drawn[:, :8].any()
    assert not drawn[:, -8:].any()
    assert not drawn[-8:].any()


def test_captions_stand_below_pictures(tmp_path):
    plot_gallery(tmp_path / "with.png", [shown("", "", caption="12 mm")])
    plot_gallery(tmp_path / "without.png", [shown("", "")])
    with_, without = (picture(tmp_path / f"{name}.png") for name in ("with", "without"))
    assert len(with_) - len(without) == 24
    assert (with_[-30:-6] < 120).any()


def test_an_empty_sheet_says_so(tmp_path):
    plot_gallery(tmp_path / "none.png", [])
    assert (picture(tmp_path / "none.png") < 120).any()


def test_a_clip_has_a_row_for_each_way_and_a_picture_for_each_frame(tmp_path):
    frames = [
        WornGarment("Skirt", TUBE, Mesh(0.5 * TUBE.vertices, TUBE.faces), REST_POSE[:3])
        for _ in range(3)
    ]
    plot_clip(tmp_path / "clip.png", {"one": frames, "other": frames})
    one = picture(tmp_path / "clip.png")
    plot_clip(tmp_path / "less.png", {"one": frames[:2]})
    less = picture(tmp_path / "less.png")
    assert one.shape[1] - less.shape[1] == pytest.approx(236, abs=40)
    assert one.shape[0] == 2 * less.shape[0] - 6


def test_every_second_frame_moves(tmp_path):
    frames = [
        WornGarment(
            "Skirt",
            Mesh(TUBE.vertices + [0.02 * step, 0, 0], TUBE.faces),
            Mesh(0.5 * TUBE.vertices, TUBE.faces),
            REST_POSE[:3],
        )
        for step in range(6)
    ]
    animate_clip(tmp_path / "moving.png", frames)
    with Image.open(tmp_path / "moving.png") as moving:
        assert moving.n_frames == 3
        moving.seek(1)
        assert moving.info["duration"] == pytest.approx(1000 * 2 / 30, abs=1)
