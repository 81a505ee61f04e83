"""Contacts and elasticity on a processor: `LANES` at once, each in a lane of vector registers.

Springs and hinges do what `elasticity.pull_springs` and `turn_hinges` do, which are for a GPU. The
bodies are C++: of Warp's own vectors the compiler makes single numbers again where lanes are
gathered and scattered, and what comes of that takes more than twice as long. A GPU's compiler would
refuse the file, so that no kernel for one may stand here.
"""

import warp as wp

from drapeline.geometry.lanes import LaneFloats, LaneInts, lane_code, near_code
from drapeline.geometry.surface_lanes import TO_TRIANGLE, closest_in_lanes, hits_in_lanes
from drapeline.xpbd.contact import Near
from drapeline.xpbd.elasticity import FLIPPED_M2, SHORTEST_M, SMALLEST_M2

wp.set_module_options({"enable_backward": False})


@wp.kernel
def search_in_lanes(
    meshes: wp.array[wp.uint64],
    homes: wp.array[int],
    patches: wp.array[LaneInts],  # of vertices that have the same home
    place: wp.array[wp.vec3],
    reach: float,
    reaches: wp.array[float],
    again: wp.array[float],
    parts: wp.array[int],
    found: wp.array[int],
    found_weights: wp.array[wp.vec3],
):
    """As `body_contact.search_one_per_thread`, for the vertices of a patch."""
    patch = wp.tid()
    vertices = patches[patch]
    home = homes[vertices[0]]
    last = len(meshes) - 1
    closest_in_lanes(meshes[home], patches, patch, place, reaches, found, found_weights)
    missed = bool(False)  # noqa: UP018  (a plain False would be a constant)
    for k in range(len(vertices)):
        i = vertices[k]
        parts[i] = home
        again[i] = 0.0
        if home < last and reaches[i] > 0.0 and found[i] < 0:
            parts[i] = last
            again[i] = reach
            missed = True
    if missed:
        closest_in_lanes(meshes[last], patches, patch, place, again, found, found_weights)


@wp.kernel
def look_in_lanes(
    whole: wp.uint64,
    patches: wp.array[LaneInts],
    starts: wp.array[wp.vec3],
    ways: wp.array[wp.vec3],
    reaches: wp.array[float],
    facing: wp.array[int],
    facing_weights: wp.array[wp.vec3],
):
    """As `body_contact.look_one_per_thread`, for the rays of a patch."""
    hits_in_lanes(whole, patches, wp.tid(), starts, ways, reaches, facing, facing_weights)


SMALLEST_M4 = 1e-14  # square of a triangle's doubled area, below which it has no sides

# Faces whose boxes meet the patch's are looked at in all lanes; what is near is noted lane by lane.
_FIND_NEAR = """
const loose_lanes* at_rest = (const loose_lanes*)rest.data + 3 * patch;
const lanes rest_x = at_rest[0], rest_y = at_rest[1], rest_z = at_rest[2];
const int layer = layers.data[which[0]];
const int slots = near.shape[1];
int found[8] = {};
lanes sweep_x, sweep_y, sweep_z;
float most = 0.0f;
for (int k = 0; k < 8; ++k) {
    const wp::vec3 s = sweep.data[which[k]];
    sweep_x[k] = s[0];
    sweep_y[k] = s[1];
    sweep_z[k] = s[2];
    most = wp::max(most, wp::length(s));
}
low -= wp::vec3(most);
high += wp::vec3(most);
auto note = [&](int number, masks here, lanes reach, lanes room) {
    const int* corners = (const int*)triangles.data + 3 * number;
    const wp::vec3 a = place.data[corners[0]];
    const wp::vec3 b = place.data[corners[1]] - a;
    const wp::vec3 c = place.data[corners[2]] - a;
    const wp::vec3 normal = wp::cross(b, c);
    const float square = wp::dot(normal, normal);
    const lanes p = x - a[0], q = y - a[1], r = z - a[2];
    const lanes height = p * normal[0] + q * normal[1] + r * normal[2];
    here &= height * height < reach * reach * square;
    if (!any(here))
        return;
    lanes v = zero, w = zero;
    here &= to_triangle(p, q, r, b, c, reach * reach, v, w) < reach * reach;
    for (int k = 0; k < size; ++k)
        if (here[k] && found[k] < slots) {
            const int slot = slots * which[k] + found[k];
            rooms.data[slot] = room[k];
            due.data[slot] = 0;
            near.data[slots * which[k] + found[k]++] = number;
        }
};
auto look = [&](int face) {
    const wp::vec4 s = sweeps.data[face];
    const lanes i = sweep_x - s[0], j = sweep_y - s[1], l = sweep_z - s[2];
    const lanes past = __builtin_elementwise_sqrt(i * i + j * j + l * l) + s[3];
    // The box around the face's whole way is larger than the one half-way by this much.
    const float more = wp::sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]) + s[3];
    const wp::vec3 start = lower.data[face] + wp::vec3(more);
    const wp::vec3 end = upper.data[face] - wp::vec3(more);
    const lanes far = past + margin;
    masks here = (x > start[0] - far) & (x < end[0] + far) & (y > start[1] - far);
    here &= (y < end[1] + far) & (z > start[2] - far) & (z < end[2] + far);
    const int* corners = (const int*)triangles.data + 3 * halves * face;
    lanes room = 1.0e3f, reach = far;
    if (layers.data[corners[0]] == layer) {
        // Parts of a garment that are close at rest may be close, and a face's own corners are.
        const wp::vec3 centre = rest_centres.data[face];
        const lanes u = rest_x - centre[0], v = rest_y - centre[1], w = rest_z - centre[2];
        room = __builtin_elementwise_sqrt(u * u + v * v + w * w) - rest_radii.data[face];
        reach = __builtin_elementwise_min(reach, share * room);
        here &= reach > 0.0f;
    }
    if (any(here))
        for (int k = 0; k < halves; ++k)
            note(halves * face + k, here, reach, room);
};
descend(look);
for (int k = 0; k < size; ++k) {
    count.data[which[k]] = found[k];
    soon.data[which[k]] = 0;
}
"""


@wp.func_native(near_code("place.data[number]", TO_TRIANGLE + _FIND_NEAR))
def _find_near(
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    patches: wp.array[LaneInts],
    patch: int,
    sizes: wp.array[int],
    rest: wp.array2d[LaneFloats],
    rest_centres: wp.array[wp.vec3],
    rest_radii: wp.array[float],
    place: wp.array[wp.vec3],
    sweep: wp.array[wp.vec3],
    sweeps: wp.array[wp.vec4],
    triangles: wp.array[wp.vec3i],
    halves: int,
    layers: wp.array[int],
    margin: float,
    share: float,
    count: wp.array[int],
    near: wp.array2d[int],
    rooms: wp.array2d[float],
    due: wp.array2d[int],
    soon: wp.array[int],
): ...


@wp.kernel
def find_near_in_lanes(
    patches: wp.array[LaneInts],  # vertices of a garment; empty lanes repeat the first
    sizes: wp.array[int],
    rest: wp.array2d[LaneFloats],
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    rest_centres: wp.array[wp.vec3],
    rest_radii: wp.array[float],
    place: wp.array[wp.vec3],
    sweep: wp.array[wp.vec3],
    sweeps: wp.array[wp.vec4],
    triangles: wp.array[wp.vec3i],
    halves: int,
    layers: wp.array[int],
    margin: float,
    share: float,
    near: Near,
):
    """As `cloth_contact.find_near_one_per_thread`, for the vertices of a patch."""
    _find_near(
        tree,
        lower,
        upper,
        patches,
        wp.tid(),
        sizes,
        rest,
        rest_centres,
        rest_radii,
        place,
        sweep,
        sweeps,
        triangles,
        halves,
        layers,
        margin,
        share,
        near.count,
        near.other,
        near.room_m,
        near.due,
        near.soon,
    )


# As above, for the edges of a patch and those of each face that belong to it, not to its neighbour.
_FIND_NEAR_EDGES = """
const int* ends = (const int*)edges.data;
const int slots = near.shape[1], width = owned.shape[1];
lanes dx, dy, dz, rest_x, rest_y, rest_z, rest_dx, rest_dy, rest_dz;
lanes sweep_x, sweep_y, sweep_z, spread;
masks number, first, second, layer;
float most = 0.0f;
for (int k = 0; k < 8; ++k) {
    number[k] = which[k];
    first[k] = ends[2 * which[k]];
    second[k] = ends[2 * which[k] + 1];
    layer[k] = layers.data[first[k]];
    const wp::vec3 end = place.data[second[k]], way = end - point(which[k]);
    low = wp::min(low, end - wp::vec3(margin));
    high = wp::max(high, end + wp::vec3(margin));
    dx[k] = way[0]; dy[k] = way[1]; dz[k] = way[2];
    const wp::vec3 then = rest.data[first[k]], along = rest.data[second[k]] - then;
    rest_x[k] = then[0]; rest_y[k] = then[1]; rest_z[k] = then[2];
    rest_dx[k] = along[0]; rest_dy[k] = along[1]; rest_dz[k] = along[2];
    const wp::vec3 s = sweep.data[first[k]], t = sweep.data[second[k]], mean = (s + t) * 0.5f;
    sweep_x[k] = mean[0]; sweep_y[k] = mean[1]; sweep_z[k] = mean[2];
    spread[k] = 0.5f * wp::length(s - t);
    most = wp::max(most, wp::length(mean) + spread[k]);
}
low -= wp::vec3(most);
high += wp::vec3(most);
auto lesser = [](lanes a, lanes b) { return __builtin_elementwise_min(a, b); };
auto greater = [](lanes a, lanes b) { return __builtin_elementwise_max(a, b); };
const lanes low_x = lesser(x, x + dx), high_x = greater(x, x + dx);
const lanes low_y = lesser(y, y + dy), high_y = greater(y, y + dy);
const lanes low_z = lesser(z, z + dz), high_z = greater(z, z + dz);
auto clamped = [&](lanes v) {
    return lesser(greater(v, (lanes)0.0f), (lanes)1.0f);
};
auto distance = [&](lanes rx, lanes ry, lanes rz, lanes ux, lanes uy, lanes uz, wp::vec3 e) {
    // Square of the distance of edges from r along u, and from 0 along e (Ericson 2005).
    const lanes dd = ux * ux + uy * uy + uz * uz, de = ux * e[0] + uy * e[1] + uz * e[2];
    const lanes rd = rx * ux + ry * uy + rz * uz, re = rx * e[0] + ry * e[1] + rz * e[2];
    const float ee = wp::dot(e, e);
    const lanes square = dd * ee - de * de;
    lanes s = square > 1e-6f * dd * ee ? clamped((de * re - ee * rd) / square) : (lanes)0.0f;
    const lanes t = (de * s + re) / wp::max(ee, 1e-20f);
    const lanes longest = greater(dd, (lanes)1e-20f);
    s = t < 0.0f ? clamped(-rd / longest) : s;
    s = t > 1.0f ? clamped((de - rd) / longest) : s;
    const lanes v = clamped(t);
    const lanes wx = rx + ux * s - e[0] * v, wy = ry + uy * s - e[1] * v;
    const lanes wz = rz + uz * s - e[2] * v;
    return wx * wx + wy * wy + wz * wz;
};
int found[8] = {};
auto look = [&](int face) {
    const wp::vec4 f = sweeps.data[face];
    const lanes i = sweep_x - f[0], j = sweep_y - f[1], l = sweep_z - f[2];
    const lanes past = __builtin_elementwise_sqrt(i * i + j * j + l * l) + f[3] + spread;
    const float more = wp::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]) + f[3];
    const wp::vec3 start = lower.data[face] + wp::vec3(more);
    const wp::vec3 end = upper.data[face] - wp::vec3(more);
    const lanes far = past + margin, square = far * far;
    masks boxed = (high_x > start[0] - far) & (low_x < end[0] + far) & (high_y > start[1] - far);
    boxed &= (low_y < end[1] + far) & (high_z > start[2] - far) & (low_z < end[2] + far);
    if (!any(boxed))
        return;
    for (int m = 0; m < width; ++m) {
        const int other = owned.data[width * face + m];
        if (other < 0)
            continue;
        const int a = ends[2 * other], b = ends[2 * other + 1];
        masks here = boxed & (number < other);
        here &= (first != a) & (first != b) & (second != a) & (second != b);
        if (!any(here))
            continue;
        const wp::vec3 q = place.data[a], e = place.data[b] - q;
        const lanes apart = distance(x - q[0], y - q[1], z - q[2], dx, dy, dz, e);
        here &= apart < square;
        if (!any(here))
            continue;
        const wp::vec3 v = rest.data[a], w = rest.data[b] - v;
        lanes room = __builtin_elementwise_sqrt(distance(
            rest_x - v[0], rest_y - v[1], rest_z - v[2], rest_dx, rest_dy, rest_dz, w));
        room = layer == layers.data[a] ? room : (lanes)1.0e3f;
        here &= apart < share * share * room * room;
        for (int k = 0; k < size; ++k)
            if (here[k] && found[k] < slots) {
                const int slot = slots * which[k] + found[k];
                rooms.data[slot] = room[k];
                    due.data[slot] = 0;
                near.data[slots * which[k] + found[k]++] = other;
            }
    }
};
descend(look);
for (int k = 0; k < size; ++k) {
    count.data[which[k]] = found[k];
    soon.data[which[k]] = 0;
}
"""


@wp.func_native(near_code("place.data[((const int*)edges.data)[2 * number]]", _FIND_NEAR_EDGES))
def _find_near_edges(
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    patches: wp.array[LaneInts],
    patch: int,
    sizes: wp.array[int],
    edges: wp.array[wp.vec2i],
    owned: wp.array2d[int],
    rest: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    sweep: wp.array[wp.vec3],
    sweeps: wp.array[wp.vec4],
    layers: wp.array[int],
    margin: float,
    share: float,
    count: wp.array[int],
    near: wp.array2d[int],
    rooms: wp.array2d[float],
    due: wp.array2d[int],
    soon: wp.array[int],
): ...


@wp.kernel
def find_near_edges_in_lanes(
    patches: wp.array[LaneInts],  # edges; empty lanes repeat the first
    sizes: wp.array[int],
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    edges: wp.array[wp.vec2i],
    owned: wp.array2d[int],
    rest: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    sweep: wp.array[wp.vec3],
    sweeps: wp.array[wp.vec4],
    layers: wp.array[int],
    margin: float,
    share: float,
    near: Near,
):
    """As `edge_contact.find_near_edges_one_per_thread`, for the edges of a patch."""
    _find_near_edges(
        tree,
        lower,
        upper,
        patches,
        wp.tid(),
        sizes,
        edges,
        owned,
        rest,
        place,
        sweep,
        sweeps,
        layers,
        margin,
        share,
        near.count,
        near.other,
        near.room_m,
        near.due,
        near.soon,
    )


SLOTS = 4  # triangles that may cover a vertex
FACING = 0.3  # least cosine between the normals of cloth and the body beneath it
COVER_ASIDE = 0.3  # of a triangle's edges, how far past it a vertex may lie

_FIND_COVERS = """
const int slots = covers.shape[1];
int found[8] = {};
lanes up_x, up_y, up_z;
for (int k = 0; k < 8; ++k) {
    const wp::vec3 up = normals.data[vertices.data[which[k]]];
    up_x[k] = up[0];
    up_y[k] = up[1];
    up_z[k] = up[2];
}
auto note = [&](int number, masks here) {
    const int* corners = (const int*)triangles.data + 3 * number;
    const wp::vec3 a = place.data[corners[0]];
    const wp::vec3 b = place.data[corners[1]] - a;
    const wp::vec3 c = place.data[corners[2]] - a;
    const wp::vec3 normal = wp::cross(b, c);
    const float square = wp::dot(normal, normal);
    if (!(square > SMALLEST_M4))
        return;
    const lanes slope = up_x * normal[0] + up_y * normal[1] + up_z * normal[2];
    here &= slope >= FACING * wp::sqrt(square);
    if (!any(here))
        return;
    const lanes p = x - a[0], q = y - a[1], r = z - a[2];
    const lanes height = -(p * normal[0] + q * normal[1] + r * normal[2]) / slope;
    here &= (height < margin) & (-height < margin);
    if (!any(here))
        return;
    const wp::vec3 along_u = wp::cross(c, normal), along_v = wp::cross(normal, b);
    const float scale = 1.0f / square;
    const lanes i = p + up_x * height, j = q + up_y * height, k = r + up_z * height;
    const lanes u = (i * along_u[0] + j * along_u[1] + k * along_u[2]) * scale;
    const lanes v = (i * along_v[0] + j * along_v[1] + k * along_v[2]) * scale;
    here &= (u > -COVER_ASIDE) & (v > -COVER_ASIDE) & (u + v < 1.0f + COVER_ASIDE);
    if (!any(here))
        return;
    for (int lane = 0; lane < size; ++lane)
        if (here[lane] && found[lane] < slots)
            covers.data[slots * which[lane] + found[lane]++] = number;
};
auto look = [&](int face) {
    const wp::vec3 first = lower.data[face] - wp::vec3(margin);
    const wp::vec3 last = upper.data[face] + wp::vec3(margin);
    masks here = (x >= first[0]) & (x <= last[0]) & (y >= first[1]) & (y <= last[1]);
    here &= (z >= first[2]) & (z <= last[2]);
    if (any(here))
        for (int k = 0; k < halves; ++k)
            note(halves * face + k, here);
};
descend(look);
for (int k = 0; k < size; ++k)
    count.data[which[k]] = found[k];
"""


@wp.func_native(
    near_code(
        "start.data[vertices.data[number]]",
        _FIND_COVERS,
        SMALLEST_M4=SMALLEST_M4,
        FACING=FACING,
        COVER_ASIDE=COVER_ASIDE,
    )
)
def _find_covers(
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    patches: wp.array[LaneInts],
    patch: int,
    sizes: wp.array[int],
    place: wp.array[wp.vec3],
    triangles: wp.array[wp.vec3i],
    halves: int,
    vertices: wp.array[int],
    start: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    margin: float,
    count: wp.array[int],
    covers: wp.array2d[int],
): ...


@wp.kernel
def find_covers_in_lanes(
    patches: wp.array[LaneInts],  # of the `vertices`; empty lanes repeat the first
    sizes: wp.array[int],
    tree: wp.uint64,
    lower: wp.array[wp.vec3],
    upper: wp.array[wp.vec3],
    place: wp.array[wp.vec3],
    triangles: wp.array[wp.vec3i],
    halves: int,
    vertices: wp.array[int],
    start: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    margin: float,
    count: wp.array[int],
    covers: wp.array2d[int],
):
    """As `body_vertices.find_covers_one_per_thread`, for the vertices of a patch."""
    _find_covers(
        tree,
        lower,
        upper,
        patches,
        wp.tid(),
        sizes,
        place,
        triangles,
        halves,
        vertices,
        start,
        normals,
        margin,
        count,
        covers,
    )


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
const loose_lanes* number = (const loose_lanes*)numbers.data + 6 * row;
loose_lanes* pulled = (loose_lanes*)pull.data + row;
loose_lanes* last = (loose_lanes*)lengths.data + row;
lanes a, b, c, d, e, f, mass, other_mass;
take(one, a, b, c, mass);
take(two, d, e, f, other_mass);
const lanes x = a - d, y = b - e, z = c - f;
const lanes length = __builtin_elementwise_sqrt(x * x + y * y + z * z) + SHORTEST_M;
lanes push = number[0] - length;
const masks loose = begins ? push > 0.0f : (push > 0.0f) & (*pulled >= 0.0f);
push -= number[5] * (length - *last);
if (!begins)
    push -= (loose ? number[3] : number[1]) * *pulled;
push *= share * (loose ? number[4] : number[2]);
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
    ends: wp.array2d[LaneInts],
    numbers: wp.array2d[LaneFloats],
    row: int,
    begins: int,
    finishes: int,
    share: float,
    pull: wp.array[LaneFloats],
    lengths: wp.array[LaneFloats],
    weighed: wp.array[wp.vec4],
): ...


@wp.func_native(lane_code(_GATHER + _TURN, SMALLEST_M2=SMALLEST_M2, FLIPPED_M2=FLIPPED_M2))
def _turn(
    corners: wp.array2d[LaneInts],
    weights: wp.array2d[LaneFloats],
    numbers: wp.array2d[LaneFloats],
    row: int,
    turned: wp.array[LaneFloats],
    weighed: wp.array[wp.vec4],
): ...


@wp.kernel
def pull_springs_in_lanes(
    ends: wp.array2d[LaneInts],
    numbers: wp.array2d[LaneFloats],
    first: int,  # row
    begins: int,
    finishes: int,
    share: float,
    pull: wp.array[LaneFloats],
    lengths: wp.array[LaneFloats],
    weighed: wp.array[wp.vec4],
):
    """As `elasticity.pull_springs`, for those of a row; an empty lane repeats a full one."""
    row = first + wp.tid()
    _pull(ends, numbers, row, begins, finishes, share, pull, lengths, weighed)


@wp.kernel
def turn_hinges_in_lanes(
    corners: wp.array2d[LaneInts],
    weights: wp.array2d[LaneFloats],
    numbers: wp.array2d[LaneFloats],
    first: int,  # row
    turned: wp.array[LaneFloats],
    weighed: wp.array[wp.vec4],
):
    """As `elasticity.turn_hinges`, for those of a row; an empty lane repeats a full one."""
    _turn(corners, weights, numbers, first + wp.tid(), turned, weighed)
