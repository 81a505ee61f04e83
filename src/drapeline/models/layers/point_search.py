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
_BUCKET = wp.constant(32)


@wp.kernel
def _farthest(
    points: wp.array2d(dtype=wp.vec3),
    index: wp.array2d(dtype=wp.int64),
    distance: wp.array2d(dtype=float),
    low: wp.array2d(dtype=wp.vec3),
    high: wp.array2d(dtype=wp.vec3),
    most: wp.array2d(dtype=float),
    top: wp.array2d(dtype=int),
    chosen: wp.array2d(dtype=wp.int64),
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
