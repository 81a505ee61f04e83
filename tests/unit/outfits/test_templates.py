"""The four templates, and their file."""

import numpy as np

from drapeline.geometry.mesh import (
    boundary_loops,
    edge_counts,
    mean_edge_length,
)
from drapeline.outfits.templates import load_templates


def test_templates_survive_their_file(templates, tmp_path):
    templates.save(tmp_path / "t.npz")
    back = load_templates(tmp_path / "t.npz")
    assert back.body_name == templates.body_name
    assert back.form.landmarks == templates.form.landmarks
    np.testing.assert_array_equal(back.form.torso.radius, templates.form.torso.radius)
    np.testing.assert_array_equal(back.form.upper.distance, templates.form.upper.distance)
    for name, mesh in templates.garments.items():
        np.testing.assert_array_equal(back.garments[name].vertices, mesh.vertices)


def test_the_four_templates_are_full_length_quads(templates):
    marks = templates.form.landmarks
    assert list(templates.garments) == ["Tshirt", "Top", "Trousers", "Skirt"]
    openings = {"Tshirt": 4, "Top": 4, "Trousers": 3, "Skirt": 2}
    for name, mesh in templates.garments.items():
        assert mesh.faces.shape[1] == mesh.uv_faces.shape[1] == 4
        assert edge_counts(mesh.faces)[1].max() == 2
        assert len(boundary_loops(mesh.faces)) == openings[name]
        assert abs(mean_edge_length(mesh.vertices, mesh.faces) - 0.01) < 0.003
    assert templates.garments["Tshirt"].vertices[:, 0].max() > marks["wrist_x"] - 0.01
    assert templates.garments["Trousers"].vertices[:, 2].min() < marks["ankle"] + 0.01
    assert templates.garments["Skirt"].vertices[:, 2].min() < marks["ankle"] + 0.01
