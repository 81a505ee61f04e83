import numpy as np
import pytest
import trimesh

from drapeline.bodies.model import posed_vertices
from drapeline.frames import FPS, REST_POSE
from drapeline.geometry.mesh import edges
from drapeline.geometry.moving_surface import MovingSurface
from drapeline.outfits.openings import WornOpenings
from drapeline.seeding import rng_for
from drapeline.simulation.health import (
    HealthGarment,
    HealthMonitor,
    contact_measures,
    inevitable_violations,
    stretch,
    summary,
    violations,
)
from drapeline.simulation.settings import HealthBounds
from toys.bodies import toy_body


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces).astype(np.int64)


def test_a_shell_outside_a_ball_keeps_its_gap(ball):
    vertices, faces = ball
    found = contact_measures(*MovingSurface(vertices, faces).locate(1.02 * vertices))
    assert found["inside_share"] == 0
    assert found["gap_p50_m"] == pytest.approx(0.02, abs=1e-3)
    assert found["depth_max_m"] == 0


def test_a_shell_inside_a_ball_is_all_inside_at_its_depth(ball):
    vertices, faces = ball
    found = contact_measures(*MovingSurface(vertices, faces).locate(0.97 * vertices))
    assert found["inside_share"] == 1
    assert found["depth_mean_m"] == pytest.approx(0.03, abs=2e-3)


def test_half_a_shell_inside(ball):
    vertices, faces = ball
    scale = np.where(vertices[:, :1] > 0, 1.1, 0.9)
    expected = (vertices[:, 0] <= 0).mean()
    found = contact_measures(*MovingSurface(vertices, faces).locate(scale * vertices))
    assert found["inside_share"] == expected


def test_stretch_of_a_scaled_cloth(ball):
    vertices, faces = ball
    pairs = edges(faces)
    rest = np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)
    found = stretch(1.3 * vertices, pairs, rest)
    assert list(found.values()) == pytest.approx([1.3, 1.3, 1.3])


def test_edges_that_are_not_watched_may_stretch(ball):
    vertices, faces = ball
    pairs = edges(faces)
    moved = np.zeros(len(vertices), dtype=bool)
    moved[:100] = True
    cloth = np.where(moved[:, None], 5, 1.3) * vertices
    rest = np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)
    rest[moved[pairs].any(axis=1)] = np.nan
    row = HealthMonitor([HealthGarment("Top", faces, rest)], faces).add([cloth], vertices)
    assert row["stretch_p01"] + row["stretch_p99"] == pytest.approx([1.3, 1.3])


def test_stretch_tells_the_hundredth_edge_from_either_end():
    lengths = np.linspace(0.5, 1.5, 1001)
    start = np.arange(1001)[:, None] * [1.0, 0, 0]
    cloth = np.concatenate([start, start + lengths[:, None] * [0, 1.0, 0]])
    pairs = np.arange(1001)[:, None] + [0, 1001]
    found = stretch(cloth, pairs, np.ones(1001))
    assert list(found.values()) == pytest.approx([0.51, 1.0, 1.49])


def test_an_outer_layer_beneath_the_inner_one_is_measured(ball):
    vertices, faces = ball
    garment = HealthGarment("Top", faces, np.ones(len(edges(faces))))
    monitor = HealthMonitor([garment, garment], faces)
    outer = np.where(vertices[:, :1] > 0, 1.02, 1.04) * vertices
    monitor.add([1.03 * vertices, outer], vertices)
    assert monitor.arrays()["layer_share"][0] == pytest.approx([0, 0.5], abs=0.05)


def watch(ball, cloths):
    vertices, faces = ball
    pairs = edges(faces)
    rest = np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)
    monitor = HealthMonitor([HealthGarment("Top", faces, rest)], faces)
    for cloth in cloths:
        monitor.add([cloth], vertices)
    return monitor.arrays()


def test_accelerating_cloth_is_measured(ball):
    vertices, _ = ball
    shift = np.array([0.3, 0, 0])
    arrays = watch(ball, [1.02 * vertices + 0.5 * shift * (k / FPS) ** 2 for k in range(5)])
    found = arrays["acceleration_m_s2"][:, 0]
    assert np.isnan(found[[0, -1]]).all()
    assert found[1:-1] == pytest.approx(np.full(3, 0.3), rel=1e-3)


def test_slipping_cloth_is_measured(ball):
    vertices, _ = ball
    arrays = watch(ball, [1.02 * vertices + [0, 0, -0.05 * k] for k in range(3)])
    assert arrays["slip_m"][:, 0] == pytest.approx([0, 0.05, 0.1], abs=1e-6)


def test_openings_that_lose_their_limb_are_counted(ball):
    """A tube around the hips and one leg, pulled over the feet in half of the frames."""
    vertices, faces = ball
    rim = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    hoop = np.stack([0.4 * np.cos(rim), 0.4 * np.sin(rim), np.zeros(20)], axis=1)
    tube = np.concatenate([hoop + [0, 0, 0.08], 0.3 * hoop + [0.085, 0, -0.3]])
    first, second = np.arange(20), np.roll(np.arange(20), -1)
    quads = np.stack([first, second, second + 20, first + 20], axis=1)
    joints = posed_vertices(toy_body(), np.zeros(10), REST_POSE[None])[1][0]
    openings = WornOpenings.at_rest(tube, quads, joints)
    garment = HealthGarment("Skirt", quads, np.ones(len(edges(quads))), openings)
    monitor = HealthMonitor([garment], faces)
    for move in (0.0, 0.1, -1.5, -1.6):
        monitor.add([tube + [0, 0, move]], vertices, joints=joints)
    arrays = monitor.arrays()
    assert arrays["lost_openings"][:, 0].tolist() == [0, 0, 2, 2]
    assert summary(arrays)["lost_openings"] == 1
    found = violations({"lost_openings": 1}, HealthBounds())
    assert found == ["lost_openings 1, expected at most 0.25"]


def test_a_sample_is_as_good_as_its_worst_garment():
    """Two garments, of which the second has twice all measures of the first."""
    one = np.linspace(0.1, 0.4, 4)
    names = (
        "inside_share",
        "inside_open_share",
        "depth_max_m",
        "depth_open_m",
        "stretch_p01",
        "stretch_p99",
        "slip_m",
        "layer_share",
    )
    names += (
        "self_share",
        "self_crossings",
        "layer_crossings",
        "acceleration_m_s2",
        "settling_m_s",
        "gap_p05_m",
    )
    found = summary({name: np.stack([one, 2 * one], axis=1) for name in names})
    least = {name: found.pop(name) for name in ("stretch_low", "gap_p05_m")}
    assert least == {"stretch_low": pytest.approx(0.25), "gap_p05_m": pytest.approx(0.25)}
    highest = ("inside_open_max", "slip_m", "self_crossings_max", "layer_crossings_max")
    largest = {name: found.pop(name) for name in highest}
    assert largest == dict.fromkeys(highest, pytest.approx(0.8))
    assert found.pop("depth_m") == pytest.approx(2 * np.percentile(one, 95))
    assert found == dict.fromkeys(found, pytest.approx(0.5))


def test_only_what_is_out_of_bounds_is_named(ball):
    vertices, _ = ball
    good = summary(watch(ball, [1.02 * vertices] * 3))
    assert violations(good, HealthBounds()) == []
    bad = summary(watch(ball, [0.98 * vertices] * 3))
    (reason, *others) = violations(bad, HealthBounds())
    assert reason == "inside_open_mean 1, expected at most 0.006"
    assert [o.split()[0] for o in others] == ["inside_open_max"]


def test_a_value_that_is_not_a_number_is_violations(ball):
    measures = summary(watch(ball, [1.02 * ball[0]] * 3)) | {"slip_m": float("nan")}
    assert len(violations(measures, HealthBounds())) == 1


def test_what_cannot_come_right_is_told_early_and_agrees_with_the_end():
    frames = 20
    rng = rng_for(5, "health")
    names = ("inside_open_share", "depth_open_m", "slip_m", "layer_share", "lost_openings")
    values = {name: rng.random((frames, 2)).astype(np.float32) for name in names}
    bounds = HealthBounds(
        inside_open_mean=0.3,
        inside_open_max=1,
        depth_m=0.5,
        slip_m=2,
        layer_share_mean=1,
        lost_openings=1,
    )
    told = [
        bool(inevitable_violations({k: v[:n] for k, v in values.items()}, bounds, frames))
        for n in range(1, frames + 1)
    ]
    assert not told[0]
    assert told[-1]
    assert told == sorted(told)
    worst = values["inside_open_share"].mean(axis=0).max()
    assert worst > bounds.inside_open_mean


def test_how_fast_cloth_settles_is_told_of_the_first_frame(ball):
    vertices, faces = ball
    rest = np.full(len(edges(faces)), 0.2)
    monitor = HealthMonitor([HealthGarment("Top", faces, rest)], faces)
    monitor.add([1.02 * vertices], vertices, [1.02 * vertices + [0, 0, 0.001]])
    monitor.add([1.5 * vertices], vertices)
    assert monitor.arrays()["settling_m_s"][:, 0] == pytest.approx([0.03, np.nan], nan_ok=True)


def test_what_is_inside_in_folds_of_the_body_counts_apart(ball):
    """Of two balls that overlap, and one apart, cloth sinks into each by 3 cm."""
    vertices, faces = ball
    body = np.concatenate([vertices, vertices + [1.9, 0, 0], vertices + [9, 0, 0]])
    body_faces = np.concatenate([faces + k * len(vertices) for k in range(3)])
    cloth = 0.97 * vertices
    rest = np.full(len(edges(faces)), 0.1)
    monitor = HealthMonitor([HealthGarment(n, faces, rest) for n in ("Top", "Skirt")], body_faces)
    row = monitor.add([cloth, cloth + [9, 0, 0]], body)
    folded, apart = row["inside_open_share"]
    assert row["inside_share"] == [1, 1]
    assert apart == 1
    assert 0.7 < folded < 0.99
    assert row["depth_open_m"] == pytest.approx([0.03, 0.03], abs=2e-3)
