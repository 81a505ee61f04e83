"""Springs and hinges on a processor: `LANES` at once, each in a lane of its vector registers.

They do what `elasticity.pull_springs` and `turn_hinges` do, which are for a GPU. Their bodies are
C++: of Warp's own vectors the compiler makes single numbers again where lanes are gathered and
scattered, and what comes of that takes more than twice as long.
"""

import warp as wp

from drapeline.geometry.lanes import INDICES, NUMBERS, lane_code
from drapeline.xpbd.elasticity import FLIPPED_M2, SHORTEST_M, SMALLEST_M2

wp.set_module_options({"enable_backward": False})

# `take` and `put` read and write (x, y, z, inverse mass) of eight vertices as four vectors and
# four: they are transposed on the way.
_GATHER = """
typedef float quad __attribute__((ext_vector_type(4)));
typedef quad loose_quad __attribute__((aligned(4)));
loose_quad* at = (loose_quad*)weighed.data;
auto take = [at](const int* which, lanes& x, lanes& y, lanes& z, lanes& w) {
    lanes q[4];
    for (int k = 0; k < 4; ++k) {
        const quad low = at[which[k]], high = at[which[k + 4]];
        q[k] = __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
    }
    const lanes a = __builtin_shufflevector(q[0], q[1], 0, 8, 1, 9, 4, 12, 5, 13);
    const lanes b = __builtin_shufflevector(q[2], q[3], 0, 8, 1, 9, 4, 12, 5, 13);
    const lanes c = __builtin_shufflevector(q[0], q[1], 2, 10, 3, 11, 6, 14, 7, 15);
    const lanes d = __builtin_shufflevector(q[2], q[3], 2, 10, 3, 11, 6, 14, 7, 15);
    x = __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13);
    y = __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15);
    z = __builtin_shufflevector(c, d, 0, 1, 8, 9, 4, 5, 12, 13);
    w = __builtin_shufflevector(c, d, 2, 3, 10, 11, 6, 7, 14, 15);
};
auto put = [at](const int* which, lanes x, lanes y, lanes z, lanes w) {
    const lanes a = __builtin_shufflevector(x, y, 0, 8, 1, 9, 4, 12, 5, 13);
    const lanes b = __builtin_shufflevector(z, w, 0, 8, 1, 9, 4, 12, 5, 13);
    const lanes c = __builtin_shufflevector(x, y, 2, 10, 3, 11, 6, 14, 7, 15);
    const lanes d = __builtin_shufflevector(z, w, 2, 10, 3, 11, 6, 14, 7, 15);
    at[which[0]] = __builtin_shufflevector(a, b, 0, 1, 8, 9);
    at[which[1]] = __builtin_shufflevector(a, b, 2, 3, 10, 11);
    at[which[2]] = __builtin_shufflevector(c, d, 0, 1, 8, 9);
    at[which[3]] = __builtin_shufflevector(c, d, 2, 3, 10, 11);
    at[which[4]] = __builtin_shufflevector(a, b, 4, 5, 12, 13);
    at[which[5]] = __builtin_shufflevector(a, b, 6, 7, 14, 15);
    at[which[6]] = __builtin_shufflevector(c, d, 4, 5, 12, 13);
    at[which[7]] = __builtin_shufflevector(c, d, 6, 7, 14, 15);
};
"""

_PULL = """
const int* one = (const int*)ends.data + 16 * row;
const int* two = one + 8;
const loose_lanes* number = (const loose_lanes*)numbers.data + 4 * row;
loose_lanes* pulled = (loose_lanes*)pull.data + row;
loose_lanes* last = (loose_lanes*)lengths.data + row;
lanes a, b, c, d, e, f, mass, other_mass;
take(one, a, b, c, mass);
take(two, d, e, f, other_mass);
const lanes x = a - d, y = b - e, z = c - f;
const lanes length = __builtin_elementwise_sqrt(x * x + y * y + z * z) + SHORTEST_M;
lanes push = number[0] - length - number[2] * (length - *last);
if (!begins)
    push -= number[1] * *pulled;
push *= share * number[3];
*pulled = begins ? push : *pulled + push;
if (finishes)
    *last = length + push * (mass + other_mass);
push /= length;
const lanes p = push * mass, q = push * other_mass;
put(one, a + x * p, b + y * p, c + z * p, mass);
put(two, d - x * q, e - y * q, f - z * q, other_mass);
"""

_TURN = """
const int* which = (const int*)corners.data + 32 * row;
const loose_lanes* number = (const loose_lanes*)numbers.data + 4 * row;
const loose_lanes* weight = (const loose_lanes*)weights.data + 4 * row;
loose_lanes* last = (loose_lanes*)turned.data + row;
lanes x[4], y[4], z[4], mass[4];
for (int k = 0; k < 4; ++k)
    take(which + 8 * k, x[k], y[k], z[k], mass[k]);
lanes u = 0.0f, v = 0.0f, w = 0.0f;
for (int k = 0; k < 4; ++k) {
    u += weight[k] * x[k];
    v += weight[k] * y[k];
    w += weight[k] * z[k];
}
const lanes a = x[1] - x[0], b = y[1] - y[0], c = z[1] - z[0];
const lanes d = x[3] - x[2], e = y[3] - y[2], f = z[3] - z[2];
const lanes g = b * f - c * e, h = c * d - a * f, i = a * e - b * d;
const lanes size = __builtin_elementwise_sqrt(g * g + h * h + i * i) + SMALLEST_M2;
const lanes bent = (g * u + h * v + i * w) / size;
// From far on one side to far on the other: it is folded flat, and its normal has flipped.
const lanes rate = bent * *last < -FLIPPED_M2 ? (lanes)0.0f : bent - *last;
const lanes push = (number[0] - bent - number[2] * rate) * number[3];
*last = bent + push * number[1];
const lanes way = push / size;
for (int k = 0; k < 4; ++k) {
    const lanes m = way * weight[k] * mass[k];
    put(which + 8 * k, x[k] + g * m, y[k] + h * m, z[k] + i * m, mass[k]);
}
"""


@wp.func_native(lane_code(_GATHER + _PULL, SHORTEST_M=SHORTEST_M))
def _pull(
    ends: wp.array2d(dtype=INDICES),
    numbers: wp.array2d(dtype=NUMBERS),
    row: int,
    begins: int,
    finishes: int,
    share: float,
    pull: wp.array(dtype=NUMBERS),
    lengths: wp.array(dtype=NUMBERS),
    weighed: wp.array(dtype=wp.vec4),
): ...


@wp.func_native(lane_code(_GATHER + _TURN, SMALLEST_M2=SMALLEST_M2, FLIPPED_M2=FLIPPED_M2))
def _turn(
    corners: wp.array2d(dtype=INDICES),
    weights: wp.array2d(dtype=NUMBERS),
    numbers: wp.array2d(dtype=NUMBERS),
    row: int,
    turned: wp.array(dtype=NUMBERS),
    weighed: wp.array(dtype=wp.vec4),
): ...


@wp.kernel
def pull_springs_in_lanes(
    ends: wp.array2d(dtype=INDICES),
    numbers: wp.array2d(dtype=NUMBERS),
    first: int,  # row
    begins: int,
    finishes: int,
    share: float,
    pull: wp.array(dtype=NUMBERS),
    lengths: wp.array(dtype=NUMBERS),
    weighed: wp.array(dtype=wp.vec4),
):
    """As `elasticity.pull_springs`, for those of a row; an empty lane repeats a full one."""
    row = first + wp.tid()
    _pull(ends, numbers, row, begins, finishes, share, pull, lengths, weighed)


@wp.kernel
def turn_hinges_in_lanes(
    corners: wp.array2d(dtype=INDICES),
    weights: wp.array2d(dtype=NUMBERS),
    numbers: wp.array2d(dtype=NUMBERS),
    first: int,  # row
    turned: wp.array(dtype=NUMBERS),
    weighed: wp.array(dtype=wp.vec4),
):
    """As `elasticity.turn_hinges`, for those of a row; an empty lane repeats a full one."""
    _turn(corners, weights, numbers, first + wp.tid(), turned, weighed)
