import numpy as np
import pytest

from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.models.smplicit.scans.points import cloud_distances, field_points
from drapeline.outfits.garment_types import BODY, LABELS

SKIRT, TROUSERS, SKIN = (LABELS.index(name) for name in ("Skirt", "Trousers", BODY))
BODY_STATE = BodyState.of(REST_POSE, np.zeros(3), np.zeros(10))


def plane(count, size=0.5, seed=0):
    """(count, 3) random points of the square at z = 0."""
    points = np.random.default_rng(seed).uniform(-size, size, (count, 3))
    points[:, 2] = 0
    return points


def scan(garments, **points):
    labels = np.repeat(
        [SKIN if name == "skin" else LABELS.index(name) for name in points],
        [len(part) for part in points.values()],
    )
    every = np.concatenate([*points.values()]).astype(np.float32)
    return SegmentedScan(
        "s", 0, every, labels.astype(np.uint8), garments, "female", BODY_STATE, None
    )


def look(shown, garment, cloth=50, around=60):
    rng = np.random.default_rng(0)
    # Below everything, and upright.
    body = np.array([[0.0, 0, -0.1]]), np.array([[0.0, 0, 1.0]])
    return field_points(
        shown, garment, body, rng, cloth=cloth, around=around, spread_m=0.01, uncovered_weight=3
    )


def test_between_the_points_of_a_cloud_its_plane_goes_on():
    points = plane(200, size=0.4, seed=1) + [0, 0, 0.05]
    found = cloud_distances(points, plane(4000))
    np.testing.assert_allclose(found, 0.05, atol=1e-9)


def test_beyond_a_cloud_distances_grow():
    points = np.array([[1.0, 0, 0], [0, 2.0, 0]])
    found = cloud_distances(points, plane(20_000))
    np.testing.assert_allclose(found, [0.5, 1.5], atol=0.03)


def test_fields_are_zero_at_the_garment_and_known_beside_it():
    own, skin = plane(500), plane(500) - [0, 0, 0.14]
    points = look(scan(("Skirt",), skin=skin, Skirt=own), "Skirt", 100, 90)
    assert len(points.places) == 190
    assert not points.distance_m[:100].any()
    np.testing.assert_allclose(points.places[:100, 2], 0, atol=1e-7)
    above = points.places[130:]
    assert len(above) == 60
    assert above[:, 2].min() > -0.14
    assert above[:, 2].max() < 0.11
    np.testing.assert_allclose(points.distance_m[130:], np.abs(above[:, 2]), atol=0.03)
    space = points.places[100:130]
    np.testing.assert_allclose(points.distance_m[100:130], np.abs(space[:, 2]), atol=0.03)
    np.testing.assert_array_equal(points.weight, np.repeat([1, 3], [130, 60]))


def test_what_covers_the_garment_tells_nothing():
    cover = plane(300) + [0, 0, 0.2]
    shown = scan(("Trousers", "Skirt"), Trousers=plane(300), Skirt=cover)
    points = look(shown, "Trousers")
    assert points.places[:, 2].max() < 0.1
    outer = look(shown, "Skirt")
    lifted = outer.places[-20:]
    assert lifted[:, 2].min() >= 0
    assert lifted[:, 2].max() <= 0.25
    np.testing.assert_allclose(outer.distance_m[-20:], np.abs(lifted[:, 2] - 0.2), atol=0.05)


def test_too_few_points_are_refused():
    shown = scan(("Skirt",), skin=plane(100), Skirt=plane(20))
    with pytest.raises(InputError, match="20 points are labelled as Skirt, expected at least 50"):
        look(shown, "Skirt")
