"""Image modalities of a sample, checked against where its vertices are."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from drapeline.blender import render
from drapeline.blender.render import render_modalities
from drapeline.dataset.reader import Sample
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.rendering.camera import Camera
from toys.tiny_sample import write_tiny_sample


@pytest.fixture(scope="module")
def rendered(toy_body, tmp_path_factory):
    folder = tmp_path_factory.mktemp("modalities")
    tiny = write_tiny_sample(folder, toy_body)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(render, "_SAMPLES", 2)  # noise does not matter here, and takes long to avoid
        bodies = dict.fromkeys(GENDERS, toy_body)
        render_modalities(tiny.folder, folder / "images", [2, 5], bodies=bodies, cameras=2)
    return tiny.folder, folder / "images"


def stored_camera(images, name):
    about = json.loads((images / "camera.json").read_text())
    pose = np.array(about["frames"][name]["world_to_camera"])
    return Camera(np.array(about["intrinsics"]), pose, 640, 480)


def arrays(images, name):
    with np.load(images / f"{name}.npz") as archive:
        return dict(archive)


def seen_segments(images):
    """Largest height and width of a person in all pictures, in pixels."""
    spans = []
    for path in images.glob("*.npz"):
        rows, columns = np.nonzero(arrays(images, path.stem)["segments"])
        spans.append((np.ptp(rows) + 1, np.ptp(columns) + 1))
    return np.max(spans, axis=0)


def test_stored_camera_takes_vertices_to_their_pixels(rendered):
    folder, images = rendered
    about = json.loads((images / "camera.json").read_text())
    camera = Camera(
        np.array(about["intrinsics"]), np.array(about["frames"]["2"]["world_to_camera"]), 640, 480
    )
    people = seen_segments(images)
    assert people[0] > 0.8 * 480 or people[1] > 0.8 * 640
    assert people[0] <= 0.9 * 480
    assert people[1] <= 0.9 * 640
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
        render_modalities(rendered[0], tmp_path / "images", [0, 99], bodies={})
    assert not list(tmp_path.iterdir())


def test_flow_takes_visible_vertices_to_their_pixels_in_the_next_frame(rendered):
    folder, images = rendered
    camera, seen = stored_camera(images, "2"), arrays(images, "2")
    with Sample(folder) as sequence:
        now, then = sequence.vertices("Skirt", 2, 4).astype(float)
        root, next_root = sequence.root_positions(2, 4)
    extrinsics = camera.world_to_camera.copy()
    extrinsics[:3, 3] -= camera.axes @ ([1, 1, 0] * (next_root - root))  # it follows the root joint
    places, depth = camera.project(now)
    moved = replace(camera, world_to_camera=extrinsics).project(then)[0] - places
    column, row = places.astype(int).T
    visible = np.abs(seen["depth"][row, column] - depth) < 2e-3
    assert visible.sum() > 5
    found = seen["flow"][row, column][visible]
    np.testing.assert_allclose(found, moved[visible], atol=0.3)
    assert np.abs(found).max() > 1
    assert "flow" not in arrays(images, "5")  # the last frame


def test_a_second_camera_sees_the_person_from_behind(rendered):
    folder, images = rendered
    first, second = (stored_camera(images, name) for name in ("2", "2_camera1"))
    np.testing.assert_allclose(first.axes[2], -second.axes[2], atol=1e-12)
    with Sample(folder) as sequence:
        [root] = sequence.root_positions(2, 3)
    np.testing.assert_allclose((first.position + second.position)[:2] / 2, root[:2], atol=1e-9)
    assert (images / "2_camera1_rgb.png").is_file()


def test_keypoints_are_the_joints_and_boxes_hold_the_segments(rendered, toy_body):
    folder, images = rendered
    coco = json.loads((images / "coco.json").read_text())
    assert [image["file_name"] for image in coco["images"]] == [
        *("2_rgb.png", "2_camera1_rgb.png", "5_rgb.png", "5_camera1_rgb.png"),
    ]
    with Sample(folder, bodies=dict.fromkeys(GENDERS, toy_body)) as sequence:
        [joints] = sequence.joints(2, 3)
    person, *garments = (one for one in coco["annotations"] if one["image_id"] == 1)
    np.testing.assert_allclose(person["keypoints_3d"], joints, atol=1e-6)
    points = np.array(person["keypoints"]).reshape(24, 3)
    places, _ = stored_camera(images, "2").project(joints.astype(float))
    labelled = points[:, 2] > 0
    assert person["num_keypoints"] == labelled.sum() > 12
    np.testing.assert_allclose(points[labelled, :2], places[labelled], atol=0.01)
    names = {one["id"]: one["name"] for one in coco["categories"]}
    assert [names[one["category_id"]] for one in garments] == ["Tshirt", "Skirt"]
    segments = arrays(images, "2")["segments"]
    about = json.loads((images / "camera.json").read_text())
    number_of = {name: int(number) for number, name in about["segments"].items()}
    for one in (person, *garments):
        name = names[one["category_id"]]
        mask = segments > 0 if one is person else segments == number_of[name]
        x, y, width, height = one["bbox"]
        assert mask.sum() == mask[y : y + height, x : x + width].sum() == one["area"]
        assert mask[y].any()
        assert mask[:, x + width - 1].any()


def test_segment_png_holds_the_numbers(rendered):
    _, images = rendered
    with Image.open(images / "2_segments.png") as image, np.load(images / "2.npz") as archive:
        np.testing.assert_array_equal(np.asarray(image), archive["segments"])
