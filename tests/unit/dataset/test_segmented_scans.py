"""Segmented scans: of samples, of users, in files, and what is refused."""

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
