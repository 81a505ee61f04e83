"""Where a closed surface that moves overlaps itself, decided by winding numbers."""

import numpy as np
import warp as wp
from scipy.sparse import csr_matrix

from drapeline.geometry.moving_surface import HoleFans
from drapeline.geometry.warp_mesh import start_warp

wp.set_module_options({"enable_backward": False})

_DEVICE = "cpu"
_CELLS = 1 << 16  # their numbers have 16 bits, which NumPy sorts fastest
_HAIR_M = 1e-4  # so far outside its own surface a vertex is looked for
_NEAR_M = 0.012  # others are looked for within this distance, then twice as far, and so on
_STEEP = 0.7  # cosine: farther away, what is beneath the nearest one, not beside it, is in its part


@wp.struct
class _Grid:
    """Square cells in X and Z, row by row."""

    low: wp.vec3  # corner, metres
    size: float  # of a cell, metres
    width: int  # in cells
    height: int


@wp.func
def _place(grid: _Grid, point: wp.vec3):
    way = (point - grid.low) / grid.size
    return wp.vec2i(
        wp.clamp(int(way[0]), 0, grid.width - 1), wp.clamp(int(way[2]), 0, grid.height - 1)
    )


@wp.kernel
def _lift(
    points: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    first_face: wp.array[int],  # of each vertex, in the list of
    face_numbers: wp.array[int],
    grid: _Grid,
    normals: wp.array[wp.vec3],
    lifted: wp.array[wp.vec3],
    cells: wp.array[int],
):
    i = wp.tid()
    normal = wp.vec3()
    for k in range(first_face[i], first_face[i + 1]):
        face = faces[face_numbers[k]]
        corner = points[face[0]]
        normal += wp.cross(points[face[1]] - corner, points[face[2]] - corner)
    normals[i] = wp.normalize(normal)
    lifted[i] = points[i] + wp.static(_HAIR_M) * normals[i]
    place = _place(grid, lifted[i])
    cells[i] = place[1] * grid.width + place[0]


@wp.func
def _left_of(a: wp.vec3, b: wp.vec3, i: int, j: int, x: wp.float64, z: wp.float64):
    # Seen along Y; the two triangles of an edge get opposite answers, whatever rounding does.
    start = a
    end = b
    if i > j:
        start = b
        end = a
    ux = wp.float64(end[0]) - wp.float64(start[0])
    uz = wp.float64(end[2]) - wp.float64(start[2])
    left = ux * (z - wp.float64(start[2])) - uz * (x - wp.float64(start[0])) >= wp.float64(0.0)
    return left == (i < j)


@wp.func
def _turn(a: wp.vec3, b: wp.vec3, c: wp.vec3, face: wp.vec3i, p: wp.vec3):
    # Of a triangle around the line along Y through p: 1 if it faces Y, -1 if the other way, 0 else.
    x = wp.float64(p[0])
    z = wp.float64(p[2])
    turn = int(0)  # noqa: RUF046, UP018  (a plain 0 would be a constant)
    side = _left_of(a, b, face[0], face[1], x, z)
    if side == _left_of(b, c, face[1], face[2], x, z):  # noqa: SIM102  (dear, and seldom so)
        if side == _left_of(c, a, face[2], face[0], x, z):
            turn = wp.where(side, -1, 1)
    return turn


@wp.kernel
def _count_windings(
    points: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    sorted_points: wp.array[wp.vec3],  # what is lifted, cell by cell
    first: wp.array[int],  # of each cell
    grid: _Grid,
    windings: wp.array[int],
):
    face = faces[wp.tid()]
    a = points[face[0]]
    b = points[face[1]]
    c = points[face[2]]
    floor = wp.min(a, wp.min(b, c))
    top = wp.max(a, wp.max(b, c))
    normal = wp.cross(b - a, c - a)
    start = _place(grid, floor)
    end = _place(grid, top)
    for row in range(start[1], end[1] + 1):
        for k in range(first[row * grid.width + start[0]], first[row * grid.width + end[0] + 1]):
            p = sorted_points[k]
            beside = p[0] < floor[0] or p[0] > top[0] or p[2] < floor[2] or p[2] > top[2]
            if p[1] < top[1] and not beside:
                winding = _turn(a, b, c, face, p)
                # Whether the ray along Y starts before the triangle's plane.
                if (normal[1] > 0.0) == (wp.dot(normal, a - p) > 0.0):
                    windings[k] += winding


@wp.kernel
def _find_depths(
    sorted_points: wp.array[wp.vec3],
    order: wp.array[int],  # their numbers
    first: wp.array[int],
    grid: _Grid,
    normals: wp.array[wp.vec3],
    groups: wp.array[int],
    asked: wp.array[int],  # places in the order
    depths: wp.array[float],
):
    point = sorted_points[asked[wp.tid()]]
    group = groups[order[asked[wp.tid()]]]
    nearest = int(-1)  # noqa: RUF046, UP018  (a plain -1 would be a constant)
    reach = float(wp.static(_NEAR_M))
    least = reach * reach
    farthest = grid.size * float(grid.width + grid.height)
    while nearest < 0 and reach < farthest:
        start = _place(grid, point - wp.vec3(reach))
        end = _place(grid, point + wp.vec3(reach))
        for row in range(start[1], end[1] + 1):
            for k in range(
                first[row * grid.width + start[0]], first[row * grid.width + end[0] + 1]
            ):
                away = wp.length_sq(sorted_points[k] - point)
                if away < least and groups[order[k]] != group:
                    least = away
                    nearest = k
        reach *= 2.0
        if nearest < 0:
            least = reach * reach
    if nearest >= 0:
        height = wp.dot(sorted_points[nearest] - point, normals[order[nearest]])
        distance = wp.sqrt(least)
        if distance < wp.static(_NEAR_M) or height > wp.static(_STEEP) * distance:
            depths[wp.tid()] = wp.max(height, 0.0)


class SelfOverlap:
    """Finds which vertices of a surface lie inside it, and how deep in other parts.

    Holes are closed by fans. A vertex is inside if a ray that starts a hair outside its own place
    leaves the surface more often than it enters it.

    Args:
        faces: (F, 3) outward; vertices without a face take no part.
        groups: (V,) the part of the surface that each vertex belongs to.
    """

    def __init__(self, faces: np.ndarray, groups: np.ndarray) -> None:
        start_warp()
        self.vertices, corners = np.unique(faces, return_inverse=True)
        corners = corners.reshape(faces.shape).astype(np.int32)
        count = len(self.vertices)
        self._holes = HoleFans(corners, count)
        whole = np.concatenate([corners, self._holes.faces])
        rows = np.repeat(np.arange(len(whole)), 3)
        faces_of = csr_matrix((np.ones(whole.size, dtype=np.int8), (whole.ravel(), rows)))
        self._points = wp.zeros(faces_of.shape[0], dtype=wp.vec3, device=_DEVICE)
        self._normals, self._lifted, self._sorted = (
            wp.zeros(count, dtype=wp.vec3, device=_DEVICE) for _ in range(3)
        )
        self._windings, self._cells, self._order = (
            wp.zeros(count, dtype=int, device=_DEVICE) for _ in range(3)
        )
        self._first = wp.zeros(_CELLS + 1, dtype=int, device=_DEVICE)
        self._faces, self._groups, *self._faces_of = (
            wp.array(np.ascontiguousarray(x, dtype=np.int32), dtype=kind, device=_DEVICE)
            for x, kind in (
                (whole, wp.vec3i),
                (groups[self.vertices], int),
                (faces_of.indptr, int),
                (faces_of.indices, int),
            )
        )

    def __call__(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Vertices inside the surface, and how far each is from the surface of other parts.

        Args:
            vertices: (V, 3) metres.

        Returns:
            Their numbers (k,), sorted, and depths (k,) in metres: beneath the tangent plane of the
            nearest vertex of another part; 0 if it is above or beside it, as in a fold of its own
            part.
        """
        points = self._holes.add_centres(vertices[self.vertices])
        self._points.assign(points)
        grid = _grid_over(points)
        wp.launch(
            _lift,
            dim=len(self.vertices),
            inputs=[self._points, self._faces, *self._faces_of, grid],
            outputs=[self._normals, self._lifted, self._cells],
            device=_DEVICE,
        )
        cells = self._cells.numpy().astype(np.uint16)
        order = np.argsort(cells, kind="stable")
        self._order.numpy()[:] = order
        self._sorted.numpy()[:] = self._lifted.numpy()[order]
        np.cumsum(np.bincount(cells, minlength=_CELLS), out=self._first.numpy()[1:])
        self._windings.zero_()
        wp.launch(
            _count_windings,
            dim=len(self._faces),
            inputs=[self._points, self._faces, self._sorted, self._first, grid],
            outputs=[self._windings],
            device=_DEVICE,
        )
        inside = np.flatnonzero(self._windings.numpy() > 0).astype(np.int32)
        inside = inside[np.argsort(order[inside])]
        depths = wp.zeros(len(inside), dtype=float, device=_DEVICE)
        wp.launch(
            _find_depths,
            dim=len(inside),
            inputs=[
                *(self._sorted, self._order, self._first, grid, self._normals, self._groups),
                wp.array(inside, dtype=int, device=_DEVICE),
            ],
            outputs=[depths],
            device=_DEVICE,
        )
        return self.vertices[order[inside]], depths.numpy()


def _grid_over(points: np.ndarray) -> _Grid:
    """The finest grid over points (P, 3), with room for a hair around them."""
    grid = _Grid()
    low = points.min(axis=0) - 2 * _HAIR_M
    extent = points.max(axis=0) + 2 * _HAIR_M - low
    grid.low = wp.vec3(*low.tolist())
    # One more along each side: (x / size + 1) (z / size + 1) cells are few enough.
    across, area = float(extent[0] + extent[2]), float(extent[0] * extent[2])
    least = (across + np.sqrt(across**2 + 4 * (_CELLS - 1) * area)) / (2 * (_CELLS - 1))
    grid.size = least
    grid.width = int(extent[0] / least) + 1
    grid.height = int(extent[2] / least) + 1
    return grid
