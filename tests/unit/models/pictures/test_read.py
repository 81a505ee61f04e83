import json

import numpy as np
import pytest
from PIL import Image

from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.models.pictures.read import (
    CLASSES,
    GARMENT_CLASSES,
    LABELS,
    class_of_garment,
    read_picture,
    weak_perspective,
)
from drapeline.outfits.garment_types import GARMENT_TYPES
from toys.smplicit import toy_bodies

SIZE = (80, 60)  # width and height
TO_CAMERA = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 2.5], [0, 0, 0, 1]]


@pytest.fixture
def given():
    return {
        "segmentation": "labels.png",
        "labels": "lip",
        "camera": {"focal_px": 70.0, "world_to_camera": TO_CAMERA},
        "people": [
            {
                "gender": "female",
                "shape": [0.0] * 10,
                "pose": REST_POSE.tolist(),
                "trans": [0.0, 0.0, 0.0],
            }
        ],
    }


@pytest.fixture
def read(tmp_path, toy_body):
    def read(given, labels=None):
        values = np.zeros(SIZE[::-1], np.uint8)
        values[20:40, 30:50] = 12  # a skirt
        values[5:18, 30:50] = 5  # an upper garment
        Image.fromarray(values if labels is None else labels).save(tmp_path / "labels.png")
        (tmp_path / "street.json").write_text(json.dumps(given))
        return read_picture(tmp_path / "street.json", toy_bodies(toy_body), least_px=50)

    return read


def test_a_picture_is_read(read, given):
    picture = read(given)
    (person,) = picture.people
    assert picture.name == "street"
    assert person.garments == ("skirt", "upper")
    assert picture.shows(person, "skirt").sum() == 400
    # What is worn over the skirt hides it; the skirt tells about what is over it.
    assert picture.unsure(person, "skirt").sum() == 13 * 20
    assert picture.unsure(person, "upper").sum() == 0
    assert person.camera.intrinsics[0, 0] == 70
    assert person.camera.intrinsics[:2, 2].tolist() == [40, 30]


def test_labels_of_public_networks_are_known_classes():
    for table in LABELS.values():
        assert set(table.values()) <= set(CLASSES)
        assert {"upper", "trousers", "skirt", "dress"} <= set(table.values())
    assert set(GARMENT_CLASSES) <= set(CLASSES)


def test_small_garments_are_left_out_unless_asked_for(read, given):
    labels = np.zeros(SIZE[::-1], np.uint8)
    labels[20:40, 30:50], labels[0, :5] = 12, 5
    assert read(given, labels).people[0].garments == ("skirt",)
    given["people"][0]["garments"] = ["upper"]
    assert read(given, labels).people[0].garments == ("upper",)


def test_other_people_are_told_apart(tmp_path, read, given):
    numbers = np.zeros(SIZE[::-1], np.uint8)
    numbers[:, :40], numbers[:, 40:] = 1, 2
    Image.fromarray(numbers).save(tmp_path / "people.png")
    given["instances"] = "people.png"
    one = given["people"][0]
    given["people"] = [{**one, "instance": 1}, {**one, "instance": 2}]
    picture = read(given)
    for index, person in enumerate(picture.people):
        shown = picture.shows(person, "skirt")
        assert shown.sum() == 200
        assert shown[:, 40:].any() == bool(index)


def test_a_weak_perspective_is_a_picture_from_far_away():
    camera = weak_perspective((0.9, 0.1, -0.2), (10.0, 20.0), 0.5, (640, 480))
    points = np.random.default_rng(0).normal(scale=0.5, size=(20, 3))
    found, _ = camera.project(points)
    expected = 112 * (0.9 * points[:, :2] + [0.1, -0.2] + 1) / 0.5 + [10, 20]
    np.testing.assert_allclose(found, expected, atol=1.0)


def wrong(given, **changes):
    person = given["people"][0]
    for key, value in changes.items():
        target = given if key in ("labels", "camera", "people", "segmentation") else person
        target[key] = value
    return given


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"labels": "other"}, "'labels' is 'other', expected lip, cihp, atr or a table"),
        ({"labels": {"12": "hat"}}, "'labels' has '12': 'hat'"),
        ({"labels": {}}, "'labels' is {}, expected lip, cihp, atr or a table"),
        ({"labels": {"0": "background"}}, "the segmentation, .*, has the labels 5, 12"),
        ({"camera": {"centre_px": [1, 2]}}, "the camera's 'focal_px' is None"),
        ({"camera": None}, "there is no 'camera'"),
        ({"people": []}, "'people' is empty or missing"),
        ({"segmentation": "nowhere.png"}, r"nowhere\.png: no such file"),
        ({"gender": "other"}, "person 1: 'gender' is 'other'"),
        ({"shape": [0.0]}, "'shape' is missing or wrong, expected 10 finite numbers"),
        ({"pose": [0.0] * 71}, "'pose' is missing or wrong"),
        ({"trans": [9.0, 0, 0]}, "outside the picture of 80 x 60 pixels"),
        ({"trans": [0, -9.0, 0]}, "the body is behind the camera"),
        ({"garments": ["dress"]}, "'garments' has 'dress', but no pixel"),
        ({"garments": ["hat"]}, "'garments' has 'hat', expected some of"),
        ({"garments": "upper"}, "'garments' is 'upper', expected a list of classes"),
        ({"garments": 5}, "'garments' is 5, expected a list of classes"),
        ({"garments": [["upper"]]}, "'garments' is .*, expected a list of classes"),
    ],
)
def test_wrong_entries_are_named(read, given, changes, message):
    with pytest.raises(InputError, match=message):
        read(wrong(given, **changes))


@pytest.mark.parametrize("key", ["photo", "instances"])
def test_images_of_another_size_than_the_segmentation_are_named(read, given, tmp_path, key):
    Image.fromarray(np.ones((30, 40), np.uint8)).save(tmp_path / "small.png")
    with pytest.raises(InputError, match=r"small\.png, has 40 x 30 pixels, expected 80 x 60"):
        read({**given, key: "small.png"})


def test_every_garment_type_has_a_class():
    classes = {garment: class_of_garment(garment) for garment in GARMENT_TYPES}
    assert classes == {
        "Tshirt": "upper",
        "Top": "upper",
        "Trousers": "trousers",
        "Skirt": "skirt",
        "Jumpsuit": "jumpsuit",
        "Dress": "dress",
        "Jacket": "coat",
    }


def test_a_mask_that_is_cut_out_is_where_it_is_opaque(read, given, tmp_path):
    cut_out = np.full((*SIZE[::-1], 4), 200, np.uint8)
    cut_out[..., 3] = 0
    cut_out[20:40, 30:50, 3] = 255
    Image.fromarray(cut_out).save(tmp_path / "me.png")
    given["people"][0] |= {"mask": "me.png"}
    given["people"].append(given["people"][0])
    one, _ = read(given).people
    assert one.garments == ("skirt",)


def test_an_opaque_mask_is_where_it_has_a_colour(read, given, tmp_path):
    mask = np.zeros((*SIZE[::-1], 4), np.uint8)
    mask[20:40, 30:50, :3] = 255
    mask[..., 3] = 255
    Image.fromarray(mask).save(tmp_path / "me.png")
    given["people"][0] |= {"mask": "me.png"}
    given["people"].append(given["people"][0])
    one, _ = read(given).people
    assert one.garments == ("skirt",)


@pytest.mark.parametrize("key", ["segmentation", "instances"])
def test_labels_of_a_lossy_image_are_refused(read, given, tmp_path, key):
    Image.fromarray(np.ones(SIZE[::-1], np.uint8)).save(tmp_path / "lossy.jpg")
    given[key] = "lossy.jpg"
    with pytest.raises(InputError, match=f"'{key}' is lossy.jpg, a JPEG, .*expected a PNG"):
        read(given)


def test_instances_in_colours_are_refused(read, given, tmp_path):
    Image.fromarray(np.ones((*SIZE[::-1], 3), np.uint8)).save(tmp_path / "people.png")
    given["instances"] = "people.png"
    with pytest.raises(InputError, match="people.png, has colours, expected one number per pixel"):
        read(given)
