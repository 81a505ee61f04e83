"""Point clouds: evenness by area, what cameras see, holes, wrong labels, files."""

import shutil
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
import trimesh

from drapeline.dataset.point_clouds import (
    CloudRngs,
    CloudSampler,
    camera_ring,
    corrupt_labels,
    cut_holes,
    find_seen,
    load_clouds,
    write_clouds,
)
from drapeline.dataset.settings import CloudSettings
from drapeline.errors import InputError
from drapeline.outfits.garment_types import LABELS
from drapeline.seeding import rng_for
from drapeline.storage import read_json
from toys.tiny_sample import tube, write_tiny_sample


class LabelledMesh(NamedTuple):
    """A surface of a scene."""

    vertices: np.ndarray
    triangles: np.ndarray
    label: str


def ball(radius_m=0.3, centre=(0, 0, 0), label="Body", subdivisions=3):
    mesh = trimesh.creation.icosphere(subdivisions, radius=radius_m)
    return LabelledMesh(
        (mesh.vertices + centre).astype(np.float32), mesh.faces.astype(np.int32), label
    )


def skirt(radius_m=0.4, bottom_m=-0.3, top_m=0.3):
    mesh = tube(radius_m, bottom_m, top_m, around=24)
    return LabelledMesh(mesh.vertices / [1, 0.6, 1], mesh.triangles, "Skirt")


def rng(name="cloud"):
    return rng_for(0, "test clouds", name)


def rngs():
    return CloudRngs(rng(), rng("noise"))


def sample_cloud(meshes, settings, turn_rad=0.0):
    """Points and labels of one frame."""
    surfaces = [(mesh.triangles, mesh.label) for mesh in meshes]
    sampler = CloudSampler(surfaces, settings, turn_rad=turn_rad)
    return sampler.sample([mesh.vertices for mesh in meshes], rngs())


def test_points_of_a_ball_are_even_by_area():
    points, labels = sample_cloud([ball()], CloudSettings(points=4000))
    assert points.shape == (4000, 3)
    assert points.dtype == np.float32
    assert labels.dtype == np.uint8
    assert not labels.any()
    # Archimedes: every coordinate of a point on a sphere is uniform.
    for axis in range(3):
        uniform = np.sort(points[:, axis] / 0.3)
        assert np.abs((uniform + 1) / 2 - np.linspace(0, 1, 4000)).max() < 0.035


def test_large_triangles_get_more_points_than_small_ones():
    corners = np.array([[0, 0, 0], [3, 0, 0], [0, 0, 1], [-1, 0, 0]], np.float32) / 4
    mesh = LabelledMesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), "Skirt")
    points, _ = sample_cloud([mesh], CloudSettings(points=4000))
    assert (points[:, 0] > 0).mean() == pytest.approx(0.75, abs=0.03)


def crossed(start, end, a, b, c):
    """(n,) how many triangles (F, 3) lie strictly between start (n, 3) and end (3,)."""
    count = np.zeros(len(start), int)
    away = end - start
    for p, q, r in zip(a, b, c, strict=True):
        u, v = q - p, r - p
        across = np.cross(away, v)
        scale = across @ u
        with np.errstate(divide="ignore", invalid="ignore"):
            offset = start - p
            first = (offset * across).sum(1) / scale
            turned = np.cross(offset, u)
            second = (away * turned).sum(1) / scale
            along = (turned @ v) / scale
        count += (first > 0) & (second > 0) & (first + second < 1) & (along > 1e-3) & (along < 1)
    return count


def test_one_camera_sees_what_rays_by_hand_reach():
    """A ball behind a ball with a skirt about it, against every triangle in turn."""
    meshes = [
        ball(subdivisions=2),
        skirt(),
        ball(0.2, (0.1, 0.8, 0.1), "Top", subdivisions=2),
    ]
    vertices = np.concatenate([m.vertices for m in meshes])
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    faces = np.concatenate([m.triangles + s for m, s in zip(meshes, starts, strict=False)])
    corners = [vertices[faces[:, i]].astype(float) for i in range(3)]
    camera = 3 * np.array([0, -np.cos(np.radians(10)), np.sin(np.radians(10))])
    points, labels = sample_cloud(meshes, CloudSettings(points=300, visibility="single"))
    assert not crossed(points.astype(float), camera, *corners).any()
    # The same shares of labels as of points drawn and judged by hand.
    area = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]), axis=1)
    draw = rng("by hand")
    face = draw.choice(len(faces), 3000, p=area / area.sum())
    shares = draw.dirichlet((1, 1, 1), 3000)
    place = sum(shares[:, i : i + 1] * corners[i][face] for i in range(3))
    seen = crossed(place, camera, *corners) == 0
    owner = np.repeat([LABELS.index(m.label) for m in meshes], [len(m.triangles) for m in meshes])
    for mesh in meshes:
        code = LABELS.index(mesh.label)
        assert (labels == code).mean() == pytest.approx(
            (owner[face][seen] == code).mean(), abs=0.08
        )


def test_skin_close_under_cloth_is_covered_and_cloth_inside_skin_too():
    body = ball(0.3)
    for cloth, expected in ((ball(0.31, label="Top"), "Top"), (ball(0.29, label="Top"), "Body")):
        _, labels = sample_cloud([body, cloth], CloudSettings(points=500))
        assert (labels == LABELS.index(expected)).all()


def test_cloth_is_seen_from_its_inside_and_a_body_is_not():
    wide = skirt(0.5, -0.1, 0.1)
    for label, share in (("Skirt", 0.3), ("Body", 0.0)):
        points, _ = sample_cloud(
            [wide._replace(label=label)], CloudSettings(points=1000, visibility="single")
        )
        # The camera is 10 degrees up: over the near rim it sees the far side from inside.
        assert (points[:, 1] > 0.2).mean() >= share
        if label == "Body":
            assert points[:, 1].max() < 0


def test_a_turn_takes_the_camera_around():
    one = CloudSettings(points=500, visibility="single")
    quarter, _ = sample_cloud([ball()], one, turn_rad=np.pi / 2)
    assert sample_cloud([ball()], one)[0][:, 1].max() < 0.05
    assert quarter[:, 0].min() > -0.05
    four, _ = sample_cloud([ball()], CloudSettings(points=500, visibility="multi"))
    assert np.ptp(four[:, :2], axis=0).min() > 0.55


def test_noise_has_its_standard_deviation():
    calm, _ = sample_cloud([ball()], CloudSettings(points=3000))
    noisy, _ = sample_cloud([ball()], CloudSettings(points=3000, noise_m=0.01))
    assert (noisy - calm).std() == pytest.approx(0.01, rel=0.05)


def test_missing_patches_leave_the_number_of_points():
    def emptiest(missing):
        points, _ = sample_cloud([ball()], CloudSettings(points=2000, missing=missing))
        assert len(np.unique(points, axis=0)) == 2000
        probes = ball(0.3).vertices
        return np.linalg.norm(probes[:, None] - points[None], axis=-1).min(axis=1).max()

    assert emptiest(0.4) > 2.5 * emptiest(0.0)


def test_a_following_sampler_equals_a_new_one():
    meshes = [ball(), skirt(), ball(0.05, (0, 0, 0.4), "Top")]
    sampler = CloudSampler([(m.triangles, m.label) for m in meshes], CloudSettings(points=400))
    for shift in np.linspace(0, 0.3, 10):  # the tree is rebuilt at the ninth
        moved = [meshes[0], meshes[1], meshes[2]._replace(vertices=meshes[2].vertices + shift)]
        followed = sampler.sample([m.vertices for m in moved], rngs())
        for actual, expected in zip(
            followed, sample_cloud(moved, CloudSettings(points=400)), strict=True
        ):
            np.testing.assert_array_equal(actual, expected)


def test_the_released_protocol_takes_vertices_covered_or_not():
    meshes = [ball(), ball(0.31, label="Top")]
    settings = CloudSettings(points=301, protocol="vertices")
    points, labels = sample_cloud(meshes, settings)
    np.testing.assert_array_equal(np.bincount(labels), [151, 0, 150])
    for code, mesh in zip((0, 2), meshes, strict=True):
        whole = {tuple(v) for v in mesh.vertices}
        assert {tuple(p) for p in points[labels == code]} <= whole
    moved = [m._replace(vertices=m.vertices + [0, 0, 1]) for m in meshes]
    np.testing.assert_allclose(sample_cloud(moved, settings)[0], points + [0, 0, 1], atol=1e-6)


def test_noise_is_new_in_every_frame_where_vertices_are_not(tmp_path, tiny):
    still = CloudSettings(points=200, protocol="vertices")
    noisy = CloudSettings(points=200, protocol="vertices", noise_m=0.005)
    for name, settings in (("still", still), ("noisy", noisy)):
        write_clouds(tmp_path / name, tiny.folder, settings)
    calm, noisy = (load_clouds(tmp_path / name).points for name in ("still", "noisy"))
    error = noisy - calm
    assert error.std() == pytest.approx(0.005, rel=0.1)
    for before, after in pairwise(error):
        assert abs(np.corrcoef(before.ravel(), after.ravel())[0, 1]) < 0.2


def test_unknown_labels_and_unseen_scenes_are_refused():
    with pytest.raises(InputError, match="points of 'Hat' have no label, expected one of Body"):
        sample_cloud([ball(label="Hat")], CloudSettings())
    with pytest.raises(InputError, match="cameras 'single' see 0 of"):
        sample_cloud([ball(9.0)], CloudSettings(points=20, visibility="single"))


def test_a_hole_is_a_point_and_those_nearest_to_it():
    points = rng().normal(size=(400, 3))
    labels = np.arange(400) % 7
    left, left_labels = cut_holes(points, labels, 0.05, rng("hole"))
    assert left.shape == points.shape
    index = {tuple(p): i for i, p in enumerate(points)}
    kept = np.array([index[tuple(p)] for p in left])
    np.testing.assert_array_equal(left_labels, labels[kept])
    gone = np.setdiff1d(np.arange(400), kept)
    assert len(gone) == 20
    distance = np.linalg.norm(points[gone][:, None] - points[None], axis=-1)
    others = np.delete(distance, gone, axis=1).min(axis=1)
    assert (distance[:, gone].max(axis=1) <= others).any()


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.9])
def test_holes_take_exactly_their_share(share):
    points = rng().normal(size=(1000, 3))
    left, _ = cut_holes(points, np.zeros(1000, np.uint8), share, rng("hole"))
    _, repeats = np.unique(left, axis=0, return_counts=True)
    assert len(repeats) == 1000 - round(1000 * share)
    assert np.ptp(repeats) <= 1


def test_a_camera_sees_the_half_of_a_ball_that_faces_it():
    points = rng().normal(size=(2000, 3))
    points = (0.3 * points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)
    front = find_seen(np.array([[3.0, 0, 0]]), points, rng())
    assert front.shape == (2000,)
    assert (points[front, 0] > -0.05).all()
    found, repeats = np.unique(front, return_counts=True)
    assert len(found) > 0.4 * len(points)
    assert np.ptp(repeats) <= 1
    around = find_seen(np.array([[3.0, 0, 0], [-3.0, 0, 0]]), points, rng())
    assert len(np.unique(around)) > 0.85 * len(points)


def test_a_camera_does_not_see_what_is_behind_a_wall():
    side = np.linspace(-0.5, 0.5, 30)
    wall = np.stack([np.full(900, 0.2), *(each.ravel() for each in np.meshgrid(side, side))], 1)
    hidden = wall * [-1, 0.5, 0.5]
    seen = find_seen(np.array([[3.0, 0, 0]]), np.concatenate([hidden, wall]), rng())
    assert set(seen.tolist()) == set(range(900, 1800))


def test_wrong_labels_are_as_many_as_asked_for_and_turn_the_right_way():
    labels = np.repeat(np.array([0, 3, 4], np.uint8), 100)
    corrupted = corrupt_labels(labels, 0.7, 4, rng())
    wrong = corrupted != labels
    assert wrong.sum() == 90
    assert (corrupted[wrong & (labels == 4)] == 0).all()
    assert (corrupted[wrong & (labels != 4)] == 4).all()
    assert corrupted.dtype == labels.dtype
    np.testing.assert_array_equal(corrupt_labels(labels, 1.0, 4, rng()), labels)


@pytest.fixture(scope="module")
def clouds(tiny, tmp_path_factory):
    folder = tmp_path_factory.mktemp("clouds")
    settings = CloudSettings(points=300, seed=3)
    assert write_clouds(folder / "a", tiny.folder, settings) == "accepted"
    write_clouds(folder / "b", tiny.folder, settings)
    write_clouds(folder / "c", tiny.folder, CloudSettings(points=300, seed=4))
    return folder


def test_a_sample_has_a_cloud_for_every_frame(clouds, tiny):
    loaded = load_clouds(clouds / "a")
    assert loaded.accepted
    assert loaded.points.shape == (6, 300, 3)
    assert loaded.labels.shape == (6, 300)
    assert isinstance(loaded.points, np.memmap)
    assert set(np.unique(loaded.labels)) == {0, LABELS.index("Tshirt"), LABELS.index("Skirt")}
    about = loaded.about
    assert (about["name"], about["split"], about["source"]) == ("00001", "train", "simulated")
    assert (about["gender"], about["garments"]) == ("female", ["Tshirt", "Skirt"])
    assert about["settings"]["points"] == 300


def test_points_lie_on_the_garments_of_their_frame(clouds, tiny):
    loaded = load_clouds(clouds / "a")
    for frame in (0, 5):
        for name in ("Tshirt", "Skirt"):
            mesh = trimesh.Trimesh(
                tiny.vertices[name][frame], tiny.meshes[name].triangles, process=False
            )
            own = loaded.points[frame][loaded.labels[frame] == LABELS.index(name)]
            _, distance, _ = trimesh.proximity.closest_point_naive(mesh, own)
            assert distance.max() < 1e-3  # the caches are in half precision


def test_every_frame_has_points_of_its_own_and_a_seed_fixes_them(clouds):
    a, b, c = (load_clouds(clouds / name).points for name in "abc")
    np.testing.assert_array_equal(a, b)
    assert np.abs(a - c).max() > 0.1
    assert np.abs(a[0] - a[1]).mean() > 0.1


def test_a_rejected_sample_leaves_its_status_alone(tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path / "stages", toy_body, status="rejected")
    assert write_clouds(tmp_path / "out", tiny.folder, CloudSettings(points=10)) == "rejected"
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["about.json"]
    assert read_json(tmp_path / "out" / "about.json")["status"] == "rejected"
    loaded = load_clouds(tmp_path / "out")
    assert not loaded.accepted
    assert len(loaded) == 0


def test_damaged_clouds_are_refused(clouds, tmp_path):
    with pytest.raises(InputError, match="about.json: no such file"):
        load_clouds(tmp_path)
    folder = shutil.copytree(clouds / "a", tmp_path / "a")
    np.save(folder / "labels.npy", np.zeros((5, 300), np.uint8))
    with pytest.raises(InputError, match=r"labels.npy: has shape .*expected \(6, 300\)"):
        load_clouds(folder)
    (folder / "points.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(InputError, match="points.npy: does not start like an .npy"):
        load_clouds(folder)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_cameras_stand_evenly_around_the_root_joint_at_their_elevation(count):
    cameras = camera_ring(count, 0.7, 30.0)
    assert cameras.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(cameras, axis=1), 3)
    np.testing.assert_allclose(cameras[:, 2], 1.5)
    around = cameras[:, 0] + 1j * cameras[:, 1]
    np.testing.assert_allclose(np.angle(around[0]), 0.7)
    turn = np.exp(2j * np.pi / count)
    np.testing.assert_allclose(around * turn, np.roll(around, -1), atol=1e-12)
