"""Searches among the points of a cloud: farthest points, balls, nearest neighbours.

All of them return indices, and none has a gradient. They run on the device of their tensors without
copying them, and their results are those of a plain search over all points. A cloud may be padded:
points that are not `valid` are never chosen, except in a cloud without any valid point, whose
indices mean nothing.
"""

import torch
import warp as wp

from drapeline.geometry.warp_mesh import start_warp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _farthest(
    points: wp.array2d(dtype=wp.vec3),
    distance: wp.array2d(dtype=float),
    chosen: wp.array2d(dtype=wp.int64),
):
    """One thread per cloud; `distance` comes in as infinity, or -1 for points not to choose.

    The first point is chosen already.
    """
    cloud = wp.tid()
    for step in range(1, chosen.shape[1]):
        last = int(chosen[cloud, step - 1])
        place = points[cloud, last]
        best = float(-1.0)  # noqa: UP018  (a plain number would be a constant)
        for i in range(points.shape[1]):
            away = wp.min(distance[cloud, i], wp.length_sq(points[cloud, i] - place))
            distance[cloud, i] = away
            if away > best:
                best = away
                last = i
        chosen[cloud, step] = wp.int64(last)


@wp.kernel
def _ball(
    points: wp.array2d(dtype=wp.vec3),
    valid: wp.array2d(dtype=wp.bool),
    centres: wp.array2d(dtype=wp.vec3),
    squared_radius: float,
    chosen: wp.array3d(dtype=wp.int64),
):
    """One thread per centre; stops when its list is full."""
    cloud, centre = wp.tid()
    place = centres[cloud, centre]
    row = points[cloud]
    allowed = valid[cloud]
    found = chosen[cloud, centre]
    width = found.shape[0]
    count = int(0)  # noqa: RUF046, UP018
    for i in range(row.shape[0]):
        if wp.length_sq(row[i] - place) <= squared_radius:  # noqa: SIM102  (`and` asks for both)
            if allowed[i]:
                found[count] = wp.int64(i)
                count += 1
                if count == width:
                    return
    if count == 0:
        least = float(wp.inf)
        for i in range(row.shape[0]):
            away = wp.length_sq(row[i] - place)
            if away < least:  # noqa: SIM102
                if allowed[i]:
                    least = away
                    found[0] = wp.int64(i)
        count = 1
    for slot in range(count, width):
        found[slot] = found[0]


@wp.kernel
def _nearest(
    points: wp.array2d(dtype=wp.vec3),
    valid: wp.array2d(dtype=wp.bool),
    queries: wp.array2d(dtype=wp.vec3),
    squared: wp.array3d(dtype=float),
    chosen: wp.array3d(dtype=wp.int64),
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
    distance = points.new_full(valid.shape, torch.inf, dtype=torch.float32)
    _launch(_farthest, _vectors(points), distance.masked_fill_(~valid, -1), chosen)
    return chosen


@torch.no_grad()
def ball_neighbours(
    points: torch.Tensor,
    centres: torch.Tensor,
    radius: float,
    count: int,
    valid: torch.Tensor | None = None,
) -> torch.Tensor:
    """Points within a radius of each centre, those with the lowest indices first.

    A short list is filled up with its first point; if no point is within the radius, it is the
    nearest one.

    Args:
        points: (B, P, 3).
        centres: (B, Q, 3).
        radius: in the unit of the points.
        count: length of the lists.
        valid: (B, P) bool.

    Returns:
        (B, Q, count) int64.
    """
    chosen = points.new_zeros((*centres.shape[:2], count), dtype=torch.int64)
    cloud, valid = _vectors(points), _valid(points, valid)
    _launch(_ball, cloud, valid, _vectors(centres), radius**2, chosen)
    return chosen


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
    cloud, valid = _vectors(points), _valid(points, valid)
    _launch(_nearest, cloud, valid, _vectors(queries), squared, chosen)
    return squared, chosen


def gather_rows(rows: torch.Tensor, index: torch.Tensor) -> torch.Tensor:
    """Rows (B, P, C) at indices (B, ...) of the same cloud, (B, ..., C)."""
    clouds, count, width = rows.shape
    first = torch.arange(clouds, device=index.device) * count
    flat = (index + first.view(-1, *[1] * (index.dim() - 1))).flatten()
    return rows.reshape(-1, width).index_select(0, flat).view(*index.shape, width)


def _vectors(points: torch.Tensor) -> wp.array:
    """(B, P, 3) as an array (B, P) of vectors, on the same memory if that is float32."""
    start_warp()
    return wp.from_torch(points.detach().to(torch.float32).contiguous(), dtype=wp.vec3)


def _valid(points: torch.Tensor, valid: torch.Tensor | None) -> torch.Tensor:
    if valid is None:
        return torch.ones(points.shape[:2], dtype=torch.bool, device=points.device)
    return valid.contiguous()


def _launch(kernel: wp.Kernel, *values: wp.array | torch.Tensor | float) -> None:
    """Run a kernel on the memory of its arrays, all of which have a row per cloud.

    The last is the output; a thread is started for each of its clouds, or for each cloud and
    centre if it has three axes.
    """
    arrays = [wp.from_torch(v) if isinstance(v, torch.Tensor) else v for v in values]
    shape = arrays[-1].shape[: max(arrays[-1].ndim - 1, 1)]
    wp.launch(kernel, dim=shape, inputs=arrays, device=arrays[-1].device)
