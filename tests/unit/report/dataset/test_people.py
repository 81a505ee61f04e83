"""People side by side in motion."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from drapeline.errors import InputError
from drapeline.report.dataset.people import best_loop, keep_off, render_people
from toys.tiny_sample import write_tiny_sample


def circling(period, count, points=40):
    """(N, V, 3) points that come back after `period` frames, and drift while they do not."""
    turn = 2 * np.pi * np.arange(count) / period
    path = np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], axis=-1)
    return path[:, None] + np.random.default_rng(0).normal(size=(points, 3))


def test_a_loop_has_the_length_after_which_all_motions_return():
    moving = [circling(46, 80), circling(23, 75)]
    frames, starts = best_loop(moving)
    assert frames == 46
    for vertices, start in zip(moving, starts, strict=True):
        np.testing.assert_allclose(vertices[start], vertices[start + frames - 46], atol=1e-9)
        assert start + frames <= len(vertices)


def test_a_loop_starts_after_what_moves_otherwise():
    moving = circling(44, 90)
    moving[:20] += np.linspace(3, 1, 20)[:, None, None]
    frames, (start,) = best_loop([moving])
    assert frames == 44
    assert start >= 28  # the frames that the end is blended with count as well


def test_cloth_is_kept_off_the_body_and_off_inner_cloth_in_the_frames_asked_for():
    body, inner, outer = (trimesh.creation.icosphere(3, radius) for radius in (1.0, 0.98, 0.97))
    meshes = [body, inner, outer]
    moving = [np.tile(one.vertices, (3, 1, 1)).astype(np.float32) for one in meshes]
    before = [one.copy() for one in moving]
    keep_off(moving, [np.asarray(one.faces, np.int32) for one in meshes], [1, 2])
    for frame in (1, 2):
        radii = [np.linalg.norm(one[frame], axis=1) for one in moving]
        assert (radii[0] == np.linalg.norm(before[0][frame], axis=1)).all()
        assert radii[1].min() > 1
        assert (radii[2] > radii[1].max()).all()
    for one, kept in zip(moving, before, strict=True):
        np.testing.assert_array_equal(one[0], kept[0])


def test_people_stand_side_by_side_and_move_endlessly(toy_body, tmp_path):
    folders = [
        write_tiny_sample(tmp_path / name, toy_body, frames=50).folder for name in ("a", "b")
    ]
    render_people(tmp_path / "people.webp", folders, size=(80, 60))
    with Image.open(tmp_path / "people.webp") as image:
        assert image.size == (80, 60)
        assert 40 <= image.n_frames <= 50
        assert image.info["loop"] == 0
        first = np.asarray(image.convert("RGB")).min(axis=2)
    columns = np.flatnonzero((first < 200).any(axis=0))
    assert columns[0] < 12
    assert columns[-1] > 67
    assert np.diff(columns).max() > 1  # there is space between them


def test_samples_that_are_too_short_are_refused(toy_body, tmp_path):
    tiny = write_tiny_sample(tmp_path, toy_body)
    with pytest.raises(InputError, match="has 6 frames, expected 48 or more"):
        render_people(tmp_path / "people.webp", [tiny.folder])
    assert not (tmp_path / "people.webp").exists()
