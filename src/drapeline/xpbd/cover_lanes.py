"""Cloth over the body's vertices on a processor, for `LANES` of them at once that lie together."""

import warp as wp

from drapeline.geometry.lanes import INDICES, near_code

wp.set_module_options({"enable_backward": False})

SLOTS = 4  # triangles that may cover a vertex
FACING = 0.3  # least cosine between the normals of cloth and the body beneath it
ASIDE = 0.3  # of a triangle's edges, how far past it a vertex may lie
SMALLEST_M4 = 1e-14  # square of a triangle's doubled area, below which it has no sides

_FIND = """
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
    here &= (u > -ASIDE) & (v > -ASIDE) & (u + v < 1.0f + ASIDE);
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
        _FIND,
        SMALLEST_M4=SMALLEST_M4,
        FACING=FACING,
        ASIDE=ASIDE,
    )
)
def _find(
    tree: wp.uint64,
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    patches: wp.array(dtype=INDICES),
    patch: int,
    sizes: wp.array(dtype=int),
    place: wp.array(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    halves: int,
    vertices: wp.array(dtype=int),
    start: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    margin: float,
    count: wp.array(dtype=int),
    covers: wp.array2d(dtype=int),
): ...


@wp.kernel
def find_covers_in_lanes(
    patches: wp.array(dtype=INDICES),  # of the `vertices`; empty lanes repeat the first
    sizes: wp.array(dtype=int),
    tree: wp.uint64,
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    place: wp.array(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    halves: int,
    vertices: wp.array(dtype=int),
    start: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    margin: float,
    count: wp.array(dtype=int),
    covers: wp.array2d(dtype=int),
):
    """As `body_vertices.find_covers_in_turn`, for the vertices of a patch."""
    _find(
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
