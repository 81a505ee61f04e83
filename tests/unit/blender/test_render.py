"""Image modalities of a sample, checked against where its vertices are."""

import json

import numpy as np
import pytest
from PIL import Image

from drapeline.blender import render
from drapeline.blender.render import render_modalities
from drapeline.dataset.reader import Sample
from drapeline.errors import InputError
from drapeline.rendering.camera import Camera
from toys.tiny_sample import write_tiny_sample


@pytest.fixture(scope="module")
def rendered(toy_body, tmp_path_factory):
    folder = tmp_path_factory.mktemp("modalities")
    tiny = write_tiny_sample(folder, toy_body)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(render, "_SAMPLES", 2)  # noise does not matter here, and takes long to avoid
        render_modalities(tiny.folder, folder / "images", [2])
    return tiny.folder, folder / "images"


def test_stored_camera_takes_vertices_to_their_pixels(rendered):
    folder, images = rendered
    about = json.loads((images / "camera.json").read_text())
    camera = Camera(
        np.array(about["intrinsics"]), np.array(about["frames"]["2"]["world_to_camera"]), 640, 480
    )
    assert about["intrinsics"][0][0] == pytest.approx(888.889, abs=1e-3)
    with np.load(images / "2.npz") as archive:
        seen = dict(archive)
    label = {name: int(k) for k, name in about["segments"].items()}["Skirt"]
    with Sample(folder) as sequence:
        where, depth = camera.project(sequence.vertices("Skirt", 2, 3)[0])
    rows, columns = np.nonzero(seen["segments"] == label)
    assert columns.min() >= where[:, 0].min() - 1
    assert columns.max() <= where[:, 0].max() + 1
    assert rows.max() <= where[:, 1].max() + 1
    found = seen["depth"][seen["segments"] == label]
    assert depth.min() - 1e-3 <= found.min()
    assert found.max() <= depth.max() + 1e-3


def test_colour_shows_the_sample_where_rays_hit_it(rendered):
    _, images = rendered
    with Image.open(images / "2_rgb.png") as image:
        colour = np.asarray(image.convert("RGB"), dtype=float)
    with np.load(images / "2.npz") as archive:
        segments = archive["segments"]
    assert colour.shape == (480, 640, 3)
    cloth = np.isin(segments, [2, 3])
    blueness = colour[..., 2] - colour[..., 0]  # tiny samples wear light blue
    assert np.median(blueness[cloth]) > 40
    assert np.median(blueness[segments == 0]) < 25


def test_depth_png_holds_millimetres(rendered):
    _, images = rendered
    with Image.open(images / "2_depth.png") as image, np.load(images / "2.npz") as archive:
        np.testing.assert_allclose(np.asarray(image) / 1000, archive["depth"], atol=6e-4)


def test_a_frame_beyond_the_sequence_is_named_and_nothing_left(rendered, tmp_path):
    with pytest.raises(InputError, match="frame 99, expected 0 to 5"):
        render_modalities(rendered[0], tmp_path / "images", [0, 99])
    assert not list(tmp_path.iterdir())


def test_segment_png_holds_the_numbers(rendered):
    _, images = rendered
    with Image.open(images / "2_segments.png") as image, np.load(images / "2.npz") as archive:
        np.testing.assert_array_equal(np.asarray(image), archive["segments"])
