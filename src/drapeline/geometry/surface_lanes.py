"""Closest points on a triangle mesh, and rays to it, for `LANES` points at once, close together.

They go down the mesh's tree of boxes together, each in a lane of a processor's vector registers: a
box is passed by if none of them needs it. That takes a quarter of the time of one point after the
other, and finds the same (to rounding). The bodies are C++, for a processor alone, and read the
tree as Warp 1.19 lays it out: another version of Warp asks for a look at its `bvh.h`.
"""

import numpy as np
import warp as wp

from drapeline.geometry.lanes import LANES, LaneInts, lane_code

wp.set_module_options({"enable_backward": False})

# Squares of the distances of points from the triangle 0, b, c, whose point of weights v and w is
# closest; where none is less than `least` they may be too small, but not less than that.
TO_TRIANGLE = """
const lanes zero = 0.0f, one = 1.0f;
auto greater = [](lanes a, lanes b) { return __builtin_elementwise_max(a, b); };
auto clamped = [&](lanes a) { return __builtin_elementwise_min(greater(a, zero), one); };
auto to_triangle = [&](
    lanes p, lanes q, lanes r, wp::vec3 b, wp::vec3 c, lanes least, lanes& v, lanes& w) {
    const float bb = wp::dot(b, b), bc = wp::dot(b, c), cc = wp::dot(c, c);
    const float ee = bb - 2.0f * bc + cc, square = bb * cc - bc * bc;
    const float round = bb + cc + ee;
    auto to_point = [&](lanes v, lanes w) {
        const lanes i = p - v * b[0] - w * c[0];
        const lanes j = q - v * b[1] - w * c[1];
        const lanes k = r - v * b[2] - w * c[2];
        return i * i + j * j + k * k;
    };
    const lanes pb = p * b[0] + q * b[1] + r * b[2];
    const lanes pc = p * c[0] + q * c[1] + r * c[2];
    lanes away = zero;
    masks past = -1;
    const bool thin = square <= 1.0e-12f * round * round;  // as a line: there are edges alone
    if (!thin) {
        const float scale = 1.0f / square;
        v = (cc * pb - bc * pc) * scale;
        w = (bb * pc - bc * pb) * scale;
        away = to_point(v, w);
        past = (v < zero) | (w < zero) | (v + w > one);
    }
    if (any(past)) {
        if (!any(away < least))
            return away;  // nothing of a face is closer than its plane
        // Of an edge without length it is clamped from NaN to 0.
        const lanes s = clamped(pb / bb), t = clamped(pc / cc);
        const lanes o = clamped((pc - pb + bb - bc) / ee);
        lanes edge_v = s, edge_w = zero, to_edge = to_point(s, zero);
        const lanes second = to_point(zero, t), third = to_point(one - o, o);
        masks closer = second < to_edge;
        edge_v = closer ? zero : edge_v;
        edge_w = closer ? t : edge_w;
        to_edge = closer ? second : to_edge;
        closer = third < to_edge;
        edge_v = closer ? one - o : edge_v;
        edge_w = closer ? o : edge_w;
        to_edge = closer ? third : to_edge;
        v = past ? edge_v : v;
        w = past ? edge_w : w;
        away = past ? to_edge : away;
        if (thin)
            away *= 1.0001f;  // its edges are its neighbours' too, which come first
    }
    return away;
};
"""

_CLOSEST = """
typedef float half_lanes __attribute__((ext_vector_type(4)));
const wp::Mesh& mesh = *(const wp::Mesh*)surface;
const wp::BVH& tree = mesh.bvh;
const int* which = (const int*)patches.data + 8 * patch;
lanes x, y, z, least, best_v = zero, best_w = zero;
masks best = -1;
for (int k = 0; k < 8; ++k) {
    const wp::vec3 point = points.data[which[k]];
    const float reach = reaches.data[which[k]];
    x[k] = point[0];
    y[k] = point[1];
    z[k] = point[2];
    least[k] = reach > 0.0f ? reach * reach : -1.0f;
}
auto to_box = [&](int node) {
    const wp::BVHPackedNodeHalf low = tree.node_lowers[node], high = tree.node_uppers[node];
    const lanes u = greater(greater(low.x - x, x - high.x), zero);
    const lanes v = greater(greater(low.y - y, y - high.y), zero);
    const lanes w = greater(greater(low.z - z, z - high.z), zero);
    return u * u + v * v + w * w;
};
auto try_face = [&](int face) {
    const int* corners = mesh.indices.data + 3 * face;
    const wp::vec3 a = mesh.points.data[corners[0]];
    const wp::vec3 b = mesh.points.data[corners[1]] - a;
    const wp::vec3 c = mesh.points.data[corners[2]] - a;
    lanes v = zero, w = zero;
    const lanes away = to_triangle(x - a[0], y - a[1], z - a[2], b, c, least, v, w);
    const masks closer = away < least;
    least = closer ? away : least;
    best_v = closer ? v : best_v;
    best_w = closer ? w : best_w;
    best = closer ? (masks)face : best;
};
int stack[BVH_QUERY_STACK_SIZE];
int count = 1;
stack[0] = *tree.root;
while (count) {
    const int node = stack[--count];
    if (!any(to_box(node) < least))
        continue;
    const wp::BVHPackedNodeHalf low = tree.node_lowers[node], high = tree.node_uppers[node];
    const int first = low.i, second = high.i;
    if (low.b) {
        for (int item = first; item < second; ++item)
            try_face(tree.primitive_indices[item]);
        continue;
    }
    const lanes to_first = to_box(first), to_second = to_box(second);
    const bool in_first = any(to_first < least), in_second = any(to_second < least);
    // The box that is closer to most of them comes off the stack first.
    const lanes more = to_first - to_second;
    const half_lanes sums = more.lo + more.hi;
    const bool turned = sums.x + sums.y + sums.z + sums.w > 0.0f;
    if (turned ? in_first : in_second)
        stack[count++] = turned ? first : second;
    if (turned ? in_second : in_first)
        stack[count++] = turned ? second : first;
}
for (int k = 0; k < 8; ++k) {
    if (best[k] >= 0) {
        faces.data[which[k]] = best[k];
        weights.data[which[k]] = wp::vec3(1.0f - best_v[k] - best_w[k], best_v[k], best_w[k]);
    }
}
"""


@wp.func_native(lane_code(TO_TRIANGLE + _CLOSEST))
def closest_in_lanes(
    surface: wp.uint64,
    patches: wp.array[LaneInts],
    patch: int,
    points: wp.array[wp.vec3],
    reaches: wp.array[float],
    faces: wp.array[int],
    weights: wp.array[wp.vec3],
):
    """For Warp's kernels: the face closest to each point of a patch, and weights of its corners.

    Args:
        surface: the mesh.
        patches: numbers of the points of all patches.
        patch: which is searched.
        points: of all patches.
        reaches: how far from each the surface is looked for in metres; 0 for one that is not
            searched.
        faces, weights: stay as they are where nothing is found.
    """


@wp.kernel
def find_closest_in_lanes(
    surface: wp.uint64,
    patches: wp.array[LaneInts],
    points: wp.array[wp.vec3],
    reaches: wp.array[float],
    faces: wp.array[int],
    weights: wp.array[wp.vec3],
):
    """`closest_in_lanes` for each patch of points, on one surface."""
    closest_in_lanes(surface, patches, wp.tid(), points, reaches, faces, weights)


def rows_in_order(count: int) -> wp.array:
    """Patches of so many points that follow one another; the last is repeated to fill its row."""
    numbers = np.arange(-(-count // LANES) * LANES, dtype=np.int32).reshape(-1, LANES)
    return wp.array(np.minimum(numbers, count - 1), dtype=LaneInts, device="cpu")


_RAYS = """
const wp::Mesh& mesh = *(const wp::Mesh*)surface;
const wp::BVH& tree = mesh.bvh;
const int* which = (const int*)patches.data + 8 * patch;
auto lesser = [](lanes a, lanes b) { return __builtin_elementwise_min(a, b); };
auto greater = [](lanes a, lanes b) { return __builtin_elementwise_max(a, b); };
auto lay = [&](const wp::vec3* values, lanes* laid) {
    for (int k = 0; k < 8; ++k)
        for (int axis = 0; axis < 3; ++axis)
            laid[axis][k] = values[which[k]][axis];
};
lanes from[3];
lay(points.data, from);
// Over all faces in boxes that any of the rays meets before its reach, which may become shorter.
auto descend = [&](const lanes* ways, const lanes& reach, auto try_face) {
    lanes inverse[3];
    for (int axis = 0; axis < 3; ++axis) {
        const lanes size = greater(ways[axis], -ways[axis]);
        inverse[axis] = 1.0f / (size > 1.0e-12f ? ways[axis] : (lanes)1.0e-12f);
    }
    int stack[BVH_QUERY_STACK_SIZE];
    int count = 1;
    stack[0] = *tree.root;
    while (count) {
        const int node = stack[--count];
        const wp::BVHPackedNodeHalf low = tree.node_lowers[node], high = tree.node_uppers[node];
        const float lows[3] = {low.x, low.y, low.z}, highs[3] = {high.x, high.y, high.z};
        lanes in = 0.0f, out = reach;
        for (int axis = 0; axis < 3; ++axis) {
            const lanes a = (lows[axis] - from[axis]) * inverse[axis];
            const lanes b = (highs[axis] - from[axis]) * inverse[axis];
            in = greater(in, lesser(a, b));
            out = lesser(out, greater(a, b));
        }
        if (!any(in <= out * 1.000001f))
            continue;
        const int first = low.i, second = high.i;
        if (low.b) {
            for (int item = first; item < second; ++item)
                try_face(mesh.indices.data + 3 * tree.primitive_indices[item],
                    tree.primitive_indices[item]);
        } else {
            stack[count++] = second;
            stack[count++] = first;
        }
    }
};
"""

_WIND = """
// In a frame whose third axis is along the rays these are points (Woop et al. 2013).
const int third = wp::max_dim(way);
const int first = (third + 1) % 3, second = (third + 2) % 3;
const float slope = way[first] / way[third], rise = way[second] / way[third];
const lanes along = from[third];
const lanes x = from[first] - slope * along, y = from[second] - rise * along;
masks wound = 0;
auto try_face = [&](const int* corners, int) {
    lanes p[3], q[3], ahead[3];
    for (int k = 0; k < 3; ++k) {
        const wp::vec3 corner = mesh.points.data[corners[k]];
        p[k] = (corner[first] - slope * corner[third]) - x;
        q[k] = (corner[second] - rise * corner[third]) - y;
        ahead[k] = (corner[third] - along) * way[third];
    }
    const lanes u = p[1] * q[2] - p[2] * q[1];
    const lanes v = p[2] * q[0] - p[0] * q[2];
    const lanes w = p[0] * q[1] - p[1] * q[0];
    const masks right = lesser(lesser(u, v), w) >= 0.0f;
    const masks left = greater(greater(u, v), w) <= 0.0f;
    if (!any(right | left))
        return;
    const lanes far = u * ahead[0] + v * ahead[1] + w * ahead[2];
    wound += (right & (far > 0.0f)) ? (masks)1 : (masks)0;
    wound -= (left & (far < 0.0f)) ? (masks)1 : (masks)0;
};
const lanes ways[3] = {(lanes)way[0], (lanes)way[1], (lanes)way[2]}, no_end = 1.0e9f;
descend(ways, no_end, try_face);
// Seen against the third axis, a face that turns right turns left.
for (int k = 0; k < 8; ++k)
    windings.data[which[k]] = way[third] > 0.0f ? wound[k] : -wound[k];
"""

_HIT = """
lanes d[3], reach, best_u = 0.0f, best_v = 0.0f;
masks best = -1;
lay(ways.data, d);
for (int k = 0; k < 8; ++k)
    reach[k] = reaches.data[which[k]] > 0.0f ? reaches.data[which[k]] : -1.0f;
auto try_face = [&](const int* corners, int face) {
    const wp::vec3 a = mesh.points.data[corners[0]];
    const wp::vec3 b = mesh.points.data[corners[1]] - a, c = mesh.points.data[corners[2]] - a;
    const wp::vec3 normal = wp::cross(b, c);
    const lanes x = from[0] - a[0], y = from[1] - a[1], z = from[2] - a[2];
    const lanes scale = 1.0f / (d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2]);
    const lanes far = -scale * (x * normal[0] + y * normal[1] + z * normal[2]);
    const masks nearer = (far >= 0.0f) & (far < reach);
    if (!any(nearer))
        return;
    const lanes p = y * d[2] - z * d[1], q = z * d[0] - x * d[2], r = x * d[1] - y * d[0];
    const lanes u = -scale * (p * c[0] + q * c[1] + r * c[2]);
    const lanes v = scale * (p * b[0] + q * b[1] + r * b[2]);
    const masks hit = nearer & (lesser(lesser(u, v), 1.0f - u - v) >= 0.0f);
    reach = hit ? far : reach;
    best_u = hit ? u : best_u;
    best_v = hit ? v : best_v;
    best = hit ? (masks)face : best;
};
descend(d, reach, try_face);
for (int k = 0; k < 8; ++k) {
    faces.data[which[k]] = best[k];
    weights.data[which[k]] = wp::vec3(1.0f - best_u[k] - best_v[k], best_u[k], best_v[k]);
}
"""


@wp.func_native(lane_code(_RAYS + _WIND))
def windings_in_lanes(
    surface: wp.uint64,
    patches: wp.array[LaneInts],
    patch: int,
    points: wp.array[wp.vec3],
    way: wp.vec3,
    windings: wp.array[int],
):
    """For Warp's kernels: how often rays from points leave a surface, less how often they enter it.

    Args:
        surface: the mesh, closed, its faces outward.
        patches: numbers of the points of all patches.
        patch: whose rays are followed.
        points: of all patches.
        way: of its rays, a unit vector; the shorter their way out, the faster.
        windings: is found for its points.
    """


@wp.func_native(lane_code(_RAYS + _HIT))
def hits_in_lanes(
    surface: wp.uint64,
    patches: wp.array[LaneInts],
    patch: int,
    points: wp.array[wp.vec3],
    ways: wp.array[wp.vec3],
    reaches: wp.array[float],
    faces: wp.array[int],
    weights: wp.array[wp.vec3],
):
    """For Warp's kernels: the face that each ray of a patch hits first, and weights of its corners.

    Args:
        surface: the mesh.
        patches: numbers of the rays of all patches.
        patch: whose rays are followed.
        points: where all rays start.
        ways: unit vectors along all rays.
        reaches: their lengths in metres; of no length, 0, hits nothing.
        faces: is found for those of the patch, -1 for nothing.
        weights: likewise.
    """
