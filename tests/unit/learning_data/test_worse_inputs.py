"""Clouds and bodies that are made worse: what becomes of points, labels and parameters."""

import numpy as np
import pytest

from drapeline.learning_data.worse_inputs import worse_body, worse_clouds
from drapeline.seeding import rng_for

FRAMES, POINTS = 3, 400
# Enough sequences for each kind of worse clouds to be among them.
NUMBERS = range(12)


@pytest.fixture(scope="module")
def clouds():
    """Points on a ball in another order in every frame, and labels that tell which is which."""
    ball = rng_for(0, "ball").normal(size=(POINTS, 3))
    ball *= 0.5 / np.linalg.norm(ball, axis=1, keepdims=True)
    order = np.stack([rng_for(0, "order", frame).permutation(POINTS) for frame in range(FRAMES)])
    return ball[order].astype(np.float32), order.astype(np.uint16)


def worse(clouds, number):
    return worse_clouds(*clouds, rng_for(0, "worse", number))


def places(clouds, labels):
    """Where points of these labels were."""
    points, order = clouds
    return np.stack(
        [p[np.argsort(o)][own] for p, o, own in zip(points, order, labels, strict=True)]
    )


def test_points_are_some_of_the_cloud_with_their_labels_and_a_little_noise(clouds):
    spread = []
    for number in NUMBERS:
        points, labels = worse(clouds, number)
        assert (points.shape, points.dtype) == (clouds[0].shape, np.float32)
        assert (labels.shape, labels.dtype) == (clouds[1].shape, clouds[1].dtype)
        away = points - places(clouds, labels)
        assert np.abs(away.mean(axis=(0, 1))).max() < 0.003
        spread.append(away.std())
    # The noise is a sequence's own, of at most two centimetres.
    assert max(spread) < 0.0205
    assert len({round(each, 5) for each in spread}) == len(spread)
    assert max(spread) > 2 * min(spread)


def kept_share(clouds, number):
    """Of the points of a cloud, in each frame."""
    _, labels = worse(clouds, number)
    return np.array([len(np.unique(frame)) / POINTS for frame in labels])


def test_some_sequences_lose_nothing_and_some_much(clouds):
    kept = np.array([kept_share(clouds, number) for number in NUMBERS])
    whole = (kept == 1).all(axis=1)
    assert whole.any()
    assert (kept[~whole] < 1).all()
    assert kept[~whole].min() < 0.6
    for number in np.flatnonzero(whole):  # in their order, too
        np.testing.assert_array_equal(worse(clouds, number)[1], clouds[1])


def test_what_holes_take_is_as_much_in_every_frame_and_elsewhere(clouds):
    """Of few cameras, what one sees of a ball is the same side in every frame."""
    sides, holes = 0, 0
    for number in NUMBERS:
        _, labels = worse(clouds, number)
        kept = [np.unique(frame) for frame in labels]
        if len(kept[0]) == POINTS:
            continue
        if all(np.array_equal(one, kept[0]) for one in kept):
            sides += 1
        else:
            holes += 1
            assert len({len(one) for one in kept}) == 1
    assert sides > 0
    assert holes > 0


def test_worse_clouds_are_those_of_the_generator_and_leave_the_cloud_alone(clouds):
    before = [each.copy() for each in clouds]
    for number in NUMBERS:
        first, second = worse(clouds, number), worse(clouds, number)
        for one, other in zip(first, second, strict=True):
            np.testing.assert_array_equal(one, other)
    for one, other in zip(clouds, before, strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.array_equal(worse(clouds, 0)[0], worse(clouds, 1)[0])


def test_a_body_is_off_by_the_same_in_all_frames():
    rng = rng_for(0, "body")
    shape, poses = rng.normal(size=10), rng.normal(size=(5, 72))
    points = rng.normal(size=(5, 20, 3))
    found = worse_body(shape, poses, points, rng_for(1, "body"))
    for one, given in zip(found, (shape, poses, points), strict=True):
        assert one.shape == given.shape
    off_shape, off_poses, off_points = (
        one - given for one, given in zip(found, (shape, poses, points), strict=True)
    )
    np.testing.assert_allclose(off_poses, np.broadcast_to(off_poses[:1], off_poses.shape))
    np.testing.assert_allclose(off_points, np.broadcast_to(off_points[0, 0], off_points.shape))
    for off in (off_shape, off_poses[0], off_points[0, 0]):
        assert np.abs(off).min() > 0


def test_bodies_are_off_by_shares_of_the_most():
    zero = np.zeros(10), np.zeros((1, 72)), np.zeros((1, 1, 3))
    found = [worse_body(*zero, rng_for(0, "body", number)) for number in range(60)]
    shape, poses, points = (np.concatenate([each[k].ravel() for each in found]) for k in range(3))
    # A share is between 0 and 1, so that the variance is a third of that of the most.
    for off, most in ((shape, 0.4), (poses, 0.04), (points, 0.01)):
        assert off.std() == pytest.approx(most / np.sqrt(3), rel=0.3)
    sizes = [each[1].std() for each in found]
    assert min(sizes) < 0.2 * max(sizes)
