"""Garments in the topology of their templates."""

import csv

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import vertex_normals
from drapeline.registration.error_table import FILE_NAME
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.remesh import (
    NamedGarment,
    RemeshTable,
    flipped_faces,
    load_tables,
    remesh,
    remesh_table,
    residual,
    write_tables,
)
from drapeline.registration.to_template.template_fit import fit_to_template
from drapeline.storage import load_npz, save_npz
from toys.templates import round_skirt, toy_skirt, toy_template

TABLE = RemeshTable(
    np.array([[0, 1, 2], [2, 2, 0]], dtype=np.int32),
    np.array([[0.25, 0.5, 0.25], [0.5, 0.5, 0.0]], dtype=np.float32),
)


def test_template_vertices_follow_their_corners_in_every_frame():
    cloth = np.array([[0, 0, 0], [4, 0, 0], [0, 8, 0]], dtype=np.float32)
    frames = np.stack([cloth, cloth + 1])
    np.testing.assert_allclose(remesh(cloth, TABLE), [[2, 2, 0], [0, 8, 0]])
    np.testing.assert_allclose(
        remesh(frames, TABLE), [[[2, 2, 0], [0, 8, 0]], [[3, 3, 1], [1, 9, 1]]]
    )


@pytest.fixture
def folders(tmp_path):
    for number, name in enumerate(("s1", "s2")):
        arrays = {f"{name}/{key}": value for key, value in TABLE._asdict().items()}
        save_npz(tmp_path / str(number) / "tables.npz", **arrays)
    return [tmp_path / "0", tmp_path / "1"]


def test_tables_of_all_folders_are_read_by_name(folders):
    tables = load_tables(folders)
    assert set(tables) == {"s1", "s2"}
    np.testing.assert_array_equal(tables["s2"].shares, TABLE.shares)


def test_a_table_without_shares_is_refused(folders):
    arrays = load_npz(folders[1] / "tables.npz", {"*": "number ..."})
    del arrays["s2/shares"]
    save_npz(folders[1] / "tables.npz", **arrays)
    with pytest.raises(InputError, match=r"1/tables\.npz: lacks s2/shares"):
        load_tables(folders)


def test_a_missing_or_damaged_file_of_tables_is_named(folders):
    (folders[1] / "tables.npz").write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"1/tables\.npz: "):
        load_tables(folders)
    (folders[1] / "tables.npz").unlink()
    with pytest.raises(InputError, match=r"1/tables\.npz: no such file"):
        load_tables(folders)


def test_rows_of_a_table_are_shares(template):
    vertices, triangles = round_skirt(around=40, rows=20)
    table = remesh_table(fit_to_template(vertices, triangles, template))
    assert table.corners.dtype == np.int32
    assert table.shares.dtype == np.float32
    assert (table.shares >= 0).all()
    np.testing.assert_allclose(table.shares.sum(axis=1), 1, atol=1e-6)


def test_frames_follow_affine_motions_one_by_one_or_together(template):
    vertices, triangles = round_skirt(around=40, rows=20)
    table = remesh_table(fit_to_template(vertices, triangles, template))
    rng = np.random.default_rng(0)
    turn, shift = rng.normal(0, 1, (3, 3)), rng.normal(0, 1, 3)
    frames = np.stack([vertices, vertices @ turn + shift])
    both = remesh(frames, table)
    np.testing.assert_allclose(both[1], both[0] @ turn + shift, atol=1e-6)
    np.testing.assert_array_equal(both[1], remesh(frames[1], table))


def test_faces_turned_over_are_counted(template):
    vertices, faces = template.vertices.astype(float), template.faces
    itself = RemeshTable(np.arange(len(vertices))[:, None].repeat(3, 1), np.full((1, 3), 1 / 3))
    assert not flipped_faces(itself, faces, vertices, faces).any()
    turned = faces.copy()
    turned[[3, 40, 41]] = turned[[3, 40, 41], ::-1]
    found = flipped_faces(itself, turned, vertices, faces)
    assert np.flatnonzero(found).tolist() == [3, 40, 41]


def test_a_folded_fit_comes_out_without_turned_faces(template):
    vertices, triangles = round_skirt(around=40, rows=21)
    fit = fit_to_template(vertices, triangles, template, TemplateFitSettings(iterations=0))
    crumpled = fit.vertices.copy()
    patch = np.linalg.norm(crumpled - [0.2, 0, -0.25], axis=1) < 0.07
    crumpled[patch] = 2 * crumpled[patch].mean(axis=0) - crumpled[patch]
    table = remesh_table(fit._replace(vertices=crumpled))
    assert residual(vertices, triangles, template, table).flipped_faces == 0


def test_a_vertex_that_meets_cloth_facing_away_goes_to_the_nearest_that_does_not(template):
    vertices, faces = template.vertices.astype(float), template.faces
    fit = fit_to_template(vertices, faces, template, TemplateFitSettings(iterations=0))
    normals = vertex_normals(fit.vertices, fit.triangles)
    one = int(np.flatnonzero(template.loop < 0)[0])
    beside, corners = np.unique(faces[(faces == one).any(axis=1)], return_inverse=True)
    sheet, lid = fit.vertices - 0.004 * normals, (fit.vertices + 0.001 * normals)[beside]
    lid_faces = len(sheet) + corners.reshape(-1, 3)[:, ::-1]
    cloth = np.concatenate([sheet, lid])
    triangles = np.concatenate([fit.triangles, lid_faces])
    table = remesh_table(fit._replace(vertices=cloth, rest=cloth, triangles=triangles))
    np.testing.assert_allclose(remesh(cloth, table)[one], sheet[one], atol=1e-7)


@pytest.fixture(scope="module")
def template():
    return toy_template()


@pytest.fixture
def folder(tmp_path, template):
    garments = [
        NamedGarment("s1", "Skirt", *toy_skirt(0.25, -0.4)),
        NamedGarment("s1", "Top", *toy_skirt(0.1, -0.4)),
        NamedGarment("s2", "Skirt", *toy_skirt(0.2, -0.7, around=26)),
    ]
    settings = TemplateFitSettings(iterations=3)
    assert write_tables(tmp_path / "fits", garments, "Skirt", template, settings) == 2
    return tmp_path / "fits"


def test_tables_carry_every_garment_of_a_type_and_its_residuals(folder, template):
    tables = load_tables([folder])
    assert set(tables) == {"s1", "s2"}
    for name, radius, low, around in (("s1", 0.25, -0.4, 20), ("s2", 0.2, -0.7, 26)):
        vertices, _ = toy_skirt(radius, low, around=around)
        new = remesh(vertices, tables[name])
        assert new.shape == template.vertices.shape
        assert new[:, 2].min() == pytest.approx(low, abs=1e-3)
        assert new[:, 2].max() == pytest.approx(0, abs=1e-3)
    with open(folder / FILE_NAME, newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    assert {(row["garment"], row["name"]) for row in rows} == {("Skirt", "s1"), ("Skirt", "s2")}
    assert {row["unit"] for row in rows if row["metric"].endswith("_mm")} == {"mm"}
    assert {row["value"] for row in rows if row["metric"] == "flipped_faces"} == {"0"}


def test_a_shard_that_nobody_wears_the_type_in_has_no_tables(tmp_path, template):
    garments = [NamedGarment("s1", "Top", *toy_skirt(0.1, -0.4))]
    folder = tmp_path / "fits"
    assert write_tables(folder, garments, "Skirt", template, TemplateFitSettings()) == 0
    assert load_tables([folder]) == {}
    assert (folder / FILE_NAME).exists()


def test_a_garment_without_an_opening_is_named(tmp_path, template):
    vertices, faces = toy_skirt(0.2, -0.5)
    closed = np.concatenate([faces, [[k, 0, (k + 1) % 20] for k in range(1, 19)]])
    with pytest.raises(InputError, match=r"s7/Skirt: the garment has no (waist|hem)"):
        write_tables(
            tmp_path / "fits",
            [NamedGarment("s7", "Skirt", vertices, closed)],
            "Skirt",
            template,
            TemplateFitSettings(),
        )
    assert not (tmp_path / "fits").exists()
