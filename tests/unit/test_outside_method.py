"""The example of a method from elsewhere, on bodies and cloth that move as a whole."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.bodies.rest_body import rest_body
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import edges
from drapeline.geometry.obj import load_obj, save_obj
from drapeline.metrics.table import METRICS_FILE, read_metrics
from drapeline.models.protocol import score, write_protocol
from drapeline.storage import save_npz
from toys.bodies import save_toy_bodies
from toys.jobs import job_of
from toys.people import standing_person, turned_person
from toys.protocol import TOLD, save_cases

TURN = Rotation.from_euler("zyx", [70, 20, -30], degrees=True)
PLACE = np.array([0.5, -0.25, 1.0])


@pytest.fixture(scope="module")
def method():
    path = Path(__file__).parents[2] / "examples/outside_method.py"
    return SimpleNamespace(**runpy.run_path(str(path)))


@pytest.fixture(scope="module")
def sheet():
    return standing_person().rest["Skirt"]


@pytest.mark.parametrize("weight", [1e-4, 1.0])
def test_cloth_whose_goals_move_as_a_whole_follows_them(method, sheet, weight):
    rest = sheet.vertices.astype(float)
    cloth, weights = method.RigidCloth(rest, edges(sheet.faces)), np.full(len(rest), weight)
    for goals in (rest, TURN.apply(rest) + PLACE):
        np.testing.assert_allclose(cloth.fit(goals, goals, weights), goals, atol=1e-9)


def test_a_mirror_image_is_another_shape(method, sheet):
    rest = sheet.vertices.astype(float)
    cloth, weights = method.RigidCloth(rest, edges(sheet.faces)), np.full(len(rest), 1e-4)
    image = rest * [-1, 1, 1]
    assert np.abs(cloth.fit(image, image, weights) - image).max() > 1e-3


def test_cloth_keeps_its_shape_where_nothing_holds_it(method, sheet):
    """The upper half is held where it is, the lower one begins stretched."""
    rest = sheet.vertices.astype(float)
    held = rest[:, 2] > np.median(rest[:, 2])
    start = rest * [1, 1, 1.2]
    start[held] = rest[held]
    weights = np.where(held, 1.0, 0.0)
    found = method.RigidCloth(rest, edges(sheet.faces)).fit(start, start, weights)
    assert np.abs(found - rest).max() < 0.1 * np.abs(start - rest).max()


def test_ways_off_the_skin_turn_with_it(method, toy_body):
    skin = rest_body(toy_body, np.zeros(10))
    rng = np.random.default_rng(0)
    near = rng.integers(len(skin), size=50)
    away = rng.normal(size=(50, 3))
    found = method.turned(away, skin, TURN.apply(skin) + PLACE, near, toy_body.faces)
    np.testing.assert_allclose(found, TURN.apply(away), atol=1e-6)


@pytest.mark.parametrize("turn", [Rotation.identity(), TURN])
def test_a_body_that_turns_as_a_whole_takes_its_cloth_along(method, tmp_path, turn):
    protocol, person = tmp_path / "protocol", turned_person(turn)
    save_toy_bodies(protocol / "bodies")
    save_npz(protocol / "bodies/rest_pose.npz", rest_pose=REST_POSE)
    case = protocol / "motion/00001_002"
    about = {name: getattr(person, name) for name in ("gender", "shape", "poses", "trans")}
    save_npz(case / "wearer.npz", **about)
    for name, mesh in person.rest.items():
        save_obj(case / f"{name}.obj", mesh)
    method.main(protocol, tmp_path / "arap")
    for name, mesh in person.rest.items():
        found = load_obj(tmp_path / f"arap/motion/00001_002/{name}.obj")
        np.testing.assert_array_equal(found.faces, mesh.faces)
        moved = turn.apply(mesh.vertices) + person.trans[-1]
        np.testing.assert_allclose(found.vertices, moved, atol=1e-4)


def test_it_answers_all_cases_of_a_protocol(method, tmp_path, toy_body):
    given = save_cases(tmp_path / "cases", toy_body, window=1)
    write_protocol(job_of(given, tmp_path / "protocol", **TOLD))
    method.main(tmp_path / "protocol", tmp_path / "arap")
    score(job_of(given, tmp_path / "scored", predictions=str(tmp_path / "arap"), **TOLD))
    rows = read_metrics(tmp_path / "scored" / METRICS_FILE)
    assert {*rows["model"]} == {"moved"}
    assert {*rows["variant"]} == {"arap"}
