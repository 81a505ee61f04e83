"""Scans: every file format, resampling, axes, and what is refused."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from drapeline.bodies.model import posed_vertices, shape_body
from drapeline.dataset.scans import read_body_parameters, read_frames, read_scans
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.seeding import rng_for

SHAPE = np.linspace(-0.5, 0.5, 10)
FRAMES = 3


@pytest.fixture(scope="module")
def truth(toy_body):
    """Poses, trans and world body vertices of three frames."""
    rng = rng_for(0, "test scans")
    poses = np.tile(REST_POSE, (FRAMES, 1)) + rng.normal(0, 0.1, (FRAMES, 72))
    trans = np.array([0.4, -0.3, 0.9]) + rng.normal(0, 0.05, (FRAMES, 3))
    return poses, trans, posed_vertices(toy_body, SHAPE, poses, trans)[0]


@pytest.fixture
def bodies(toy_body):
    return {"female": toy_body}


@pytest.fixture
def body_file(tmp_path, truth):
    return save_body(tmp_path, truth)


def save_body(folder, truth, **changes):
    arrays = {"poses": truth[0], "trans": truth[1], "shape": SHAPE, "gender": "female"}
    kept = {key: value for key, value in (arrays | changes).items() if value is not None}
    np.savez(folder / "body.npz", **kept)
    return folder / "body.npz"


def save_clouds(folder, clouds, **export):
    folder.mkdir()
    for frame, points in enumerate(clouds):
        trimesh.PointCloud(points).export(folder / f"frame_{frame + 8}.ply", **export)
    return folder


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_clouds_come_back_relative_to_the_root(tmp_path, truth, bodies, body_file, encoding):
    _, trans, vertices = truth
    folder = save_clouds(tmp_path / "scan", vertices, encoding=encoding)
    loaded = read_scans(folder, body_file, bodies)
    assert len(loaded) == FRAMES
    # frame_8, frame_9, frame_10: in the order of numbers, not of letters.
    for scan, points, at in zip(loaded.scans, vertices, trans, strict=True):
        assert scan.triangles is None
        np.testing.assert_allclose(scan.points, points - at, atol=1e-5)
    np.testing.assert_array_equal(loaded.body.poses, truth[0])
    assert loaded.body.gender == "female"


def test_meshes_in_ply_obj_and_npz_are_the_same(tmp_path, truth, toy_body):
    mesh = trimesh.Trimesh(truth[2][0], toy_body.faces, process=False)
    for suffix in ("ply", "obj"):
        (tmp_path / suffix).mkdir()
        mesh.export(tmp_path / suffix / f"0.{suffix}")
    (tmp_path / "npz").mkdir()
    np.savez(tmp_path / "npz" / "0.npz", v_posed=mesh.vertices, faces=mesh.faces)
    for suffix in ("ply", "obj", "npz"):
        (scan,) = read_frames(tmp_path / suffix)
        np.testing.assert_allclose(scan.points, truth[2][0], atol=1e-5)
        np.testing.assert_array_equal(scan.triangles, toy_body.faces)


def test_an_obj_without_faces_is_a_cloud(tmp_path, truth):
    lines = "".join(f"v {x} {y} {z}\n" for x, y, z in truth[2][0])
    (tmp_path / "0.obj").write_text(lines)
    (scan,) = read_frames(tmp_path)
    assert scan.triangles is None
    np.testing.assert_allclose(scan.points, truth[2][0], atol=1e-5)


def test_one_npz_holds_all_frames_even_or_ragged(tmp_path, truth):
    vertices = truth[2]
    np.savez(tmp_path / "even.npz", points=vertices)
    counts = np.array([700, 500, 900])
    np.savez(
        tmp_path / "ragged.npz",
        points=np.concatenate([v[:n] for v, n in zip(vertices, counts, strict=True)]),
        counts=counts,
    )
    for name, lengths in (("even", [len(v) for v in vertices]), ("ragged", counts)):
        loaded = read_frames(tmp_path / f"{name}.npz")
        for scan, points, length in zip(loaded, vertices, lengths, strict=True):
            np.testing.assert_array_equal(scan.points, points[:length])


def test_smpl_translations_are_moved_to_the_root_joint(tmp_path, truth, bodies, toy_body):
    root = shape_body(toy_body, SHAPE)[1][0]
    path = save_body(tmp_path, truth, trans=None, transl=truth[1] - root, gender=np.array(0))
    loaded = read_body_parameters(path, bodies)
    np.testing.assert_allclose(loaded.trans, truth[1], atol=1e-6)
    assert loaded.gender == "female"


def test_scans_with_y_up_are_stood_up_with_their_body(tmp_path, truth, bodies, toy_body):
    poses, trans, vertices = truth
    down = Rotation.from_euler("x", -90, degrees=True)
    lying = poses.copy()
    lying[:, :3] = (down * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    path = save_body(tmp_path, (lying, down.apply(trans), vertices))
    np.savez(tmp_path / "scan.npz", points=np.stack([down.apply(v) for v in vertices]))
    loaded = read_scans(tmp_path / "scan.npz", path, bodies, up="y")
    for scan, points, at in zip(loaded.scans, vertices, trans, strict=True):
        np.testing.assert_allclose(scan.points, points - at, atol=1e-5)
    np.testing.assert_allclose(loaded.body.trans, trans, atol=1e-6)
    again, _ = posed_vertices(toy_body, SHAPE, loaded.body.poses, loaded.body.trans)
    np.testing.assert_allclose(again, vertices, atol=1e-5)


def test_of_faster_scans_every_so_many_frames_are_used(tmp_path, truth, bodies, body_file):
    poses, trans, vertices = truth
    folder = save_clouds(tmp_path / "scan", vertices)
    loaded = read_scans(folder, body_file, bodies, fps=60)
    assert len(loaded) == len(loaded.body.trans) == 2
    np.testing.assert_array_equal(loaded.body.poses, poses[::2])
    for scan, points, at in zip(loaded.scans, vertices[::2], trans[::2], strict=True):
        np.testing.assert_allclose(scan.points, points - at, atol=1e-5)
    for fps in (25, 45, 0):
        with pytest.raises(InputError, match=f"scan: {fps} frames per second, expected a multiple"):
            read_scans(folder, body_file, bodies, fps=fps)


def sequence(tmp_path, truth, bodies, points):
    np.savez(tmp_path / "scan.npz", points=points)
    return read_scans(tmp_path / "scan.npz", save_body(tmp_path, truth), bodies)


def test_clouds_are_thinned_without_repeats_and_filled_evenly(tmp_path, truth, bodies):
    have = 600
    clouds = truth[2][:, :have]
    loaded = sequence(tmp_path, truth, bodies, clouds)
    fewer, more = loaded.points(400, seed=1), loaded.points(1500, seed=1)
    assert fewer.shape == (FRAMES, 400, 3)
    assert more.dtype == np.float32
    for frame in range(FRAMES):
        _, repeats = np.unique(fewer[frame], axis=0, return_counts=True)
        assert (repeats == 1).all()
        _, repeats = np.unique(more[frame], axis=0, return_counts=True)
        assert len(repeats) == have
        assert set(repeats) == {2, 3}
    np.testing.assert_array_equal(fewer, loaded.points(400, seed=1))
    assert not np.array_equal(fewer, loaded.points(400, seed=2))
    # No order is left: the first points are not the scan's first ones.
    assert not np.allclose(fewer[0][:50], (clouds[0] - truth[1][0])[:50])


def test_meshes_are_sampled_evenly_by_area(tmp_path, truth, bodies, toy_body):
    folder = tmp_path / "scan"
    folder.mkdir()
    for frame, vertices in enumerate(truth[2]):
        trimesh.Trimesh(vertices, toy_body.faces, process=False).export(folder / f"{frame}.ply")
    loaded = read_scans(folder, save_body(tmp_path, truth), bodies)
    points = loaded.points(2000, seed=0)[0]
    mesh = trimesh.Trimesh(loaded.scans[0].points, toy_body.faces, process=False)
    assert KDTree(mesh.sample(40_000, seed=0)).query(points)[0].max() < 0.03
    high = mesh.triangles_center[:, 2] > 0
    share = mesh.area_faces[high].sum() / mesh.area
    assert (points[:, 2] > 0).mean() == pytest.approx(share, abs=0.04)


def refused(tmp_path, truth, bodies, points, message, **body):
    np.savez(tmp_path / "scan.npz", points=points)
    with pytest.raises(InputError, match=message):
        read_scans(tmp_path / "scan.npz", save_body(tmp_path, truth, **body), bodies)


def test_scans_that_do_not_fit_the_body_are_refused(tmp_path, truth, bodies):
    _, trans, vertices = truth
    refused(tmp_path, truth, bodies, 1000 * vertices, r"frame 1: the scan is .* \(millimetres\?\)")
    refused(tmp_path, truth, bodies, 100 * vertices, r"frame 1: .* \(centimetres\?\), expected")
    refused(tmp_path, truth, bodies, 0.001 * vertices, "expected metres, between 0.2 and 4.0")
    refused(tmp_path, truth, bodies, vertices[:2], "2 frames, but .*body.npz has 3 poses")
    refused(tmp_path, truth, bodies, vertices - trans[:, None], "of frame 1 are .* from the body")
    lying = vertices[..., [0, 2, 1]] * [1, 1, -1]
    refused(tmp_path, truth, bodies, lying, "same axes, units and order of frames")


def test_bad_points_are_refused(tmp_path, truth, bodies):
    vertices = truth[2]
    holed = vertices.copy()
    holed[1, 4, 2] = np.nan
    refused(tmp_path, truth, bodies, holed, "frame 2: 1 of .* points hold NaN .* is point 5")
    refused(tmp_path, truth, bodies, vertices[:, :0], "frame 1: no points")
    refused(tmp_path, truth, bodies, vertices[0], r"expected \(F, P, 3\)")
    refused(tmp_path, truth, bodies, vertices[..., :2], r"expected \(F, P, 3\)")
    refused(tmp_path, truth, bodies, vertices[:0], "no frames")
    refused(tmp_path, truth, bodies, np.full((3, 5, 3), "x"), "of type <U1, expected numbers")


def test_bad_body_parameters_are_refused(tmp_path, truth, bodies):
    poses, trans, vertices = truth
    for changes, message in (
        ({"trans": None}, r"lacks trans; it holds gender, poses, shape"),
        ({"shape": None}, "lacks shape"),
        ({"poses": poses[:, :69]}, r"poses has shape \(3, 69\) .* expected \(3, 72\)"),
        ({"trans": trans[:2]}, r"trans has shape \(2, 3\) .* expected \(3, 3\)"),
        ({"shape": np.full(10, np.inf)}, "shape holds NaN or infinity"),
        ({"gender": "neutral"}, "gender is 'neutral', expected female, male, 0 or 1"),
        ({"gender": "male"}, "gender male, expected female"),
    ):
        refused(tmp_path, truth, bodies, vertices, message, **changes)
    with pytest.raises(InputError, match="none.npz: no such file, .* the body's poses"):
        read_scans(tmp_path / "scan.npz", tmp_path / "none.npz", bodies)


@pytest.mark.parametrize("lost", [100, 450])
def test_a_ply_with_fewer_rows_than_declared_is_refused(tmp_path, toy_body, lost):
    folder = tmp_path / "scan"
    folder.mkdir()
    mesh = trimesh.Trimesh(toy_body.v_template, toy_body.faces, process=False)
    mesh.export(folder / "0.ply", encoding="ascii")
    assert len(read_frames(folder)[0].triangles) == len(toy_body.faces)
    rows = (folder / "0.ply").read_text().splitlines()
    (folder / "0.ply").write_text("\n".join(rows[:-lost]) + "\n")
    with pytest.raises(InputError, match="0.ply: names .* elements of 'face' and holds .*cut off"):
        read_frames(folder)


def test_a_ply_with_fewer_points_than_declared_is_refused(tmp_path, truth):
    folder = save_clouds(tmp_path / "scan", truth[2][:1], encoding="ascii")
    rows = (folder / "frame_8.ply").read_text().splitlines()
    (folder / "frame_8.ply").write_text("\n".join(rows[:-30]) + "\n")
    with pytest.raises(InputError, match=r"frame_8\.ply"):
        read_frames(folder)


def test_hidden_files_are_no_frames_and_any_name_is_read(tmp_path, truth):
    folder = save_clouds(tmp_path / "scan", truth[2][:2])
    (folder / "._frame_8.ply").write_bytes(b"of another system")
    (folder / "frame_8.ply").rename(folder / "1²2.ply")
    assert len(read_frames(folder)) == 2


def test_bad_folders_and_files_are_refused(tmp_path, truth):
    with pytest.raises(InputError, match="nowhere: no such folder"):
        read_frames(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: contains no .ply, .obj, .npz, expected"):
        read_frames(tmp_path / "empty")
    folder = tmp_path / "scan"
    folder.mkdir()
    (folder / "0.ply").write_text("not a ply at all")
    with pytest.raises(InputError, match="0.ply: not readable as ply"):
        read_frames(folder)
    (folder / "0.ply").unlink()
    np.savez(folder / "0.npz", pose=np.zeros(72))
    with pytest.raises(InputError, match="0.npz: holds neither points nor v_posed"):
        read_frames(folder)
    np.savez(folder / "0.npz", points=truth[2][0], faces=np.array([[0, 1, 99999]]))
    with pytest.raises(InputError, match="faces do not match the .* vertices"):
        read_frames(folder)
    np.savez(tmp_path / "ragged.npz", points=truth[2][0], counts=np.array([5, 6]))
    with pytest.raises(InputError, match="sum up to 11, expected"):
        read_frames(tmp_path / "ragged.npz")
