"""Garments the user brings."""

import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.mesh import Mesh, boundary_loops, faces_within, vertex_normals
from drapeline.geometry.obj import save_obj
from drapeline.outfits.fabrics import FABRICS
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.settings import OwnGarment
from drapeline.outfits.user_garment import load_user_garment, openings, rims
from drapeline.seeding import rng_for


@pytest.fixture(scope="module")
def skirt(toy_body):
    """An open cone around the hips, without texture coordinates."""
    around, rows = 32, 8
    angle = 2 * np.pi * np.arange(around) / around
    grid = [
        [(r * np.cos(a), r * np.sin(a), z) for a in angle]
        for r, z in zip(np.linspace(0.3, 0.2, rows), np.linspace(-0.5, 0.05, rows), strict=True)
    ]
    ids = np.arange(rows * around).reshape(rows, around)
    after = np.roll(ids, -1, axis=1)
    faces = np.stack([ids[:-1], after[:-1], after[1:], ids[1:]], axis=-1).reshape(-1, 4)
    return Mesh(np.array(grid, dtype=np.float32).reshape(-1, 3), faces.astype(np.int32))


def saved(tmp_path, mesh, vertices=None, faces=None):
    path = tmp_path / "mine.obj"
    changed = Mesh(
        mesh.vertices if vertices is None else vertices, mesh.faces if faces is None else faces
    )
    save_obj(path, changed)
    return path


def test_a_sound_garment_comes_back_with_a_texture_map(tmp_path, skirt, toy_body):
    mesh = load_user_garment(saved(tmp_path, skirt), toy_body)
    np.testing.assert_array_equal(mesh.faces, skirt.faces)
    assert mesh.uv.min() >= 0
    assert mesh.uv.max() <= 1
    assert mesh.uv_faces.shape == mesh.faces.shape


def test_an_own_garment_takes_the_place_of_the_template(tmp_path, skirt, toy_body, templates):
    path = str(saved(tmp_path, skirt))
    outfit = sample_outfit(
        rng_for(1, "own"),
        templates,
        toy_body,
        gender="female",
        shape=np.zeros(10),
        outfit_type="Tshirt+Skirt",
        edge_length_m=0.03,
        own={"Skirt": OwnGarment(path=str(path))},
    )
    mine = outfit.garments[0]
    np.testing.assert_array_equal(mine.faces, skirt.faces)
    assert mine.attributes["parameters"] == {"own_garment": path, "held": ["top"]}
    assert mine.attributes["fabric"] in FABRICS
    assert not mine.elastic.any()
    np.testing.assert_array_equal(mine.pin, skirt.vertices[:, 2] > 0.04)


def test_fabric_elastics_and_held_rims_are_as_asked_for(tmp_path, skirt, toy_body, templates):
    asked = OwnGarment(
        path=str(saved(tmp_path, skirt)), fabric="leather", elastic=("bottom",), held=()
    )
    outfit = sample_outfit(
        rng_for(1, "own"),
        templates,
        toy_body,
        gender="male",
        shape=np.zeros(10),
        outfit_type="Top+Skirt",
        edge_length_m=0.03,
        own={"Skirt": asked},
    )
    mine = outfit.garments[0]
    assert mine.attributes["fabric"] == "leather"
    assert mine.attributes["elastic"] == {"bottom": True}
    assert not mine.pin.any()
    np.testing.assert_array_equal(mine.elastic, skirt.vertices[:, 2] < -0.49)


def tube_along(axis, centre, radius=0.1):
    """Vertices and faces of a short open tube."""
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = np.concatenate([ring, ring + [0, 0, 0.3]])
    points = np.roll(points, axis - 2, axis=1) + centre
    ids = np.arange(12)
    after = np.roll(ids, -1)
    return points, np.stack([ids, after, after + 12, ids + 12], axis=1)


def joined(*parts):
    counts = np.cumsum([0, *(len(points) for points, _ in parts)])
    faces = [faces + count for (_, faces), count in zip(parts, counts, strict=False)]
    points = np.concatenate([points for points, _ in parts]).astype(np.float32)
    return Mesh(points, np.concatenate(faces).astype(np.int32))


def test_openings_are_named_by_where_they_are():
    mesh = joined(
        tube_along(2, [0, 0, 0.1]),
        tube_along(0, [0.4, 0, 0.4], 0.05),
        tube_along(0, [-0.7, 0, 0.4], 0.05),
        tube_along(2, [0.15, 0, -0.7]),
        tube_along(2, [-0.15, 0, -0.7]),
    )
    there = openings(mesh)
    places = {name: mesh.vertices[ids] for name, ids in there.items()}
    np.testing.assert_allclose(places["top"][:, 2], 0.4, atol=1e-6)
    np.testing.assert_allclose(places["bottom"][:, 2], 0.1, atol=1e-6)
    assert (places["sleeves"][:, 2] > 0.3).all()
    assert (places["legs"][:, 2] < -0.3).all()
    assert sum(map(len, there.values())) == len(mesh.vertices)
    for side in (-1, 1):
        assert (side * places["sleeves"][:, 0] > 0).any()
        assert (side * places["legs"][:, 0] > 0).any()


def test_trousers_have_no_bottom_but_legs(tmp_path):
    mesh = joined(tube_along(2, [0.15, 0, -0.7]), tube_along(2, [-0.15, 0, -0.7]))
    assert list(openings(mesh)) == ["legs"]
    with pytest.raises(InputError, match=r"mine\.obj: has no opening 'bottom', expected legs"):
        rims("mine.obj", mesh, ["bottom"], 0.02)
    np.testing.assert_array_equal(rims("mine.obj", mesh, [], 0.02), 0)


def shirt(body, lowered_deg=0.0):
    """A part of a body's surface, a little larger: a shirt with sleeves to the elbows."""
    pose = REST_POSE.copy()
    for joint, sign in (("left_shoulder", -1), ("right_shoulder", 1)):
        pose[3 * JOINT_NAMES.index(joint) + 2] = sign * np.deg2rad(lowered_deg)
    posed, _ = posed_vertices(body, np.zeros(10), pose[None])
    parts = ["spine1", "spine2", "spine3"]
    parts += [f"{side}_{part}" for side in ("left", "right") for part in ("collar", "shoulder")]
    covered = np.isin(body.segmentation, [JOINT_NAMES.index(part) for part in parts])
    faces = faces_within(body.faces, covered)
    points = posed[0] + 0.015 * vertex_normals(posed[0], body.faces)
    used = np.unique(faces)
    return Mesh(points[used].astype(np.float32), np.searchsorted(used, faces).astype(np.int32))


Y_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # its columns are X, Y and Z in such a file


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda points: points @ Y_UP, "turned by 90 degrees about X"),
        (lambda points: points @ Y_UP.T, "turned by -90 degrees about X"),
        (lambda points: points[:, [1, 0, 2]] * [-1, 1, 1], "turned by -90 degrees about Z"),
        (lambda points: points + [1.5, 0, 0], r"moved by \(-1.50, "),
        (lambda points: points * 0.5, "scaled by about 2"),
        (lambda points: points * 100, "its unit is centimetres"),
        (lambda points: points / 0.0254, "its unit is inches"),
        (lambda points: points * 1000, "its unit is millimetres"),
        (lambda points: points @ Y_UP * 100, "about X and its unit is centimetres"),
    ],
)
def test_what_would_mend_a_wrong_axis_place_or_scale_is_said(tmp_path, toy_body, change, words):
    mesh = shirt(toy_body)
    load_user_garment(saved(tmp_path, mesh), toy_body)
    path = saved(tmp_path, mesh, vertices=change(mesh.vertices))
    with pytest.raises(InputError, match=rf"mine\.obj: .*it fits if .*{words}"):
        load_user_garment(path, toy_body)
    mended = saved(tmp_path, load_user_garment(path, toy_body, mend=True))
    load_user_garment(mended, toy_body)


def test_a_skirt_for_a_body_with_its_feet_at_zero_is_told_the_floor(tmp_path, skirt, toy_body):
    floor = rest_body(toy_body, np.zeros(10))[:, 2].min()
    path = saved(tmp_path, skirt, vertices=skirt.vertices - [0, 0, floor])
    with pytest.raises(InputError, match=rf"fits if moved by \(0.00, 0.00, {floor:.2f}\) m"):
        load_user_garment(path, toy_body)


def test_sleeves_beside_the_arms_are_refused_with_their_pose(tmp_path, toy_body):
    path = saved(tmp_path, shirt(toy_body, lowered_deg=50))
    with pytest.raises(
        InputError, match="left arm passes through no opening.*arms are raised by about [45]0 deg"
    ):
        load_user_garment(path, toy_body, mend=True)


def test_an_opening_that_nobody_passes_may_be_there(tmp_path, skirt, toy_body):
    # A window of 3 x 3 faces at the back.
    rows, around = np.divmod(np.arange(len(skirt.faces)), 32)
    window = (abs(rows - 4) < 2) & (abs(around - 8) < 2)
    mesh = load_user_garment(saved(tmp_path, skirt, faces=skirt.faces[~window]), toy_body)
    assert len(boundary_loops(mesh.faces)) == 3


def test_vertices_without_faces_are_left_out(tmp_path, skirt, toy_body, caplog):
    strays = np.float32([[0, 0, -1], [5, 5, 5]])
    path = saved(tmp_path, skirt, vertices=np.concatenate([strays, skirt.vertices]))
    save_obj(path, Mesh(np.concatenate([strays, skirt.vertices]), skirt.faces + 2))
    mesh = load_user_garment(path, toy_body)
    np.testing.assert_array_equal(mesh.faces, skirt.faces)
    assert len(mesh.vertices) == len(skirt.vertices)
    assert "2 vertices that are in no face" in caplog.text


def test_a_file_that_lacks_faces_is_refused(tmp_path, skirt, toy_body):
    path = saved(tmp_path, skirt, faces=skirt.faces[:100])
    with pytest.raises(InputError, match="are in no face.*cut off"):
        load_user_garment(path, toy_body)


def panels(mesh):
    """Front and back of a mesh, each with vertices of its own."""
    front = mesh.vertices[mesh.faces, 1].mean(axis=1) < 0
    sheets = [mesh.faces[front], mesh.faces[~front]]
    points = [mesh.vertices[np.unique(sheet)] for sheet in sheets]
    faces = [np.searchsorted(np.unique(sheet), sheet) for sheet in sheets]
    return joined(*zip(points, faces, strict=True))


def test_panels_are_joined_along_their_seams(tmp_path, skirt, toy_body, caplog):
    mesh = load_user_garment(saved(tmp_path, panels(skirt)), toy_body)
    assert len(mesh.vertices) == len(skirt.vertices)
    assert sorted(map(len, boundary_loops(mesh.faces))) == [32, 32]
    assert "joined along seams" in caplog.text


def test_parts_that_no_seam_joins_are_counted(tmp_path, skirt, toy_body):
    apart = panels(skirt)
    apart.vertices[len(apart.vertices) // 2 :] += np.float32([0, 0.01, 0])
    with pytest.raises(InputError, match="2 parts that no edge joins, expected one"):
        load_user_garment(saved(tmp_path, apart), toy_body)


def test_non_manifold_edges_are_named(tmp_path, skirt, toy_body):
    extra = np.array([[0, 1, 100, 101], [0, 1, 150, 151]], dtype=np.int32)
    path = saved(tmp_path, skirt, faces=np.concatenate([skirt.faces, extra]))
    with pytest.raises(InputError, match=r"mine\.obj.*non-manifold.*vertices 1 and 2 with 3 faces"):
        load_user_garment(path, toy_body)


def test_faces_turned_against_each_other_are_refused(tmp_path, skirt, toy_body):
    faces = skirt.faces.copy()
    faces[5] = faces[5][::-1]
    with pytest.raises(InputError, match="turned the same way"):
        load_user_garment(saved(tmp_path, skirt, faces=faces), toy_body)


def test_values_that_are_no_numbers_are_refused(tmp_path, skirt, toy_body):
    vertices = skirt.vertices.copy()
    vertices[7, 1] = np.nan
    with pytest.raises(InputError, match="vertex 8 is not finite"):
        load_user_garment(saved(tmp_path, skirt, vertices=vertices), toy_body)


def test_a_closed_surface_is_no_garment(tmp_path, toy_body):
    box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float32)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    mesh = Mesh(box * 0.4, np.array(faces, dtype=np.int32))
    with pytest.raises(InputError, match="closed surface"):
        load_user_garment(saved(tmp_path, mesh), toy_body)


def test_a_missing_file_is_named(tmp_path, toy_body):
    with pytest.raises(InputError, match=r"nothing\.obj"):
        load_user_garment(tmp_path / "nothing.obj", toy_body)
