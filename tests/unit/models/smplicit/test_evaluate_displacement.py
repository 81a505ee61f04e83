"""Measures of displaced and skinned garments, on skirts whose displacement is known."""

import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.pose_displacements import simulated_files
from drapeline.metrics.table import find_value
from drapeline.models.smplicit.displacement_baselines import ClusterDisplacement
from drapeline.models.smplicit.evaluate_displacement import (
    DisplacementEvaluation,
    motion_measures,
    surface_area,
)
from drapeline.models.smplicit.worn_displacement import WornDisplacement
from toys.displacement import CLUSTERS, known_displacement
from toys.displacement_trainings import toy_displacement
from toys.smplicit import toy_bodies, tube

VARIANTS = ("nearest", "smoothed", "mean", "ridge", "network", "other_pose", "at_rest", "untrained")


@pytest.fixture(scope="module")
def held_out(moving_skirts):
    folders = [tiny.folder for tiny in moving_skirts]
    return simulated_files(folders, ["Skirt"], ["test"], frame_step=2)


@pytest.fixture
def evaluation(displacements, toy_body):
    network, untrained = (toy_displacement(displacements, toy_body, seed=k) for k in (0, 1))
    baselines = ClusterDisplacement(displacements, toy_bodies(toy_body), CLUSTERS)
    return DisplacementEvaluation(network, untrained, baselines, toy_bodies(toy_body), seed=0)


def vertex_errors(rows):
    return {
        name: find_value(
            rows, f"smplicit_displacement_skirt_{name}", "test", "all", "vertex_error_mm"
        ).value
        for name in VARIANTS
    }


def test_every_way_of_posing_has_its_rows(evaluation, held_out, moving_skirts):
    rows = evaluation.run("test", held_out)
    assert len(set(rows["variant"])) == len(VARIANTS)
    assert set(rows["n"]) == {3}  # of six frames, every other
    assert set(rows["garment"]) == {"all", "Skirt"}
    assert len(set(rows["metric"])) == 6
    # Smoothed skinning lacks the displacement and nothing else.
    away = np.linalg.norm(known_displacement(moving_skirts[3].poses[::2]), axis=-1).mean()
    errors = vertex_errors(rows)
    assert errors["smoothed"] == pytest.approx(1000 * away, rel=0.05)
    assert errors["ridge"] < errors["mean"] < errors["smoothed"]


def test_a_network_that_knows_the_truth_has_no_error(evaluation, held_out, monkeypatch):
    def displace(self, points, weights, poses, motions):
        return np.broadcast_to(known_displacement(poses), (len(poses), len(points), 3))

    monkeypatch.setattr(WornDisplacement, "displace", displace)
    errors = vertex_errors(evaluation.run("test", held_out))
    assert errors["network"] == pytest.approx(0, abs=1e-2)
    # It goes by the poses that it is given.
    assert errors["other_pose"] > 1
    assert errors["at_rest"] > 1


def test_no_held_out_garment_is_refused(evaluation):
    with pytest.raises(InputError, match="test split wears a garment of the model 'skirt'"):
        evaluation.run("test", [])


def test_the_simulated_cloth_itself_has_no_error(toy_body):
    poses = np.zeros((1, 72))
    wearer = posed_vertices(toy_body, np.zeros(10), poses)[0][0]
    mesh = tube(0.5, -0.4, 0.0)
    found = motion_measures(mesh, mesh.vertices, wearer, toy_body.faces)
    assert found["vertex_error_mm"] == 0
    assert found["area_ratio"] == 1
    assert found["predicted_to_true_mm"] == pytest.approx(0, abs=1e-3)
    shifted = Mesh(mesh.vertices + np.float32([0, 0, 0.01]), mesh.faces)
    found = motion_measures(shifted, mesh.vertices, wearer, toy_body.faces)
    assert found["vertex_error_mm"] == pytest.approx(10, rel=1e-4)
    # All but the two rims slide along the cloth.
    assert found["predicted_to_true_mm"] == pytest.approx(10 / 9, rel=1e-3)
    wider = Mesh(mesh.vertices * np.float32([1, 1, 2]), mesh.faces)
    found = motion_measures(wider, mesh.vertices, wearer, toy_body.faces)
    assert found["area_ratio"] == pytest.approx(2)


def test_area_of_a_tube():
    around = 32
    perimeter = 2 * 0.3 * around * np.sin(np.pi / around)
    assert surface_area(tube(0.3, 0.0, 0.5, around)) == pytest.approx(0.5 * perimeter)
