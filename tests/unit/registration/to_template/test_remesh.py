"""Garments in the topology of their templates."""

import numpy as np

from drapeline.geometry.mesh import vertex_normals
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.remesh import flipped_faces, remesh_table, residual
from drapeline.registration.to_template.remesh_table import RemeshTable, remesh
from drapeline.registration.to_template.template_fit import fit_to_template
from toys.templates import round_skirt


def test_rows_of_a_table_are_shares(template):
    vertices, triangles = round_skirt(around=40, rows=20)
    table = remesh_table(fit_to_template(vertices, triangles, template), template)
    assert table.corners.dtype == np.int32
    assert table.shares.dtype == np.float32
    assert (table.shares >= 0).all()
    np.testing.assert_allclose(table.shares.sum(axis=1), 1, atol=1e-6)


def test_frames_follow_affine_motions_one_by_one_or_together(template):
    vertices, triangles = round_skirt(around=40, rows=20)
    table = remesh_table(fit_to_template(vertices, triangles, template), template)
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
    table = remesh_table(fit._replace(vertices=crumpled), template)
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
    table = remesh_table(fit._replace(vertices=cloth, rest=cloth, triangles=triangles), template)
    np.testing.assert_allclose(remesh(cloth, table)[one], sheet[one], atol=1e-7)
