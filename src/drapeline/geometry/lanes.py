"""Lanes: several points or constraints at once, one in each lane of a vector register.

A processor takes `LANES` at once; a GPU, whose threads are its lanes, takes one in each thread.
"""

import numpy as np
import warp as wp

LANES = 8
LaneFloats = wp.types.vector(LANES, wp.float32)  # Warp's types of a number in each lane,
LaneInts = wp.types.vector(LANES, wp.int32)  # and of an index

# Cells along an axis of Morton's curve, and how the bits of their numbers are spread, two zeros
# between each and the next.
_CURVE_CELLS = 1024
_SPREAD = ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249))

# The same for kernels' bodies in C++, which the compiler keeps in vector registers. Rows of Warp's
# arrays are aligned for single numbers only.
_CPP = f"""
typedef float lanes __attribute__((ext_vector_type({LANES})));
typedef int masks __attribute__((ext_vector_type({LANES})));
typedef lanes loose_lanes __attribute__((aligned(4)));
auto any = [](masks m) {{ return __builtin_reduce_or(m) != 0; }};
"""


def lane_code(body: str, **numbers: float) -> str:
    """The C++ body of a function for Warp's `func_native` that knows of lanes.

    Args:
        body: of the function.
        numbers: what is to stand for each of these names in it.
    """
    for name, value in numbers.items():
        body = body.replace(name, f"{float(value)!r}f")
    return _CPP + body


# Goes down a tree of boxes with the points of a patch: its faces are looked at whose boxes, with
# others beside them, come within the margin of the box around the points.
_NEAR = """
const wp::BVH& boxes = *(const wp::BVH*)tree;
const int* which = (const int*)patches.data + 8 * patch;
const int size = sizes.data[patch];
lanes x, y, z;
wp::vec3 low = point(which[0]), high = low;
for (int k = 0; k < 8; ++k) {
    const wp::vec3 p = point(which[k]);
    x[k] = p[0];
    y[k] = p[1];
    z[k] = p[2];
    low = wp::min(low, p);
    high = wp::max(high, p);
}
low -= wp::vec3(margin);
high += wp::vec3(margin);
auto descend = [&](auto look) {
    int stack[BVH_QUERY_STACK_SIZE];
    int waiting = 1;
    stack[0] = *boxes.root;
    while (waiting) {
        const int node = stack[--waiting];
        const wp::BVHPackedNodeHalf from = boxes.node_lowers[node], to = boxes.node_uppers[node];
        if (from.x > high[0] || from.y > high[1] || from.z > high[2]
            || to.x < low[0] || to.y < low[1] || to.z < low[2])
            continue;
        if (from.b) {
            for (int item = from.i; item < (int)to.i; ++item)
                look(boxes.primitive_indices[item]);
            continue;
        }
        stack[waiting++] = from.i;
        stack[waiting++] = to.i;
    }
};
"""


def near_code(point: str, body: str, **numbers: float) -> str:
    """`lane_code` that looks at what is near to the points of a patch, by `descend`.

    The function has a `patch` among `patches`, their `sizes`, a `tree` and a `margin`.

    Args:
        point: where a point is by its `number`, in C++.
        body: of the function, which has `which`, `size` and the places `x`, `y` and `z`.
        numbers: see `lane_code`.
    """
    found = f"auto point = [&](int number) {{ return {point}; }};"
    return lane_code(found + _NEAR + body, **numbers)


def fill_lanes(colours: np.ndarray, width: int) -> np.ndarray:
    """Rows (R, width) of constraints of one colour, of those (C,) sorted; -1 for an empty lane."""
    starts = np.flatnonzero(np.diff(colours, prepend=-1))
    sizes = np.diff(starts, append=len(colours))
    rows = -(-sizes // width)
    before = np.concatenate([[0], np.cumsum(rows)])
    lanes = np.full((before[-1], width), -1, dtype=np.int32)
    numbers = np.arange(len(colours))
    lanes.ravel()[numbers + np.repeat(width * before[:-1] - starts, sizes)] = numbers
    return lanes


def repeat_first(lanes: np.ndarray) -> np.ndarray:
    """Rows (R, width) of numbers whose empty lanes, -1, have that of their row's first."""
    return np.where(lanes < 0, lanes[:, :1], lanes)


def lay_in_lanes(values: np.ndarray, lanes: np.ndarray) -> np.ndarray:
    """Values (C, K) in lanes (R, width): (R, K, width). An empty lane repeats its row's first."""
    return np.ascontiguousarray(np.swapaxes(values[repeat_first(lanes)], 1, 2))


def make_patches(points: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Rows (R, LANES) of points (P, 3) of a group (P,) that lie together; -1 for an empty lane."""
    parts = [
        part
        for group in np.unique(groups)
        for part in _bisect(points, np.flatnonzero(groups == group))
    ]
    patches = np.full((len(parts), LANES), -1, dtype=np.int32)
    for patch, part in zip(patches, parts, strict=True):
        patch[: len(part)] = part
    return patches


def rows_of_neighbours(points: np.ndarray) -> np.ndarray:
    """Rows (R, LANES) of points (P, 3) that lie together: their numbers, the last one repeated.

    Unlike `make_patches` it takes less time than a search with them: the points are sorted along
    Morton's curve (1966), which goes through space cell by cell.
    """
    with np.errstate(invalid="ignore"):  # points that are nowhere may have any place in the order
        away = points - points.min(axis=0)
        size = max(float(away.max()), 1e-9)
        cells = (_CURVE_CELLS * (away / size)).astype(np.int64)
    key = np.zeros(len(points), dtype=np.int64)
    for axis in range(3):
        bits = np.minimum(cells[:, axis], _CURVE_CELLS - 1)
        for shift, mask in _SPREAD:
            bits = (bits | (bits << shift)) & mask
        key |= bits << axis
    order = np.argsort(key, kind="stable").astype(np.int32)
    return np.pad(order, (0, -len(order) % LANES), mode="edge").reshape(-1, LANES)


def _bisect(points: np.ndarray, chosen: np.ndarray) -> list[np.ndarray]:
    if len(chosen) <= LANES:
        return [chosen]
    axis = np.argmax(np.ptp(points[chosen], axis=0))
    half = LANES * -(-len(chosen) // (2 * LANES))
    order = chosen[np.argpartition(points[chosen, axis], half - 1)]
    return [*_bisect(points, order[:half]), *_bisect(points, order[half:])]
