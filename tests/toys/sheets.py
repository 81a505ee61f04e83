"""Sheets of cloth over a ball, simulated by any solver."""

import numpy as np
import trimesh

from drapeline.geometry.mesh import triangulate
from drapeline.geometry.moving_surface import MovingSheet
from drapeline.geometry.point_cache import PointCache, write_point_cache
from drapeline.outfits.fabrics import FABRICS
from drapeline.simulation.attachments import Pins
from drapeline.simulation.collider import MovingBody
from drapeline.simulation.solver import Attempt, ClothGarment

GAP_M = 0.004


class Held(Pins):
    """Vertices that are held at places of our choice."""

    def __init__(self, weights, vertices, path):
        self.vertices = np.flatnonzero(weights)
        self.weights = np.asarray(weights)[self.vertices]
        self._start, self._path = vertices[self.vertices], path

    def positions(self, frame):
        return self._start + self._path(frame)


def still(frame):
    return np.zeros(3)


def sheet(
    height, rows=13, columns=None, edge_m=0.03, name="sheet", pin=None, path=still, **changes
):
    """A level sheet of quads about the Z axis; `pin` weights are held along a path."""
    columns = columns or rows
    x, y = ((np.arange(count) - (count - 1) / 2) * edge_m for count in (rows, columns))
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((rows, columns), height)], -1)
    points = points.reshape(-1, 3).astype(np.float32)
    grid = np.arange(rows * columns).reshape(rows, columns)
    faces = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], -1)
    fields = {
        "edge_length_m": edge_m,
        "fabric": FABRICS["cotton"],
        "shrink": np.zeros(len(points)),
        "stiffness": np.ones(len(points)),
        "pins": Held(np.zeros(len(points)) if pin is None else pin, points, path),
    }
    return ClothGarment(name, points, faces.reshape(-1, 4), **fields | changes)


def beneath_share(outer, inner, faces):
    """Share of a sheet's vertices that are beneath another one and within 3 cm of it."""
    return MovingSheet(inner, triangulate(faces)).beneath(outer, 0.03).mean()


def drop(
    tmp_path,
    solver,
    garments,
    frames,
    *,
    path=still,
    radius=0.1,
    steps=8,
    gap_m=GAP_M,
    floor_m=None,
    root=None,
):
    """Vertices (frames, V, 3) of each garment over a ball that moves along a path, and a floor."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    cache = tmp_path / "ball.pc2"
    write_point_cache(cache, [np.float32(ball.vertices + path(k)) for k in range(frames)])
    scratch = tmp_path / "scratch"
    scratch.mkdir(exist_ok=True)
    attempt = Attempt(
        steps,
        gap_m,
        collider_share=1.0,
        shape_frames=1,
        pose_frames=1,
        settle_frames=0,
        floor=False,
    )
    with PointCache(cache) as points:
        limbs = np.zeros(len(ball.vertices), dtype=int)
        roots = None if root is None else np.tile(np.float32(root), (frames, 1))
        body = MovingBody(points, ball.faces, limbs, floor_m=floor_m, roots=roots)
        cloths = solver.simulate(garments, body, attempt, scratch)
        return [np.stack(cloth) for cloth in zip(*cloths, strict=True)]


def assert_floor_holds(run):
    """A sheet falls flat onto a floor, and another one is lifted by a floor that rises."""
    (fall,) = run([sheet(0.1)], 30, path=far_away, floor_m=np.full(30, 0.02), steps=14)
    np.testing.assert_allclose(fall[-1, :, 2], 0.02 + GAP_M, atol=0.001)
    np.testing.assert_allclose(fall[-1, :, :2], fall[0, :, :2], atol=0.002)
    floor_m = np.interp(np.arange(20), [5, 15], [-0.1, 0.0])
    (lifted,) = run([sheet(-0.095)], 20, path=far_away, floor_m=floor_m, steps=14)
    assert lifted[-1, :, 2].min() > GAP_M - 0.001


def far_away(frame):
    """A way of the ball to where nothing touches it."""
    return np.array([0.0, 0.0, 9.0])
