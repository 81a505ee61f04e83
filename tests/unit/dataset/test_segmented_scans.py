"""Segmented scans: of samples, of users, in files, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.reader import Sample
from drapeline.dataset.scans import read_scans, to_scans
from drapeline.dataset.segmented_scans import (
    OTHER,
    load_scans,
    save_scans,
    scan_sample,
    segment_scans,
)
from drapeline.dataset.settings import ScanSettings
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import Mesh, vertex_normals
from drapeline.outfits.garment_types import LABELS
from drapeline.storage import save_npz
from toys.tiny_sample import write_tiny_sample

SETTINGS = ScanSettings(frames=2, points=600, noise_m=0.0)
TRANS = np.array([0.4, -0.3, 0.9])


@pytest.fixture(scope="module")
def sample(tmp_path_factory, toy_body):
    return Sample(write_tiny_sample(tmp_path_factory.mktemp("sample"), toy_body).folder)


def test_scans_of_a_sample_lie_on_its_meshes(sample, toy_body):
    scans = scan_sample(sample, toy_body, SETTINGS, 1)
    assert [scan.frame for scan in scans] == [
        sample.frame_count // 4,
        3 * sample.frame_count // 4,
    ]
    for scan in scans:
        assert scan.garments == ("Skirt", "Tshirt")
        for name in scan.garments:
            cloth = sample.vertices(name, scan.frame, scan.frame + 1, "root")[0]
            assert KDTree(cloth).query(scan.points_of(name))[0].max() < 0.2
        assert scan.skin.any()


def test_estimates_have_the_mean_shape_and_are_off(sample, toy_body):
    scan = scan_sample(sample, toy_body, SETTINGS, 1)[0]
    true = BodyState.of(sample.info.poses[scan.frame], np.zeros(3), sample.info.shape)
    assert not scan.estimate.shape.any()
    assert 0.01 < np.abs(scan.estimate.turns_from(true)).mean() < 0.2


def test_the_same_seed_gives_the_same_scan(sample, toy_body):
    one, two, other = (scan_sample(sample, toy_body, SETTINGS, seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.points, two.points)
    np.testing.assert_array_equal(one.estimate.rotations, two.estimate.rotations)
    assert not np.array_equal(one.points, other.points)


def test_what_covers_a_garment_may_hide_it(sample, toy_body):
    scan = scan_sample(sample, toy_body, SETTINGS, 1)[0]
    inner, outer = scan.garments
    skin = int(scan.skin.sum())
    assert len(scan.points_beside(inner)) == skin
    assert len(scan.points_beside(outer)) == skin + len(scan.points_of(inner))


def test_files_keep_scans_and_bodies(sample, toy_body, tmp_path):
    scans = scan_sample(sample, toy_body, SETTINGS, 1)
    bodies = [scan.estimate._replace(shape=np.arange(10.0)) for scan in scans]
    save_scans(tmp_path / "scans.npz", scans, bodies)
    for (scan, body), known, state in zip(
        load_scans(tmp_path / "scans.npz"), scans, bodies, strict=True
    ):
        assert (scan.name, scan.garments, scan.gender) == (known.name, known.garments, known.gender)
        np.testing.assert_array_equal(scan.points, known.points)
        np.testing.assert_array_equal(scan.labels, known.labels)
        np.testing.assert_array_equal(scan.joints, known.joints)
        np.testing.assert_array_equal(body.shape, state.shape)


def surface(sample, frame, where):
    """Everything that is to be seen in a frame, as one surface."""
    body = sample.body_vertices(frame, frame + 1, frame=where)[0]
    parts = [Mesh(body, sample.body_mesh().triangles)]
    for name in sample.garments:
        cloth = sample.vertices(name, frame, frame + 1, where)[0]
        parts.append(Mesh(cloth, sample.mesh(name).triangles))
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=False)]
    return np.concatenate([part.vertices for part in parts]), np.concatenate(faces)


WINDOW = SETTINGS.replace(frames=6, window=5)


@pytest.fixture(scope="module")
def windows(sample, toy_body):
    return scan_sample(sample, toy_body, WINDOW, 1)


def test_the_frame_in_the_middle_of_a_window_is_the_one_that_is_scanned(windows):
    for scan in windows:
        window, middle = scan.window, scan.window.middle
        np.testing.assert_array_equal(window.labels[middle], scan.labels)
        estimated = BodyState.of(window.poses[middle], scan.estimate.trans, np.zeros(10))
        np.testing.assert_allclose(estimated.rotations, scan.estimate.rotations, atol=1e-9)
        # The one is relative to the root joint as estimated, the other to the true one.
        np.testing.assert_allclose(
            window.points[middle] + scan.estimate.trans, scan.points, atol=1e-6
        )


def test_a_window_ends_where_its_sample_does(sample, windows):
    assert sample.frame_count == 6
    for scan, frames in zip(
        windows, ([0], range(3), range(5), range(1, 6), [3, 4, 5], [5]), strict=True
    ):
        assert {len(part) for part in scan.window} == {len(frames)}
        place = scan.window.trans - scan.estimate.trans
        np.testing.assert_allclose(place, sample.info.trans[[*frames]], atol=1e-9)


def test_points_of_a_window_lie_on_the_sample_in_the_world(sample, windows):
    scan = windows[2]
    for frame, (points, trans) in enumerate(
        zip(scan.window.points, scan.window.trans, strict=True)
    ):
        world = points + trans
        place, _ = closest_points(world.astype(np.float32), *surface(sample, frame, "world"))
        assert np.linalg.norm(place - world, axis=1).max() < 1e-4


def test_poses_of_a_window_are_off_by_the_same(sample, windows):
    scan = windows[3]
    off = scan.window.poses - sample.info.poses[1:6]
    assert np.abs(off).max() > 0.05
    np.testing.assert_allclose(off, np.tile(off[:1], (5, 1)), atol=1e-6)


def test_single_frames_are_the_same_with_a_window_and_without(sample, toy_body, windows):
    alone = scan_sample(sample, toy_body, WINDOW.replace(window=1), 1)
    for one, other in zip(alone, windows, strict=True):
        assert one.window is None
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.estimate.rotations, other.estimate.rotations)
        assert one.joints.shape == (24, 3)
        assert other.joints is None  # which nobody is given who sees a motion


def test_a_root_joint_elsewhere_leaves_the_points_of_a_window_where_they_are(windows):
    window, shift = windows[2].window, np.array([0.1, -0.2, 0.3])
    moved = window.shifted(shift)
    np.testing.assert_allclose(moved.trans, window.trans + shift)
    np.testing.assert_allclose(
        moved.points + moved.trans[:, None], window.points + window.trans[:, None], atol=1e-6
    )


def test_files_keep_windows(windows, tmp_path):
    alone = replace(windows[0], name="00002_000", window=None)
    scans = [*windows, alone]
    save_scans(tmp_path / "scans.npz", scans, [scan.estimate for scan in scans])
    for (scan, _), known in zip(load_scans(tmp_path / "scans.npz"), scans, strict=True):
        assert scan.joints is None
        if known.window is None:
            assert scan.window is None
            continue
        for part, written in zip(scan.window, known.window, strict=True):
            assert part.dtype == written.dtype
            np.testing.assert_array_equal(part, written)


def test_an_estimate_without_errors_is_the_body_itself(sample, toy_body):
    exact = SETTINGS.replace(pose_rad=0, place_m=0, joints_m=0, shape=0)
    assert exact.body_is_known
    for name, value in (("pose_rad", 0.1), ("place_m", 0.1), ("joints_m", 0.1), ("shape", 0.1)):
        assert not exact.replace(**{name: value}).body_is_known
    assert not exact.replace(shape=None).body_is_known  # the mean shape
    (scan, _) = scan_sample(sample, toy_body, exact, 1)
    true = BodyState.of(sample.info.poses[scan.frame], np.zeros(3), sample.info.shape)
    for part, known in zip(scan.estimate, true, strict=True):
        np.testing.assert_array_equal(part, known)
    vertices = sample.body_vertices(scan.frame, scan.frame + 1, frame="root")[0]
    posed, joints = posed_vertices(toy_body, true.shape, true.pose[None])
    np.testing.assert_allclose(posed[0], vertices, atol=5e-4)  # files have half precision
    np.testing.assert_allclose(scan.joints, joints[0], atol=1e-6)


def test_one_camera_sees_one_side(sample, toy_body):
    """Normals of the skin that it sees lean its way; those of all cameras cancel out."""
    leans = {}
    for visibility in ("all", "single"):
        (scan, _) = scan_sample(sample, toy_body, SETTINGS.replace(visibility=visibility), 1)
        body = sample.body_vertices(scan.frame, scan.frame + 1, frame="root")[0]
        _, nearest = KDTree(body).query(scan.points[scan.skin])
        normals = vertex_normals(body, toy_body.faces)[nearest]
        leans[visibility] = np.linalg.norm(normals[:, :2].mean(axis=0))
    assert leans["all"] < 0.2
    assert leans["single"] > 0.4


def test_holes_leave_as_many_points(sample, toy_body):
    """They lie where some of a whole cloud are not."""
    whole, holed = (
        scan_sample(sample, toy_body, SETTINGS.replace(missing=missing), 1)[0]
        for missing in (0, 0.5)
    )
    assert len(whole.points) == len(holed.points) == SETTINGS.points
    away = KDTree(holed.points).query(whole.points)[0]
    assert np.quantile(away, 0.9) > 2 * np.quantile(
        KDTree(whole.points).query(holed.points)[0], 0.9
    )


def dressed(toy_body, labels):
    """A user's scan of a standing body whose vertices have labels."""
    vertices, _ = posed_vertices(toy_body, np.zeros(10), REST_POSE[None], TRANS[None])
    body = {
        "poses": REST_POSE[None],
        "trans": TRANS[None],
        "shape": np.zeros(10),
        "gender": "female",
    }
    return to_scans([vertices[0]], body, {"female": toy_body}, labels=[labels])


def some_labels(toy_body):
    labels = np.zeros(len(toy_body.v_template), np.int64)
    labels[:300], labels[300:500], labels[500:600] = 1, 2, OTHER
    return labels


def test_a_users_labels_become_garments_in_the_users_world(toy_body):
    labels = some_labels(toy_body)
    (scan,) = segment_scans(dressed(toy_body, labels), ["Trousers", "Top"], name="a/me")
    assert scan.name == "me_001"
    np.testing.assert_array_equal(scan.skin, labels == 0)
    assert len(scan.points_of("Top")) == 200
    assert (scan.labels[labels == OTHER] == OTHER).all()
    assert len(LABELS) <= OTHER
    np.testing.assert_allclose(scan.estimate.trans, TRANS)
    np.testing.assert_allclose(scan.points[:, 2].min(), 0, atol=0.15)


def test_labels_come_from_ply_and_npz(toy_body, tmp_path):
    labels = some_labels(toy_body)
    points = dressed(toy_body, labels).scans[0].points + TRANS
    (tmp_path / "ply").mkdir()
    lines = [f"{x} {y} {z} {k}" for (x, y, z), k in zip(points, labels, strict=True)]
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "property uchar label\n"
    (tmp_path / "ply/0.ply").write_text(head + "end_header\n" + "\n".join(lines) + "\n")
    save_npz(tmp_path / "all.npz", points=points[None], labels=labels[None])
    save_npz(
        tmp_path / "body.npz",
        poses=REST_POSE[None],
        trans=TRANS[None],
        shape=np.zeros(10),
        gender="female",
        joints=np.zeros((1, 24, 3)),
    )
    for path in (tmp_path / "ply", tmp_path / "all.npz"):
        scans = read_scans(path, tmp_path / "body.npz", {"female": toy_body})
        np.testing.assert_array_equal(scans.scans[0].labels, labels)
        (scan,) = segment_scans(scans, ["Trousers", "Top"], name=str(path))
        assert scan.joints.shape == (24, 3)


@pytest.mark.parametrize(
    ("garments", "change", "message"),
    [
        ([], {}, "garments are not named, expected some of Tshirt"),
        (["Kilt"], {}, "garments are Kilt, expected some of Tshirt"),
        (["Top"], {"labels": None}, "frame 1: points have no labels"),
        (["Top"], {}, "frame 1: point 301 has the label 2, expected 0 for skin, 1 to 1 for Top"),
        (["Top", "Skirt", "Dress"], {}, "frame 1: no point is labelled as Dress, expected some"),
    ],
)
def test_labels_that_mean_nothing_are_refused(toy_body, garments, change, message):
    scans = dressed(toy_body, some_labels(toy_body))
    scans = type(scans)(tuple(scan._replace(**change) for scan in scans.scans), scans.body)
    with pytest.raises(InputError, match=message):
        segment_scans(scans, garments, name="me")


def test_labels_of_another_number_are_refused(toy_body):
    with pytest.raises(InputError, match=r"frame 1: labels have shape \(3,\)"):
        dressed(toy_body, np.zeros(3, np.int64))
