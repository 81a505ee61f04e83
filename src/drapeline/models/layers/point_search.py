"""Searches among the points of a cloud: farthest points, balls, nearest neighbours.

All of them return indices, and none has a gradient. They run on the device of their tensors without
copying them, and their results are those of a plain search over all points. A cloud may be padded:
points that are not `valid` are never chosen, except in a cloud without any valid point, whose
indices mean nothing.

The clouds of a training window come again in every epoch, and with them the searches of a network's
layers, which take a large part of its forward pass: `SearchMemory` answers those made before.
"""

import math
from collections.abc import Callable, Hashable, Sequence
from functools import cached_property
from typing import Any, TypeVar

import torch
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.models.training.batches import ByteCache, count_bytes

wp.set_module_options({"enable_backward": False})

_BUCKET = wp.constant(32)

_RINGS = wp.constant(8)

_CELL_COST = wp.constant(0.5)  # of a point in a cell, in points looked at in order

_CELLS_PER_POINT, _CELLS_PER_AXIS = 4, 1024


@wp.kernel
def _farthest(
    points: wp.array2d[wp.vec3],
    index: wp.array2d[wp.int64],
    distance: wp.array2d[float],
    low: wp.array2d[wp.vec3],
    high: wp.array2d[wp.vec3],
    most: wp.array2d[float],
    top: wp.array2d[int],
    chosen: wp.array2d[wp.int64],
):
    """One thread per cloud, whose points come in buckets of neighbours (Han et al., QuickFPS).

    A bucket is skipped if its box is farther away than any of its points is from those chosen.

    Args:
        points: in the order of buckets.
        index: of each point in the cloud.
        distance: comes in as infinity, or -1 for points not to choose.
        low, high: corners of each bucket's box.
        most, top: the largest distance in each bucket, which comes in as infinity, and its point.
        chosen: index of each choice; the first one is made already.
    """
    cloud = wp.tid()
    row = points[cloud]
    number = index[cloud]
    away = distance[cloud]
    last = int(0)  # noqa: RUF046, UP018  (a plain number would be a constant)
    for i in range(row.shape[0]):
        if number[i] == chosen[cloud, 0]:
            last = i
    for step in range(1, chosen.shape[1]):
        place = row[last]
        best = float(-1.0)  # noqa: UP018
        lowest = chosen[cloud, step - 1]
        for bucket in range(most.shape[1]):
            reach = most[cloud, bucket]
            outside = wp.max(
                wp.max(low[cloud, bucket] - place, place - high[cloud, bucket]), wp.vec3()
            )
            # By a little less than that, since distances are rounded.
            if not wp.length_sq(outside) * 0.9999 > reach:
                reach = float(-1.0)  # noqa: UP018
                least = wp.int64(0)
                for i in range(bucket * _BUCKET, wp.min((bucket + 1) * _BUCKET, row.shape[0])):
                    near = wp.min(away[i], wp.length_sq(row[i] - place))
                    away[i] = near
                    if near > reach or (near == reach and number[i] < least):
                        reach = near
                        least = number[i]
                        top[cloud, bucket] = i
                most[cloud, bucket] = reach
            if reach >= best and reach >= 0.0:
                i = top[cloud, bucket]
                if reach > best or number[i] < lowest:
                    best = reach
                    lowest = number[i]
                    last = i
        chosen[cloud, step] = lowest


@wp.struct
class _PointGrid:
    """Points of all clouds in the cells of one grid.

    Attributes:
        points: (B, P) sorted by cell, x first, and in a cell as in the cloud. Those that are not
            to be chosen come last.
        index: (B, P) of each point in its cloud.
        start: (B, cells + 1) where each cell starts.
        low: corner of the first cell.
        side: of a cell.
        nx, ny, nz: numbers of cells.
    """

    points: wp.array2d[wp.vec3]
    index: wp.array2d[wp.int64]
    start: wp.array2d[int]
    low: wp.vec3
    side: float
    nx: int
    ny: int
    nz: int


@wp.func
def _cell(x: float, count: int):
    """The cell of a place in units of cells; whatever is farther out is the third one outside."""
    return int(wp.floor(wp.clamp(x, -3.0, float(count) + 2.0)))


@wp.func
def _row(grid: _PointGrid, cloud: int, first: int, last: int, y: int, z: int):
    """Start and end of the points in cells `first` to `last` of a row."""
    span = wp.vec2i(0, 0)
    left = wp.max(first, 0)
    right = wp.min(last, grid.nx - 1)
    if left <= right and y >= 0 and y < grid.ny and z >= 0 and z < grid.nz:
        row = (z * grid.ny + y) * grid.nx
        span = wp.vec2i(grid.start[cloud, row + left], grid.start[cloud, row + right + 1])
    return span


@wp.func
def _nearest_in_rings(grid: _PointGrid, cloud: int, place: wp.vec3, x: int, y: int, z: int):
    """Index of the point nearest to a place in cell x, y, z; -1 if it is many cells away."""
    least = float(wp.inf)
    best = wp.int64(-1)
    ring = int(0)  # noqa: RUF046, UP018
    # What lies outside of all rings so far is at least so far away, and rounding.
    while least > wp.pow(0.999 * grid.side * wp.max(float(ring) - 1.0, 0.0), 2.0):
        if ring == _RINGS:
            return wp.int64(-1)
        for k in range(z - ring, z + ring + 1):
            for j in range(y - ring, y + ring + 1):
                ends = wp.abs(k - z) < ring and wp.abs(j - y) < ring
                for part in range(2):  # the whole row, or its first and its last cell
                    first = x - ring + 2 * ring * part
                    last = first
                    if not ends:
                        last = x + ring - (2 * ring + 1) * part
                    span = _row(grid, cloud, first, last, j, k)
                    for i in range(span[0], span[1]):
                        away = wp.length_sq(grid.points[cloud, i] - place)
                        index = grid.index[cloud, i]
                        if away < least or (away == least and index < best):
                            least = away
                            best = index
        ring += 1
    return best


@wp.func
def _nearest_of_all(points: wp.array[wp.vec3], valid: wp.array[wp.bool], place: wp.vec3):
    """Index of the valid point nearest to a place; 0 if there is none."""
    least = float(wp.inf)
    best = wp.int64(0)
    for i in range(points.shape[0]):
        away = wp.length_sq(points[i] - place)
        if away < least:  # noqa: SIM102  (`and` asks for both)
            if valid[i]:
                least = away
                best = wp.int64(i)
    return best


@wp.func
def _count_around(grid: _PointGrid, cloud: int, x: int, y: int, z: int):
    """Points in a cell and its neighbours."""
    count = int(0)  # noqa: RUF046, UP018
    for k in range(z - 1, z + 2):
        for j in range(y - 1, y + 2):
            span = _row(grid, cloud, x - 1, x + 1, j, k)
            count += span[1] - span[0]
    return count


@wp.func
def _fill_from_cells(
    grid: _PointGrid,
    cloud: int,
    place: wp.vec3,
    x: int,
    y: int,
    z: int,
    squared_radius: float,
    found: wp.array[wp.int64],
):
    """Keep the lowest indices of a ball in a sorted list; returns how many it holds."""
    width = found.shape[0]
    count = int(0)  # noqa: RUF046, UP018
    for k in range(z - 1, z + 2):
        for j in range(y - 1, y + 2):
            span = _row(grid, cloud, x - 1, x + 1, j, k)
            for i in range(span[0], span[1]):
                index = grid.index[cloud, i]
                near = wp.length_sq(grid.points[cloud, i] - place) <= squared_radius
                if near and (count < width or index < found[width - 1]):
                    slot = wp.min(count, width - 1)
                    while slot > 0 and found[slot - 1] > index:
                        found[slot] = found[slot - 1]
                        slot -= 1
                    found[slot] = index
                    count = wp.min(count + 1, width)
    return count


@wp.func
def _fill_in_order(
    points: wp.array[wp.vec3],
    valid: wp.array[wp.bool],
    place: wp.vec3,
    squared_radius: float,
    found: wp.array[wp.int64],
):
    """Look at all points until the list is full; returns how many it holds."""
    count = int(0)  # noqa: RUF046, UP018
    for i in range(points.shape[0]):
        if wp.length_sq(points[i] - place) <= squared_radius:  # noqa: SIM102
            if valid[i]:
                found[count] = wp.int64(i)
                count += 1
                if count == found.shape[0]:
                    return count
    return count


@wp.kernel
def _ball(
    points: wp.array2d[wp.vec3],
    valid: wp.array2d[wp.bool],
    grid: _PointGrid,
    centres: wp.array2d[wp.vec3],
    squared_radius: float,
    chosen: wp.array3d[wp.int64],
):
    """One thread per centre, which looks into the cells around it, or at all points in order.

    It looks at all points where the ball holds so many that its list is full before long.
    """
    cloud, centre = wp.tid()
    place = centres[cloud, centre]
    row = points[cloud]
    allowed = valid[cloud]
    found = chosen[cloud, centre]
    width = found.shape[0]
    at = (place - grid.low) / grid.side
    x = _cell(at[0], grid.nx)
    y = _cell(at[1], grid.ny)
    z = _cell(at[2], grid.nz)
    around = float(_count_around(grid, cloud, x, y, z))
    # About a third of the points of a surface in these cells is within a side of the middle.
    inside = 0.3 * around * squared_radius / (grid.side * grid.side)
    count = int(0)  # noqa: RUF046, UP018
    if _CELL_COST * around < float(row.shape[0]) * wp.min(1.0, float(width) / inside):
        count = _fill_from_cells(grid, cloud, place, x, y, z, squared_radius, found)
    else:
        count = _fill_in_order(row, allowed, place, squared_radius, found)
    if count == 0:
        found[0] = _nearest_in_rings(grid, cloud, place, x, y, z)
        if found[0] < wp.int64(0):
            found[0] = _nearest_of_all(row, allowed, place)
        count = 1
    for slot in range(count, width):
        found[slot] = found[0]


@wp.kernel
def _nearest(
    points: wp.array2d[wp.vec3],
    valid: wp.array2d[wp.bool],
    queries: wp.array2d[wp.vec3],
    squared: wp.array3d[float],
    chosen: wp.array3d[wp.int64],
):
    """One thread per query keeps a sorted list; `squared` comes in as infinity."""
    cloud, query = wp.tid()
    place = queries[cloud, query]
    row = points[cloud]
    allowed = valid[cloud]
    least = squared[cloud, query]
    found = chosen[cloud, query]
    last = found.shape[0] - 1
    most = float(wp.inf)
    for i in range(row.shape[0]):
        away = wp.length_sq(row[i] - place)
        if away < most:  # noqa: SIM102
            if allowed[i]:
                slot = last
                while slot > 0 and least[slot - 1] > away:
                    least[slot] = least[slot - 1]
                    found[slot] = found[slot - 1]
                    slot -= 1
                least[slot] = away
                found[slot] = wp.int64(i)
                most = least[last]


@wp.kernel
def _nearest_one(
    points: wp.array2d[wp.vec3],
    valid: wp.array2d[wp.bool],
    grid: _PointGrid,
    queries: wp.array2d[wp.vec3],
    squared: wp.array3d[float],
    chosen: wp.array3d[wp.int64],
):
    """One thread per query looks into the cells around it; `squared` comes in as infinity."""
    cloud, query = wp.tid()
    place = queries[cloud, query]
    at = (place - grid.low) / grid.side
    x = _cell(at[0], grid.nx)
    y = _cell(at[1], grid.ny)
    z = _cell(at[2], grid.nz)
    best = _nearest_in_rings(grid, cloud, place, x, y, z)
    if best < wp.int64(0):
        best = _nearest_of_all(points[cloud], valid[cloud], place)
    if valid[cloud, best]:
        squared[cloud, query, 0] = wp.length_sq(points[cloud, best] - place)
        chosen[cloud, query, 0] = best


@torch.no_grad()
def farthest_points(
    points: torch.Tensor, count: int, valid: torch.Tensor | None = None
) -> torch.Tensor:
    """Points of each cloud that lie far from one another, in the order of choice.

    The first is the cloud's first (valid) point. Each further one is farthest from those before,
    the one with the lowest index if there are several, so the first points of the result are the
    result for a smaller count. When no other points are left, the first one is repeated.

    Args:
        points: (B, P, 3).
        count: how many to choose.
        valid: (B, P) bool.

    Returns:
        (B, count) int64.
    """
    valid = _valid(points, valid)
    chosen = points.new_zeros((len(points), count), dtype=torch.int64)
    chosen[:, 0] = valid.to(torch.uint8).argmax(1)
    order = _order_in_space(points, valid)
    near = gather_rows(points.detach().to(torch.float32), order)
    distance = near.new_full(valid.shape, torch.inf).masked_fill_(~valid.gather(1, order), -1)
    spare = -near.shape[1] % _BUCKET
    padded = torch.cat([near, near[:, -1:].expand(-1, spare, -1)], 1)
    boxes = padded.unflatten(1, (-1, int(_BUCKET)))
    low, high = (_vectors(side) for side in (boxes.amin(2), boxes.amax(2)))
    most = near.new_full(boxes.shape[:2], torch.inf)
    top = torch.zeros_like(most, dtype=torch.int32)
    _launch(_farthest, _vectors(near), order, distance, low, high, most, top, chosen)
    return chosen


def _order_in_space(points: torch.Tensor, valid: torch.Tensor) -> torch.Tensor:
    """(B, P) indices by which neighbours come close to one another, along a Z-order curve.

    Those that are not valid come last.
    """
    inside = points.detach().masked_fill(~valid[..., None], torch.nan)
    low, high = inside.nan_to_num(torch.inf).amin(1), inside.nan_to_num(-torch.inf).amax(1)
    side = (high - low).amax(1).clamp_min(1e-30)
    cell = (inside - low[:, None]) * (31 / side)[:, None, None]
    spread = torch.tensor(_SPREAD, device=points.device)[cell.nan_to_num(0).to(torch.int64)]
    key = spread[..., 0] + 2 * spread[..., 1] + 4 * spread[..., 2]
    return key.masked_fill_(~valid, 1 << 15).argsort(1)


# Bits of 0 to 31, two places apart.
_SPREAD = [sum((k >> bit & 1) << 3 * bit for bit in range(5)) for k in range(32)]


class BallSearch:
    """Searches for points within a radius of centres; indexes the points when first asked.

    Args:
        points: (B, P, 3).
        radius: in the unit of the points.
        valid: (B, P) bool.
    """

    def __init__(
        self, points: torch.Tensor, radius: float, valid: torch.Tensor | None = None
    ) -> None:
        self._points, self._radius, self._valid = points, radius, _valid(points, valid)

    @cached_property
    def _grid(self) -> _PointGrid:
        return _grid(self._points, self._valid, self._radius)

    @torch.no_grad()
    def __call__(self, centres: torch.Tensor, count: int) -> torch.Tensor:
        """Points around each centre, those with the lowest indices first.

        A short list is filled up with its first point; if no point is within the radius, it is the
        nearest one.

        Args:
            centres: (B, Q, 3).
            count: length of the lists.

        Returns:
            Indices (B, Q, count) int64.
        """
        chosen = centres.new_zeros((*centres.shape[:2], count), dtype=torch.int64)
        cloud, places = _vectors(self._points), _vectors(centres)
        _launch(_ball, cloud, self._valid, self._grid, places, self._radius**2, chosen)
        return chosen


def _grid(
    points: torch.Tensor,
    valid: torch.Tensor,
    radius: float,
    cells_per_point: int = _CELLS_PER_POINT,
) -> _PointGrid:
    """A grid of which a cell and its neighbours hold all points within a radius of the cell.

    Its cells are as small as may be; there are no more than so many per point.
    """
    points = points.detach().to(torch.float32)
    usable = valid & points.isfinite().all(-1)
    inside = points[usable] if usable.any() else points.new_zeros(1, 3)
    low, extent = inside.amin(0), (inside.amax(0) - inside.amin(0)).tolist()
    side = max(1.001 * radius, max(extent) / _CELLS_PER_AXIS, 1e-30)  # more than is rounded off
    while math.prod(cells := [int(x / side) + 1 for x in extent]) > cells_per_point * len(inside):
        side *= 1.25
    steps = torch.tensor([1, cells[0], cells[0] * cells[1]], device=points.device)
    most = torch.tensor(cells, device=points.device) - 1
    place = torch.minimum(((points - low) / side).nan_to_num(0).clamp_min(0).long(), most)
    key = (place * steps).sum(-1).masked_fill_(~usable, math.prod(cells))
    order = key.argsort(dim=1, stable=True)
    start = points.new_zeros((len(points), math.prod(cells) + 2), dtype=torch.int32)
    start.scatter_add_(1, key + 1, torch.ones_like(key, dtype=torch.int32))
    grid = _PointGrid()
    grid.points, grid.index = _vectors(gather_rows(points, order)), wp.from_torch(order)
    grid.start = wp.from_torch(start.cumsum(1, dtype=torch.int32))
    grid.low, grid.side = wp.vec3(*low.tolist()), side
    grid.nx, grid.ny, grid.nz = cells
    return grid


@torch.no_grad()
def nearest_neighbours(
    points: torch.Tensor, queries: torch.Tensor, k: int, valid: torch.Tensor | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """The k points nearest to each query, nearest first, then those with the lowest index.

    Args:
        points: (B, P, 3).
        queries: (B, Q, 3).
        k: how many.
        valid: (B, P) bool.

    Returns:
        Squared distances (B, Q, k) float32, infinite where a cloud has fewer than k valid points,
        and indices (B, Q, k) int64, 0 there.
    """
    chosen = points.new_zeros((*queries.shape[:2], k), dtype=torch.int64)
    squared = points.new_full(chosen.shape, torch.inf, dtype=torch.float32)
    cloud, valid, places = _vectors(points), _valid(points, valid), _vectors(queries)
    if k == 1:
        grid = _grid(points, valid, 0.0, cells_per_point=1)
        _launch(_nearest_one, cloud, valid, grid, places, squared, chosen)
    else:
        _launch(_nearest, cloud, valid, places, squared, chosen)
    return squared, chosen


def gather_rows(rows: torch.Tensor, index: torch.Tensor) -> torch.Tensor:
    """Rows (B, P, C) at indices (B, ...) of the same cloud, (B, ..., C)."""
    flat = row_numbers(rows, index).flatten()
    return rows.flatten(0, 1).index_select(0, flat).unflatten(0, index.shape)


def row_numbers(rows: torch.Tensor, index: torch.Tensor) -> torch.Tensor:
    """Indices (B, ...) into each cloud of rows (B, P, C) as indices into all B * P rows."""
    first = torch.arange(len(rows), device=index.device) * rows.shape[1]
    return index + first.view(-1, *[1] * (index.dim() - 1))


def _vectors(points: torch.Tensor) -> wp.array:
    """(B, P, 3) as an array (B, P) of vectors, on the same memory if that is float32."""
    start_warp()
    return wp.from_torch(points.detach().to(torch.float32).contiguous(), dtype=wp.vec3)


def _valid(points: torch.Tensor, valid: torch.Tensor | None) -> torch.Tensor:
    if valid is None:
        return torch.ones(points.shape[:2], dtype=torch.bool, device=points.device)
    return valid.contiguous()


def _launch(kernel: wp.Kernel, *values: Any) -> None:
    """Run a kernel on the memory of its arrays, all of which have a row per cloud.

    The last is the output; a thread is started for each of its clouds, or for each cloud and
    centre if it has three axes.
    """
    arrays = [wp.from_torch(v) if isinstance(v, torch.Tensor) else v for v in values]
    shape = arrays[-1].shape[: max(arrays[-1].ndim - 1, 1)]
    wp.launch(kernel, dim=shape, inputs=arrays, device=arrays[-1].device)


Answer = TypeVar("Answer", bound=torch.Tensor | tuple[torch.Tensor, ...])


class Searches:
    """Searches of layers during a forward pass; this class makes all that it is asked for.

    Layers name their searches and pass themselves on to their parts, so that each search of a pass
    has a path of its own, the same one in every pass.
    """

    def __call__(self, name: str, search: Callable[..., Answer], *args: Any) -> Answer:
        """The answer of `search(*args)`, a tensor or a tuple of tensors with a row per cloud.

        Args:
            name: of the search, which no other one has in this part.
            search: a function of `point_search`.
        """
        return search(*args)

    def within(self, part: str) -> "Searches":
        """The searches of a part of the network."""
        return self


SEARCH_ANEW = Searches()


class SearchMemory:
    """Answers to searches among the clouds of windows, by window and path of the search.

    Searches whose answers there is no room for, within `bound` bytes, are made again.
    """

    def __init__(self, bound: int) -> None:
        self._answers: ByteCache[Hashable, list[torch.Tensor]] = ByteCache(bound)

    def of(self, windows: Sequence[Hashable]) -> Searches:
        """Searches for one forward pass over the clouds of these windows.

        Args:
            windows: in the order of the clouds, each with the same number of them. The clouds of
                a window, and what the network searches for in them, must be the same in every pass.
        """
        return _RememberedSearches(self._answers, windows, "", set())


class _RememberedSearches(Searches):
    """Searches of one pass, of which those made before are answered from memory."""

    def __init__(
        self,
        answers: ByteCache[Hashable, list[torch.Tensor]],
        windows: Sequence[Hashable],
        path: str,
        made: set[str],
    ) -> None:
        self._answers, self._windows, self._path, self._made = answers, windows, path, made

    def within(self, part: str) -> Searches:
        return _RememberedSearches(self._answers, self._windows, f"{self._path}{part}/", self._made)

    def __call__(self, name: str, search: Callable[..., Answer], *args: Any) -> Answer:
        path = self._path + name
        if path in self._made:
            raise ValueError(f"two searches of a forward pass are named '{path}', expected one")
        self._made.add(path)
        keys = [(window, path) for window in self._windows]
        if all(key in self._answers for key in keys):
            return _join([self._answers[key] for key in keys])
        answer = search(*args)
        for key, part in zip(keys, _split(answer, len(keys)), strict=True):
            if self._answers.has_room(count_bytes(part)):
                self._answers.add(key, [x.clone() for x in part])  # not a view of all windows
        return answer


def _split(answer: Answer, count: int) -> list[list[torch.Tensor]]:
    """Rows of each of `count` windows, indices as 32-bit integers."""
    tensors = answer if isinstance(answer, tuple) else (answer,)
    narrow = [x if x.is_floating_point() else x.to(torch.int32) for x in tensors]
    return [list(part) for part in zip(*(x.chunk(count) for x in narrow), strict=True)]


def _join(parts: Sequence[Sequence[torch.Tensor]]) -> Any:
    """One answer about all windows."""
    whole = [torch.cat(x) for x in zip(*parts, strict=True)]
    wide = tuple(x if x.is_floating_point() else x.long() for x in whole)
    return wide if len(wide) > 1 else wide[0]
