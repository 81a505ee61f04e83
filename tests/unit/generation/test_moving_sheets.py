"""Sheets on a moving toy body, by the fast solver."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.model import posed_vertices
from drapeline.bodies.sequence import body_sequence_vertices
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.generation import moving_sheets
from drapeline.generation.moving_sheets import SolverDraper, simulate_sheets
from drapeline.geometry.mesh import Mesh, edge_lengths, edges, mean_edge_length
from drapeline.simulation.settings import SimulationSettings
from drapeline.xpbd.solver import cloth_solver
from toys.bounds import NO_BOUNDS
from toys.smplicit import tube

SETTINGS = SimulationSettings(
    steps_min=6,
    steps_max=6,
    shape_frames=1,
    pose_frames=2,
    settle_frames=0,
    collider_share=1.0,
    attempts=1,
)


@pytest.fixture(scope="module")
def record(toy_body):
    poses = np.tile(REST_POSE, (4, 1))
    poses[:, 3 * 1] = np.linspace(0, -0.3, 4)  # the left leg rises
    path = np.zeros((4, 3))
    path[:, 0] = 0.01 * np.arange(4)
    return make_body_sequence(toy_body, np.zeros(10), poses, path, gender="female")


def simulate(sheets, toy_body, record, **changes):
    settings = {"edge_length_m": 0.01, "simulation": SETTINGS, "bounds": NO_BOUNDS, **changes}
    return {
        name: sheet.frames
        for name, sheet in simulate_sheets(
            sheets, toy_body, record, cloth_solver(1), **settings
        ).items()
    }


@pytest.fixture(scope="module")
def skirt():
    return tube(0.27, -0.5, 0.02, around=48, rings=14)


@pytest.fixture(scope="module")
def moved(toy_body, record, skirt):
    return simulate({"Skirt": skirt}, toy_body, record)["Skirt"]


def test_a_skirt_hangs_from_its_waist(record, skirt, moved):
    assert len(moved) == len(record.poses)
    waist, hem = (np.flatnonzero(skirt.vertices[:, 2] == z) for z in skirt.vertices[[-1, 0], 2])
    for sheet in moved:
        assert sheet.faces.tolist() == skirt.faces.tolist()
        change = sheet.vertices - skirt.vertices
        assert np.linalg.norm(change[waist], axis=1).max() < 0.02
        pairs = edges(skirt.faces)
        stretch = edge_lengths(sheet.vertices, pairs) / edge_lengths(skirt.vertices, pairs)
        assert np.percentile(stretch, 5) > 0.7
        assert np.percentile(stretch, 95) < 1.3
    assert (moved[-1].vertices - skirt.vertices)[hem, 2].mean() < 0.01


def test_what_is_not_held_falls(toy_body, record, skirt):
    (loose,) = simulate({"Dress": skirt}, toy_body, record).values()
    assert (loose[-1].vertices - skirt.vertices)[:, 2].mean() < -0.02


def test_fine_sheets_are_made_coarser(toy_body, record):
    fine = tube(0.27, -0.5, 0.02, around=120, rings=36)
    (moved,) = simulate({"Skirt": fine}, toy_body, record, edge_length_m=0.04).values()
    coarse = moved[0]
    assert len(coarse.vertices) < 0.5 * len(fine.vertices)
    assert mean_edge_length(coarse.vertices, coarse.faces) == pytest.approx(0.04, rel=0.2)
    assert np.isin(np.arange(len(coarse.vertices)), coarse.faces).all()


def test_sheets_in_the_body_start_outside_of_it(toy_body, record):
    body = body_sequence_vertices(toy_body, record)[0]
    tight = tube(0.12, -0.3, 0.02, around=48, rings=10)
    inside = np.linalg.norm(body[np.abs(body[:, 2] + 0.1) < 0.05][:, :2], axis=1).max()
    assert inside > 0.12  # else nothing is tight
    (moved,) = simulate({"Skirt": tight}, toy_body, record).values()
    assert np.isfinite([sheet.vertices for sheet in moved]).all()


def test_bad_input_is_refused(toy_body, record, skirt):
    nothing = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    with pytest.raises(InputError, match="Top: no faces, expected cloth to simulate"):
        simulate({"Skirt": skirt, "Top": nothing}, toy_body, record)
    with pytest.raises(InputError, match="sheets: no faces"):
        simulate({}, toy_body, record)
    strict = NO_BOUNDS.replace(stretch_low=0.999, stretch_high=1.001)
    with pytest.raises(InputError, match=r"Skirt: stretch_\w+ .*, expected at"):
        simulate({"Skirt": skirt}, toy_body, record, bounds=strict)


SITTING = REST_POSE.copy()
SITTING[3:9] += [-1.2, 0, 0, -1.2, 0, 0]
TRANS = np.array([0.3, -1.0, 2.0])
HANG = SolverDraper(cloth_solver(1), 3, 0.01, SETTINGS)


def hang(sheets, toy_body, turn, pose=SITTING):
    """Sheets on a body in a pose, in a world that was turned."""
    pose = pose.copy()
    pose[:3] = (turn * Rotation.from_rotvec(pose[:3])).as_rotvec()
    up = turn.apply([0.0, 0, 1])
    return HANG(sheets, toy_body, "female", np.zeros(10), pose, TRANS, up)


def test_a_skirt_hangs_on_a_sitting_body(toy_body, skirt):
    hung = hang({"Skirt": skirt}, toy_body, Rotation.identity())["Skirt"]
    assert hung.rest.vertices == pytest.approx(skirt.vertices, abs=1e-6)
    assert hung.posed.faces is hung.rest.faces
    body = posed_vertices(toy_body, np.zeros(10), SITTING[None], TRANS[None])[0][0]
    assert np.abs(hung.posed.vertices.mean(axis=0) - body.mean(axis=0)).max() < 0.4
    # Thighs that rise lift the front of it.
    front = skirt.vertices[:, 1] < -0.2
    low = skirt.vertices[:, 2] < -0.4
    rise = hung.posed.vertices[:, 2] - TRANS[2] - skirt.vertices[:, 2]
    assert rise[front & low].mean() > 0.05


def test_a_long_skirt_hangs_below_the_feet_of_a_body_in_the_air(toy_body):
    """There is no floor beneath a pose alone."""
    jump = REST_POSE.copy()
    jump[3:9] += [-1.9, 0, 0, -1.9, 0, 0]
    jump[12:18] += [2.2, 0, 0, 2.2, 0, 0]
    long = tube(0.4, -0.9, 0.02, around=48, rings=30)
    hung = hang({"Dress": long}, toy_body, Rotation.identity(), jump)["Dress"]
    body = posed_vertices(toy_body, np.zeros(10), jump[None], TRANS[None])[0][0]
    assert hung.posed.vertices[:, 2].min() < body[:, 2].min() - 0.05


@pytest.mark.parametrize("rotvec", [(np.pi, 0, 0), (-np.pi / 2, 0, 0), (0.3, -0.8, 0.4)])
def test_hanging_turns_with_the_world(toy_body, skirt, rotvec):
    turn = Rotation.from_rotvec(rotvec)
    # At rest, where cloth and body hardly touch; contacts make much of the last digit.
    upright, turned = (
        hang({"Skirt": skirt}, toy_body, way, REST_POSE)["Skirt"].posed
        for way in (Rotation.identity(), turn)
    )
    # What is turned is upright again for the solver, but may face another way.
    expected = turn.apply(upright.vertices - TRANS) + TRANS
    assert np.linalg.norm(turned.vertices - expected, axis=1).mean() < 0.004


def test_what_cannot_hang_is_left_out(toy_body, skirt, monkeypatch, caplog):
    nothing = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    still = Rotation.identity()
    assert hang({"Top": nothing}, toy_body, still) == {}
    assert list(hang({"Skirt": skirt, "Top": nothing}, toy_body, still)) == ["Skirt"]
    strict = NO_BOUNDS.replace(stretch_low=0.999, stretch_high=1.001)
    monkeypatch.setattr(moving_sheets, "WORN", strict)
    with caplog.at_level("INFO", logger="drapeline"):
        assert hang({"Skirt": skirt}, toy_body, still) == {}
    assert "skinned, not draped: Skirt: stretch_" in caplog.text
