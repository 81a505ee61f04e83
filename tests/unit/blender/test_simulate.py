import json
from dataclasses import replace

import numpy as np
import pytest

from drapeline.blender import simulate
from drapeline.blender.cloth import simulate_cloth
from drapeline.blender.simulate import simulate_outfit
from drapeline.bodies.sequence import make_body_sequence
from drapeline.frames import REST_POSE
from drapeline.geometry.point_cache import PointCache
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.simulation.health import HealthBounds
from drapeline.simulation.settings import SimulationSettings

FRAMES = 6
LOOSE = HealthBounds(stretch_low=0, stretch_high=9)
SHORT = SimulationSettings(steps_min=6, steps_max=6, shape_frames=2, pose_frames=3, attempts=2)


def skirt(rows=8, around=36):
    """A cone from the toy body's waist, root-relative; the top row is held."""
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    share = np.repeat(np.linspace(0, 1, rows), around)
    radius = 0.15 + 0.08 * share
    points = np.stack(
        [
            radius * np.tile(np.cos(angle), rows),
            radius * np.tile(np.sin(angle), rows),
            0.08 - 0.25 * share,
        ],
        -1,
    )
    grid = np.arange(rows * around).reshape(rows, around)
    upper, lower = grid[:-1], grid[1:]
    faces = np.stack([lower, np.roll(lower, -1, 1), np.roll(upper, -1, 1), upper], -1)
    pin = np.zeros(rows * around, dtype=np.float32)
    pin[:around] = 1
    return Garment(
        "Skirt",
        points.astype(np.float32),
        faces.reshape(-1, 4).astype(np.int32),
        np.zeros((1, 2), np.float32),
        np.zeros((faces.size // 4, 4), np.int32),
        pin,
        np.zeros_like(pin),
        {"fabric": "cotton"},
    )


@pytest.fixture
def sample(toy_body):
    poses = np.tile(REST_POSE, (FRAMES, 1))
    poses[:, 3] += 0.05 * np.arange(FRAMES)
    trans = np.array([2.0, 1.0, 1.0]) + 0.01 * np.arange(FRAMES)[:, None]
    return {
        "body": toy_body,
        "body_record": make_body_sequence(toy_body, np.zeros(10), poses, trans, gender=0),
        "outfit": Outfit((skirt(),), np.zeros(10), np.zeros(2), np.zeros(2), "female"),
        "settings": SHORT,
    }


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_skirt_follows_the_body_and_is_accepted(tmp_path, sample, share, monkeypatch):
    seen = []

    def spied(pieces, vertices, faces, cache, **options):
        with PointCache(cache) as moving:
            np.testing.assert_array_equal(moving.frames(0, 1)[0], vertices)
        seen.append((len(vertices), len(faces), faces.max()))
        return simulate_cloth(pieces, vertices, faces, cache, **options)

    monkeypatch.setattr(simulate, "simulate_cloth", spied)
    sample["settings"] = replace(SHORT, collider_share=share)
    folder = tmp_path / "00001"
    status = simulate_outfit(folder, bounds=LOOSE, **sample)
    assert status["status"] == "accepted", status["reason"]
    ((vertices, faces, last),) = seen
    assert last == vertices - 1
    # Hands, head and feet are out of reach.
    assert 0.7 < faces / (share * len(sample["body"].faces)) < 0.9
    assert json.loads((folder / "status.json").read_text()) == status
    with PointCache(folder / "Skirt.f32", 8 * 36) as cache:
        frames = cache.frames()
    # Only the sequence is kept, relative to the root.
    assert len(frames) == FRAMES
    assert np.abs(frames[:, :36].mean(axis=1) - skirt().vertices[:36].mean(axis=0)).max() < 0.02
    health = np.load(folder / "health.npz")
    assert health["inside_share"].shape == (FRAMES, 1)
    assert sorted(p.name for p in folder.iterdir()) == ["Skirt.f32", "health.npz", "status.json"]


def test_out_of_bounds_is_tried_finer_and_then_rejected_with_its_reason(tmp_path, sample):
    folder = tmp_path / "00001"
    sample["settings"] = replace(SHORT, collider_share=0.5)
    status = simulate_outfit(folder, bounds=HealthBounds(slip_m=-1), **sample)
    assert status["status"] == "rejected"
    assert "slip_m" in status["reason"]
    first, second = status["attempts"]
    assert second["solver"]["steps"] > first["solver"]["steps"]
    assert (first["collider_share"], second["collider_share"]) == (0.5, 1)
    assert [p.name for p in folder.iterdir()] == ["status.json"]


def test_an_attempt_that_cannot_come_back_into_bounds_ends_at_once(tmp_path, sample):
    bounds = HealthBounds(stretch_low=0, stretch_high=9, inside_share_max=-1)
    status = simulate_outfit(tmp_path / "00001", bounds=bounds, **sample)
    assert status["status"] == "rejected"
    assert "inside_share_max" in status["reason"]
    assert "(by frame 0)" in status["reason"]
    assert "measures" not in status["attempts"][0]


def test_a_breakdown_is_a_result_with_its_reason(tmp_path, sample, monkeypatch):
    def broken(*_, **__):
        raise RuntimeError("no memory for cloth")

    monkeypatch.setattr(simulate, "simulate_cloth", broken)
    status = simulate_outfit(tmp_path / "00001", bounds=LOOSE, **sample)
    assert (status["status"], status["reason"]) == ("failed", "no memory for cloth")


def test_cloth_that_is_not_finite_is_a_failure(tmp_path, sample, monkeypatch):
    def exploding(pieces, *_, frames, **__):
        for _ in range(frames):
            yield [np.full_like(piece.vertices, np.nan) for piece in pieces]

    monkeypatch.setattr(simulate, "simulate_cloth", exploding)
    status = simulate_outfit(tmp_path / "00001", bounds=LOOSE, **sample)
    assert status["status"] == "failed"
    assert "not finite" in status["reason"]
