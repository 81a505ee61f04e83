import json
import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.model import posed_vertices
from drapeline.bodies.sequence import body_sequence_vertices, collision_faces, first_frames
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import mean_edge_length
from drapeline.geometry.point_cache import PointCache
from drapeline.outfits.fabrics import FABRICS
from drapeline.outfits.garment_types import GARMENTS
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import (
    body_frames,
    place_at_start,
    rising_floor,
    simulate_outfit,
    transition_path,
    transition_poses,
)
from drapeline.simulation.solver import ClothSolver
from toys.cloth import FRAMES, Follower, dress, skirt


def test_the_floor_rises_beneath_body_and_cloth_to_zero():
    floor_m = rising_floor(np.array([-0.3, -0.3, -0.1, 0.2]), -0.4, 6)
    np.testing.assert_allclose(floor_m, [-0.4, -0.4 * (1 - 5 / 32), -0.2, -0.4 * 5 / 32, 0, 0])
    floor_m = rising_floor(np.array([-0.3, -0.3, -0.25, 0.2]), 0.5, 5)
    np.testing.assert_allclose(floor_m, [-0.3, -0.3, -0.25, 0, 0])


def turns(poses):
    return Rotation.from_rotvec(poses.reshape(-1, 3))


def test_transition_of_a_still_pose_turns_every_joint_straight_there():
    first = np.array(REST_POSE)
    first[3 * 16 : 3 * 17] = [0, 0, -1.2]
    poses = transition_poses(first, first, 9)
    np.testing.assert_allclose(poses[0], REST_POSE, atol=1e-12)
    angle = poses.reshape(10, 24, 3)[:, 16, 2]
    assert np.all(np.diff(angle) < 0)
    assert angle[5] == pytest.approx(-0.6)  # half-way in the middle
    others = np.delete(poses.reshape(10, 24, 3), 16, axis=1)
    np.testing.assert_allclose(
        others,
        np.broadcast_to(np.delete(REST_POSE.reshape(24, 3), 16, axis=0), (10, 23, 3)),
        atol=1e-12,
    )


def test_transition_meets_the_sequence_at_its_speed():
    rng = np.random.default_rng(0)
    first, second = REST_POSE + 0.4 * rng.normal(size=(2, 72))
    second = first + 0.05 * (second - first)
    poses = transition_poses(first, second, 30)
    last = (turns(poses[-1]).inv() * turns(first)).as_rotvec()
    own = (turns(first).inv() * turns(second)).as_rotvec()
    assert np.linalg.norm(last - own) < 0.35 * np.linalg.norm(own)


@pytest.mark.parametrize("angle", [2.2, 2.3, 2.4])
def test_a_joint_keeps_the_direction_in_which_it_turns(angle):
    """The shortest way to where it was some frames before the sequence is the other one."""
    first, second = np.array(REST_POSE), np.array(REST_POSE)
    first[3 * 16 : 3 * 17] = [angle, 0, 0]
    second[3 * 16 : 3 * 17] = [angle - 0.3, 0, 0]
    shoulder = turns(transition_poses(first, second, 8)).as_matrix().reshape(9, 24, 3, 3)[:, 16]
    steps = Rotation.from_matrix(shoulder[:-1].swapaxes(1, 2) @ shoulder[1:]).magnitude()
    assert steps.max() < 0.8


def test_a_body_that_stands_on_its_head_does_so_from_the_beginning():
    first = np.array(REST_POSE)
    first[:3] = (Rotation.from_rotvec([0, np.pi, 0]) * Rotation.from_rotvec(first[:3])).as_rotvec()
    poses = transition_poses(first, first, 20)
    root = turns(poses).as_matrix().reshape(21, 24, 3, 3)[:, 0]
    np.testing.assert_allclose(root @ [0, 1, 0], np.tile([0, 0, -1], (21, 1)), atol=1e-12)
    np.testing.assert_allclose(poses[:, 3:], np.tile(REST_POSE[3:], (21, 1)), atol=1e-12)


def test_path_ends_at_speed_and_starts_at_rest():
    path = transition_path(np.array([1.0, 0, 0.9]), np.array([1.1, 0, 0.9]), 40)
    assert len(path) == 41
    steps = np.diff(path[:, 0])
    assert steps[0] == pytest.approx(0, abs=1e-4)
    assert steps[-1] == pytest.approx(0.1, rel=0.4)
    assert np.all(steps > 0)


@pytest.fixture
def record(toy_body):
    poses = np.tile(REST_POSE, (5, 1))
    poses[:, 3 * 16 + 2] = -0.3 + 0.01 * np.arange(5)
    trans = np.array([0.3, 0.1, 1.0]) + 0.02 * np.arange(5)[:, None]
    return make_body_sequence(toy_body, np.zeros(10), poses, trans, gender="female")


def test_frames_go_from_the_garments_shape_to_the_sequence(toy_body, record):
    wide = np.array([1.0, -1.0, *np.zeros(8)])
    frames = list(
        body_frames(toy_body, record, wide, shape_frames=3, pose_frames=4, settle_frames=2)
    )
    assert len(frames) == 3 + 1 + 4 + 2 + 5
    for index, shape in ((0, wide), (3, record.shape)):
        rest = posed_vertices(toy_body, shape, REST_POSE[None].copy())[0][0]
        np.testing.assert_allclose(frames[index], place_at_start(rest, record, 4), atol=1e-5)
    own = posed_vertices(toy_body, record.shape, record.poses, record.trans)[0]
    np.testing.assert_allclose(np.stack(frames[-5:]), own, atol=1e-5)
    np.testing.assert_allclose(frames[-7:-5], [frames[-5]] * 2, atol=1e-6)


def test_garments_begin_on_the_body_however_it_is_turned(toy_body, record):
    poses = record.poses.copy()
    turn = Rotation.from_rotvec([0.4, -1.1, 2.0])
    poses[:, :3] = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    turned = replace(record, poses=poses)
    start = next(
        body_frames(toy_body, turned, record.shape, shape_frames=3, pose_frames=4, settle_frames=2)
    )
    rest = posed_vertices(toy_body, record.shape, REST_POSE[None].copy())[0][0]
    np.testing.assert_allclose(place_at_start(rest, turned, 4), start, atol=1e-5)
    upright = place_at_start(rest, record, 4)
    middle = transition_path(record.trans[0], record.trans[1], 4)[0]
    np.testing.assert_allclose(start, turn.apply(upright - middle) + middle, atol=1e-5)


def test_corrections_of_the_first_frame_come_in_gradually(toy_body, record):
    vertex = 7
    fixed = replace(
        record,
        fix_frame=np.array([0], dtype=np.int32),
        fix_vertex=np.array([vertex], dtype=np.int32),
        fix_delta=np.array([[0, 0, 0.1]], dtype=np.float32),
    )
    arguments = {"shape_frames": 2, "pose_frames": 8, "settle_frames": 1}
    plain = np.stack(list(body_frames(toy_body, record, record.shape, **arguments)))
    moved = np.stack(list(body_frames(toy_body, fixed, record.shape, **arguments)))
    lift = (moved - plain)[:, vertex, 2]
    assert lift[2] == 0
    assert np.all(np.diff(lift[2:12]) > 0)
    assert lift[11:13] == pytest.approx([0.1, 0.1], abs=1e-6)
    assert lift[13] == 0


LOOSE = HealthBounds(stretch_low=0, stretch_high=9, depth_m=1)
SHORT = SimulationSettings(
    steps_min=6, steps_max=6, shape_frames=2, pose_frames=3, settle_frames=1, attempts=2
)
LEAD = 2 + 1 + 3 + 1
LAST = LEAD + FRAMES - 1


@pytest.fixture
def dressed(toy_body):
    return dress(toy_body)


@pytest.fixture
def simulate(tmp_path, dressed):
    def run(solver: ClothSolver, bounds=LOOSE, dressed=dressed, **settings):
        folder = tmp_path / "results" / "00001"
        return simulate_outfit(
            folder, dressed, solver, settings=SHORT.replace(**settings), bounds=bounds
        ), folder

    return run


def contents(folder):
    return sorted(path.name for path in folder.iterdir())


def sink(frame, vertices, followed, attempt):
    """Cloth that ends up in the middle of the body."""
    return vertices if frame < LEAD else vertices + 2 * (followed - vertices)


def test_an_accepted_sample_has_the_frames_of_the_sequence_alone(simulate, dressed):
    status, folder = simulate(Follower())
    assert (status["status"], status["reason"]) == ("accepted", "")
    assert json.loads((folder / "status.json").read_text()) == status
    assert contents(folder) == ["Skirt.f32", "health.npz", "status.json"]
    with PointCache(folder / "Skirt.f32", len(skirt().vertices)) as cache:
        frames = cache.frames()
    # Relative to the root, the cloth has made the same way as the body's waist.
    bodies = np.stack([*body_sequence_vertices(dressed.body, dressed.motion)])
    assert len(frames) == FRAMES
    way = np.linalg.norm(frames[-1] - frames[0], axis=1).max()
    assert 0 < way < np.linalg.norm(bodies[-1] - bodies[0], axis=1).max()
    assert np.abs(frames[:, :36].mean(axis=1) - skirt().vertices[:36].mean(axis=0)).max() < 0.02
    with np.load(folder / "health.npz") as health:
        assert health["inside_share"].shape == (FRAMES, 1)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("count", "accelerates"), [(1, False), (2, False), (3, True)])
def test_a_sample_of_few_frames_has_the_measures_that_there_are(
    simulate, dressed, count, accelerates
):
    short = replace(dressed, motion=first_frames(dressed.motion, count))
    status, _ = simulate(Follower(), dressed=short)
    assert status["status"] == "accepted"
    measures = status["attempts"][-1]["measures"]
    assert ("acceleration_m_s2" in measures) == accelerates
    assert np.isfinite([*measures.values()]).all()


def test_the_status_says_what_made_the_sample(simulate):
    status, _ = simulate(Follower())
    assert status["solver"] == {"name": "follower", "settings": {"neighbours": 1}}
    assert status["versions"] == {"follower": "1", "numpy": np.__version__}
    cotton = {**asdict(FABRICS["cotton"]), "garments": list(GARMENTS)}
    assert status["fabrics"] == {"Skirt": cotton}
    (attempt,) = status["attempts"]
    assert attempt["steps"] == 6
    assert attempt["measures"]["inside_open_max"] < 0.05
    assert status["frames_per_second"] == attempt["frames_per_second"] > 0


def test_cloth_that_sinks_into_the_body_is_tried_finer_and_rejected(simulate):
    status, folder = simulate(Follower(sink), collider_share=0.5)
    assert status["status"] == "rejected"
    assert "inside_open" in status["reason"]
    first, second = status["attempts"]
    assert second["steps"] > first["steps"]
    assert second["pose_frames"] > first["pose_frames"]
    assert (first["collider_share"], second["collider_share"]) == (0.5, 1)
    assert contents(folder) == ["status.json"]


def test_a_finer_attempt_may_be_accepted(simulate):
    def sink_if_coarse(frame, vertices, followed, attempt):
        coarse = attempt.steps == 6
        return sink(frame, vertices, followed, attempt) if coarse else vertices

    status, folder = simulate(Follower(sink_if_coarse))
    assert status["status"] == "accepted"
    assert [attempt["status"] for attempt in status["attempts"]] == ["rejected", "accepted"]
    assert contents(folder) == ["Skirt.f32", "health.npz", "status.json"]
    with PointCache(folder / "Skirt.f32", len(skirt().vertices)) as cache:
        assert len(cache) == FRAMES


def test_an_attempt_that_cannot_come_back_into_bounds_ends_at_once(simulate):
    seen = []

    def sink_and_tell(frame, vertices, followed, attempt):
        seen.append(frame)
        return sink(frame, vertices, followed, attempt)

    status, _ = simulate(Follower(sink_and_tell), LOOSE.replace(inside_open_max=0.1), attempts=1)
    assert re.fullmatch(
        r"inside_open_\w+ .*; inside_open_max .* at most 0.1 \(by frame 0\)", status["reason"]
    )
    assert "measures" not in status["attempts"][0]
    assert max(seen) == LEAD


def test_a_measure_out_of_bounds_at_the_end_is_named(simulate):
    status, folder = simulate(Follower(), LOOSE.replace(stretch_low=1), attempts=1)
    assert status["status"] == "rejected"
    assert re.fullmatch(r"stretch_low \S+, expected at least 1", status["reason"])
    assert status["attempts"][0]["measures"]["stretch_low"] < 1.5
    assert contents(folder) == ["status.json"]


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (LAST, "a vertex is not finite 5 frames into the sequence"),
        (LEAD - 2, "a vertex is not finite -2 frames into the sequence"),
    ],
)
def test_cloth_that_is_not_finite_is_a_failure(simulate, frame, reason):
    def explode(index, vertices, followed, attempt):
        return np.full_like(vertices, np.nan) if index == frame else vertices

    status, folder = simulate(Follower(explode), attempts=1)
    assert (status["status"], status["reason"]) == ("failed", reason)
    assert contents(folder) == ["status.json"]


def test_a_breakdown_is_a_result_with_its_reason(simulate):
    def break_down(frame, vertices, followed, attempt):
        if frame == LAST:
            raise RuntimeError("no memory for cloth")
        return vertices

    status, folder = simulate(Follower(break_down))
    assert (status["status"], status["reason"]) == ("failed", "no memory for cloth")
    assert len(status["attempts"]) == 2
    assert contents(folder) == ["status.json"]


def test_a_solver_that_ends_early_or_loses_vertices_is_not_believed(simulate):
    class Early(Follower):
        def simulate(self, garments, body, attempt, scratch):
            frames = super().simulate(garments, body, attempt, scratch)
            yield from (next(frames) for _ in range(len(body) - 1))

    status, folder = simulate(Early(), attempts=1)
    expected = "follower ended 5 frames into the sequence, expected 6"
    assert (status["status"], status["reason"]) == ("failed", expected)
    status, _ = simulate(Follower(lambda frame, vertices, *_: vertices[1:]), attempts=1)
    assert status["status"] == "failed"
    assert "expected (N, 288, 3)" in status["reason"]
    assert contents(folder) == ["status.json"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError])
def test_an_end_from_outside_leaves_nothing(simulate, tmp_path, error):
    def stop(frame, vertices, followed, attempt):
        if frame == LAST:
            raise error("the disk is full")
        return vertices

    with pytest.raises(error):
        simulate(Follower(stop))
    assert not list((tmp_path / "results").iterdir())


def test_a_body_that_was_rejected_is_not_simulated(simulate, dressed):
    bad = replace(dressed.motion, outcome="rejected", reason="arms cross the trunk")
    status, folder = simulate(Follower(), dressed=replace(dressed, motion=bad))
    assert (status["status"], status["reason"]) == ("rejected", "arms cross the trunk")
    assert (status["attempts"], status["frames_per_second"]) == ([], 0)
    assert contents(folder) == ["status.json"]


def test_a_fabric_that_is_not_in_the_table_is_refused(simulate, dressed):
    attributes = {**dressed.outfit.garments[0].attributes, "fabric": "tin"}
    garment = replace(dressed.outfit.garments[0], attributes=attributes)
    tinned = replace(dressed, outfit=replace(dressed.outfit, garments=(garment,)))
    with pytest.raises(InputError, match=r"Skirt is of 'tin', expected .*denim"):
        simulate(Follower(), dressed=tinned)


def test_there_may_be_no_floor(simulate):
    seen = []

    class Watcher(Follower):
        def simulate(self, garments, body, attempt, scratch):
            seen.append(body.floor_m)
            yield from super().simulate(garments, body, attempt, scratch)

    simulate(Watcher(), floor=False)
    assert seen == [None]


def test_what_a_solver_is_given(simulate, dressed):
    seen = []

    class Watcher(Follower):
        def simulate(self, garments, body, attempt, scratch):
            first, last = body.frame(0), body.frame(len(body) - 1)
            (garment,) = garments
            held = [garment.pins.positions(k) for k in (0, len(body) - 1)]
            seen.append((garment, body, attempt, first, last, held, list(scratch.iterdir())))
            yield from super().simulate(garments, body, attempt, scratch)

    simulate(Watcher(), collider_share=0.5)
    ((garment, body, attempt, first, last, held, files),) = seen
    assert len(body) == attempt.lead_frames + FRAMES == LEAD + FRAMES
    assert attempt.gap_m == SHORT.gap_m
    assert files == []
    # In frame 0 the garment is at rest; the body ends up in the sequence's last frame.
    moved = garment.vertices - skirt().vertices
    np.testing.assert_allclose(moved, np.tile(moved[0], (len(moved), 1)), atol=1e-6)
    assert garment.edge_length_m == mean_edge_length(skirt().vertices, skirt().faces)
    bodies = [*body_sequence_vertices(dressed.body, dressed.motion, world=True)]
    assert KDTree(bodies[-1]).query(last)[0].max() < 1e-5
    # The floor begins beneath both, and lies at zero when the sequence begins.
    lowest_m = min(first[:, 2].min(), garment.vertices[:, 2].min(), 0)
    assert len(body.floor_m) == len(body)
    assert body.floor_m[0] <= lowest_m + 1e-6
    np.testing.assert_array_equal(body.floor_m[attempt.lead_frames :], np.zeros(FRAMES))
    # Hands, head and feet are out of reach, and half of the rest is left out.
    share = len(body.faces) / len(collision_faces(dressed.body, dressed.motion))
    assert 0.35 < share < 0.45
    assert body.faces.max() == len(first) - 1 == len(body.segments) - 1
    # The waistband starts where the garment is, and goes where the body goes.
    np.testing.assert_array_equal(garment.pins.vertices, np.arange(36))
    np.testing.assert_allclose(held[0], garment.vertices[:36], atol=1e-6)
    near = first[:, 2] > garment.vertices[:36, 2].mean() - 0.05
    near &= first[:, 2] < garment.vertices[:36, 2].mean() + 0.05
    way = (last - first)[near].mean(axis=0)
    np.testing.assert_allclose((held[1] - held[0]).mean(axis=0), way, atol=0.03)
