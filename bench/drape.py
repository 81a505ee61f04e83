"""How fabrics drape by a cloth solver: Cusick's disc and the cantilever.

A disc of 30 cm is held between two plates of 18 cm, and the share that its shadow keeps of what
sticks out is its drape coefficient (BS 5058). A strip of 2.5 cm is held level at one end, and its
bending length follows from how far the other end sinks (ASTM D1388, Peirce 1930).
`docs/make_fabrics.py` writes what comes of them into the docs.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw
from scipy.spatial import ConvexHull, Delaunay

from drapeline.frames import FPS
from drapeline.geometry.mesh import boundary_loops, mean_edge_length, triangulate
from drapeline.geometry.point_cache import PointCache, write_point_cache
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.outfits.fabrics import Fabric
from drapeline.simulation.attachments import Pins
from drapeline.simulation.collider import MovingBody
from drapeline.simulation.solver import Attempt, ClothGarment, ClothSolver

RADIUS_M, PLATE_M = 0.15, 0.09
_HEIGHT_M = 1.0
_FRAMES = 5 * FPS
_STEPS, _GAP_M = 14, 0.004
_PIXEL_M = 0.0005
_WAVES, _WAVE_M = range(2, 10), 0.0003
_CLOSE = 0.03  # how well the area that is held has to be met
_STRIP_M, _CLAMP_ROWS = 0.025, 4


class Sheet(NamedTuple):
    """Cloth before and after it has hung."""

    flat: np.ndarray  # (V, 3) metres
    faces: np.ndarray  # (F, 4) or (F, 3)
    held: np.ndarray  # (P,) vertices
    hung: np.ndarray  # (V, 3) metres


class _Held(Pins):
    def __init__(self, held: np.ndarray, vertices: np.ndarray) -> None:
        self.vertices, self.weights = held, np.ones(len(held))
        self._places = vertices[held].astype(np.float64)

    def positions(self, frame: int) -> np.ndarray:
        return self._places


def hang(
    solver: ClothSolver, flat: np.ndarray, faces: np.ndarray, held: np.ndarray, fabric: Fabric
) -> Sheet:
    """A sheet that has hung for a while, far from any body."""
    far = np.array([[0, 0, -9], [1, 0, -9], [0, 1, -9], [0, 0, -8]], dtype=np.float32)
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    vertices = flat.astype(np.float32)
    garment = ClothGarment(
        "cloth",
        vertices,
        faces,
        mean_edge_length(vertices, faces),
        fabric,
        np.zeros(len(vertices)),
        np.ones(len(vertices)),
        _Held(held, vertices),
    )
    attempt = Attempt(
        _STEPS,
        _GAP_M,
        collider_share=1.0,
        shape_frames=0,
        pose_frames=0,
        settle_frames=0,
        floor=False,
    )
    with TemporaryDirectory() as name:
        write_point_cache(Path(name, "body.pc2"), [far] * _FRAMES)
        scratch = Path(name, "scratch")
        scratch.mkdir()
        with PointCache(Path(name, "body.pc2")) as frames:
            body = MovingBody(frames, tetrahedron, np.zeros(4, dtype=int))
            *_, last = solver.simulate([garment], body, attempt, scratch)
    return Sheet(flat, faces, held, last[0])


def hang_disc(solver: ClothSolver, fabric: Fabric, edge_m: float, *, triangles: bool) -> Sheet:
    """Cusick's disc of a fabric, its warp along the X axis."""
    wanted = np.pi * (PLATE_M + _bend_m(fabric, edge_m)) ** 2
    for shift in (0.5, 0.0):
        points, faces = _triangle_disc(edge_m) if triangles else _quad_disc(edge_m, shift)
        held = _held_near(points, wanted, edge_m)
        if abs(_hull_area(points[held]) / wanted - 1) < _CLOSE:
            break
    away = np.linalg.norm(points, axis=1)
    # Slightly wavy, so that folds have something to grow from.
    angle = np.arctan2(points[:, 1], points[:, 0])
    waves = sum(np.sin(wave * angle + wave**2) for wave in _WAVES)
    height = _HEIGHT_M + _WAVE_M * waves * np.clip((away - PLATE_M) / (RADIUS_M - PLATE_M), 0, 1)
    return hang(solver, np.column_stack([points, height]), faces, held, fabric)


def _bend_m(fabric: Fabric, edge_m: float) -> float:
    """How far within the outermost held vertices cloth bends already.

    Their hinges bend it half an edge to both sides; limp cloth hangs as if it bent at the hinge.
    """
    length_m = (fabric.bending_n_m / fabric.density_kg_m2 / 9.81) ** (1 / 3)
    return min(edge_m, length_m) / 2


def _held_near(points: np.ndarray, area_m2: float, edge_m: float) -> np.ndarray:
    """Vertices (P,) about the middle that are held, whose hull has an area as near as can be."""
    away = np.linalg.norm(points, axis=1)
    near = np.unique(away.round(5))
    near = near[abs(near - PLATE_M) < 1.2 * edge_m]
    within = [np.flatnonzero(away <= radius + 1e-5) for radius in near]
    return min(within, key=lambda held: abs(_hull_area(points[held]) - area_m2))


def _hull_area(points: np.ndarray) -> float:
    return ConvexHull(points).volume  # in the plane


def drape_coefficient(sheet: Sheet) -> float:
    """Per cent of the ring around the held part that is still in the sheet's shadow."""
    held = _hull_area(sheet.flat[sheet.held, :2])
    whole = np.pi * RADIUS_M**2
    return 100 * (_shadow_area(sheet) - held) / (whole - held)


def _shadow_area(sheet: Sheet) -> float:
    size = round(2.2 * RADIUS_M / _PIXEL_M)
    picture = Image.new("1", (size, size))
    draw = ImageDraw.Draw(picture)
    places = sheet.hung[:, :2] / _PIXEL_M + size / 2
    for triangle in triangulate(sheet.faces):
        draw.polygon([tuple(corner) for corner in places[triangle]], fill=1)
    return float(np.asarray(picture).sum()) * _PIXEL_M**2


def _quad_disc(edge_m: float, shift: float) -> tuple[np.ndarray, np.ndarray]:
    """A disc cut from a square grid, its rim laid on the circle: (V, 2) and quads.

    The grid is shifted by a share of its edges.
    """
    count = int(np.ceil(RADIUS_M / edge_m)) + 1
    ticks = (np.arange(-count, count + 1) + shift) * edge_m
    points = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    quads = grid(len(ticks), len(ticks))
    quads = quads[(np.linalg.norm(points[quads], axis=2) < RADIUS_M + 0.3 * edge_m).all(axis=1)]
    used, inverse = np.unique(quads, return_inverse=True)
    points, quads = points[used], inverse.reshape(quads.shape)
    rim = boundary_loops(quads)[0]
    angle = np.unwrap(np.arctan2(points[rim, 1], points[rim, 0]))
    turn = np.sign(angle[-1] - angle[0]) * 2 * np.pi
    for _ in range(30):  # until the rim's vertices lie evenly
        after, before = np.append(angle[1:], angle[0] + turn), np.insert(angle[:-1], 0, angle[-1])
        before[0] -= turn
        angle = (2 * angle + after + before) / 4
    points[rim] = RADIUS_M * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    average = averaging_matrix(quads, len(points))
    inside = np.linalg.norm(points, axis=1) > RADIUS_M - 2.2 * edge_m
    inside[rim] = False
    for _ in range(10):
        points[inside] = (average @ points)[inside]
    return points, quads


def _triangle_disc(edge_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A disc of triangles that are equilateral but for its rim: (V, 2) and triangles."""
    count = int(np.ceil(RADIUS_M / edge_m)) + 2
    number = np.arange(-count, count + 1)
    one, two = np.meshgrid(number, number, indexing="ij")
    points = edge_m * np.stack([one + two / 2, np.sqrt(3) / 2 * two], axis=-1).reshape(-1, 2)
    points = points[np.linalg.norm(points, axis=1) < RADIUS_M - edge_m / 2]
    around = round(2 * np.pi * RADIUS_M / edge_m)
    angle = 2 * np.pi * np.arange(around) / around
    points = np.concatenate([points, RADIUS_M * np.stack([np.cos(angle), np.sin(angle)], axis=1)])
    triangles = Delaunay(points).simplices
    a, b, c = (points[triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    return points, triangles[abs(area) > 0.1 * edge_m**2]


def grid(rows: int, columns: int) -> np.ndarray:
    """Quads (F, 4) of so many vertices."""
    number = np.arange(rows * columns).reshape(rows, columns)
    corners = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
    return np.stack(corners, axis=-1).reshape(-1, 4)


def bending_length_m(
    solver: ClothSolver, fabric: Fabric, edge_m: float, *, triangles: bool
) -> float:
    """Of a fabric's warp, by how far a strip of about twice the length sinks."""
    expected_m = (fabric.bending_warp_n_m / fabric.density_kg_m2 / 9.81) ** (1 / 3)
    beyond = max(round(2 * expected_m / edge_m), 2)
    rows, columns = _CLAMP_ROWS + beyond, 1 + max(round(_STRIP_M / edge_m), 2)
    ahead, aside = np.meshgrid(np.arange(rows) * edge_m, np.arange(columns) * edge_m, indexing="ij")
    flat = np.stack([ahead, aside, np.full_like(ahead, _HEIGHT_M)], axis=-1).reshape(-1, 3)
    quads = grid(rows, columns)
    faces = triangulate(quads) if triangles else quads
    sheet = hang(solver, flat, faces, np.arange(_CLAMP_ROWS * columns), fabric)
    by_row = sheet.hung.reshape(rows, columns, 3).mean(axis=1)
    forward, _, up = by_row[-1] - by_row[_CLAMP_ROWS - 1]
    # The outermost held row bends as well, half an edge to both sides.
    angle = np.arctan2(-up, forward + edge_m / 2)
    free_m = (beyond + 0.5) * edge_m
    return free_m * (np.cos(angle / 2) / (8 * np.tan(angle))) ** (1 / 3)
