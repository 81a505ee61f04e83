from dataclasses import replace

import numpy as np
import pytest
import torch

from drapeline.bodies.follow import pose_body
from drapeline.bodies.kinematics import mirror_poses
from drapeline.frames import REST_POSE
from drapeline.models.gcvae.pictures.views import (
    CHANNELS,
    PersonView,
    body_marks,
    cut_to_body,
    hide_parts,
    join_views,
    mirror_images,
    network_images,
    see_body,
    view_person,
)
from drapeline.models.pictures.known import camera_around, segment
from drapeline.models.pictures.read import BODY, CLASSES, UNKNOWN, Person, Picture
from drapeline.rendering.camera import look_at
from drapeline.seeding import rng_for
from toys.smplicit import tube

SKIRT, UPPER, TROUSERS = (CLASSES.index(name) for name in ("skirt", "upper", "trousers"))
SIZE = 48


def posed(body, pose=REST_POSE):
    return pose_body(body, np.zeros(10), pose, np.zeros(3))


def picture_of(body, camera, garments, others=None):
    """A picture of somebody in garments by class, taken by a camera."""
    classes = segment(body, garments, camera)
    nobody = np.zeros(classes.shape, bool) if others is None else others
    person = Person(
        "female", np.zeros(10), REST_POSE, np.zeros(3), camera, ~nobody, nobody, tuple(garments)
    )
    return Picture("street", classes, None, (person,))


def view(body, model, camera, garments, size=SIZE, others=None):
    picture = picture_of(body, camera, garments, others)
    return view_person(picture, picture.people[0], body, body_marks(model), size)


def test_marks_tell_segments_and_sides_apart(toy_body):
    marks = body_marks(toy_body)
    assert np.abs(marks).max() < 1
    for joint in np.unique(toy_body.segmentation):
        own = toy_body.segmentation == joint
        assert (marks[own] == marks[own][0]).all()
        # No other segment is alike, and one is on the other side.
        assert np.linalg.norm(marks[~own] - marks[own][0], axis=1).min() > 0.01
        opposite = np.linalg.norm(marks - marks[own][0] * [-1, 1, 1], axis=1)
        assert opposite.min() < 0.01


def test_a_cut_shows_the_whole_body_in_the_middle_at_any_size(toy_body):
    body = posed(toy_body)
    far = look_at(np.array([1.0, -9, 0.5]), np.array([2.0, 0, 0]), focal_px=900, size=(640, 400))
    for size in (32, 100):
        camera = cut_to_body(far, body.posed, size)
        image, depth = camera.project(body.posed)
        assert (depth > 0).all()
        assert image.min() > 0
        assert image.max() < size
        assert (image.max(axis=0) + image.min(axis=0)) / 2 == pytest.approx(size / 2)
        assert np.ptp(image, axis=0).max() > 0.8 * size
        # From where the picture was taken.
        assert camera.position == pytest.approx(far.position)


def test_a_view_shows_what_the_picture_shows(toy_body):
    body = posed(toy_body)
    garments = {"skirt": tube(0.3, -0.5, 0.0)}
    camera = camera_around(body.posed, REST_POSE, 20.0, 0.1, 8 * SIZE)
    seen = view(body, toy_body, camera, garments)
    exact = segment(body, garments, cut_to_body(camera, body.posed, SIZE))
    # Rays of a fine picture's pixels pass close to those of the view.
    within = seen.classes != CLASSES.index(UNKNOWN)
    assert within.mean() > 0.9
    assert (seen.classes == exact)[within].mean() > 0.97
    there = seen.body[..., 3] > 0
    assert there[seen.classes == CLASSES.index(BODY)].mean() > 0.95  # but along edges
    assert there[seen.classes == SKIRT].any()  # legs beneath the cloth
    assert not seen.body[~there].any()


def test_what_is_beyond_the_picture_or_of_others_is_unknown(toy_body):
    body = posed(toy_body)
    camera = camera_around(body.posed, REST_POSE, 0.0, 0.0, 100)
    half = replace(camera, height=50)
    seen = view(body, toy_body, half, {})
    unknown = seen.classes == CLASSES.index(UNKNOWN)
    assert unknown[-1].all()
    assert not unknown[0].any()
    assert (seen.body[-SIZE // 4 :, :, 3] > 0).any()  # where the body is known
    others = np.zeros((100, 100), bool)
    others[:50] = True
    assert (view(body, toy_body, camera, {}, others=others).classes[0] == 2).all()


def test_images_say_where_skin_the_garment_and_what_hides_it_are_seen():
    classes = np.array([[0, 1, 2], [TROUSERS, UPPER, SKIRT], [0, 0, 0]], np.uint8)
    views = join_views([PersonView(np.zeros((3, 3, 4), np.int8), classes)] * 2)
    images = network_images(views, np.array([SKIRT, UPPER]))
    assert images.shape == (2, CHANNELS, 3, 3)
    skin, garment, hidden = images[:, 4:7].transpose(1, 0, 2, 3)
    assert skin.sum(axis=(1, 2)).tolist() == [1, 1]
    assert np.argwhere(garment).tolist() == [[0, 1, 2], [1, 1, 1]]
    # An upper garment hides a skirt, not the other way; unknown things hide both.
    assert np.argwhere(hidden[0]).tolist() == [[0, 2], [1, 1]]
    assert np.argwhere(hidden[1]).tolist() == [[0, 2]]


@pytest.mark.portable
def test_the_picture_of_a_mirrored_person_is_the_mirrored_picture(toy_body):
    pose = REST_POSE.copy()
    pose[3 * 16 + 2] = -0.9  # an arm down
    pose[3 * 1] = 0.5  # a leg forwards
    garments = {"skirt": tube(0.3, -0.4, 0.0)}
    turned = mirror_poses(pose[None])[0]
    images = []
    for way, side in ((pose, 1.0), (turned, -1.0)):
        body = posed(toy_body, way)
        camera = look_at(
            np.array([side * 1.5, -4, 0.4]), np.zeros(3), focal_px=200, size=(200, 200)
        )
        seen = view(body, toy_body, camera, garments)
        images.append(network_images(join_views([seen]), np.array([SKIRT])))
    mirrored = mirror_images(torch.from_numpy(images[0])).numpy()
    assert not np.allclose(images[0], images[1])
    # But for rays along edges.
    assert (np.abs(mirrored - images[1]).max(axis=1) < 0.05).mean() > 0.97


def test_half_of_the_images_have_something_unknown_in_them():
    images = torch.rand(40, CHANNELS, 32, 32, generator=torch.Generator().manual_seed(0))
    before = images.clone()
    hidden = hide_parts(images, rng_for(0, "hidden"))
    assert torch.equal(images, before)
    changed = (hidden != images).flatten(1).any(1)
    assert 8 < changed.sum() < 32
    # The body is known all the same.
    assert torch.equal(hidden[:, :4], images[:, :4])
    for image, original in zip(hidden[changed], images[changed], strict=True):
        box = (image != original).any(0)
        rows, columns = torch.nonzero(box).T
        part = image[4:, rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        assert (part == torch.tensor([0.0, 0.0, 1.0])[:, None, None]).all()


def test_mirrored_twice_images_are_as_before():
    images = torch.rand(2, CHANNELS, 5, 5, generator=torch.Generator().manual_seed(0))
    assert torch.equal(mirror_images(mirror_images(images)), images)


def test_marks_are_seen_where_the_body_is(toy_body):
    body = posed(toy_body)
    camera = camera_around(body.posed, REST_POSE, 0.0, 0.0, SIZE)
    image = see_body(body, body_marks(toy_body), camera)
    rows, columns = np.nonzero(image[..., 3])
    # Head up, and the left arm on the right of a picture from the front.
    assert image[rows.min(), :, 2].max() > 60
    assert image[:, columns.max(), 0].max() > 60
