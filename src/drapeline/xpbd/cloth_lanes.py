"""Cloth near cloth on a processor, for `LANES` vertices at once that lie together."""

import warp as wp

from drapeline.geometry.lanes import INDICES, NUMBERS, near_code

wp.set_module_options({"enable_backward": False})

SMALLEST_M4 = 1e-14  # square of a triangle's doubled area, below which it has no sides
ASIDE = 0.4  # of a triangle's edges, how far past it a vertex may lie

# Faces whose boxes meet the patch's are looked at in all lanes; what is near is noted lane by lane.
_FIND = """
const loose_lanes* at_rest = (const loose_lanes*)rest.data + 3 * patch;
const lanes rest_x = at_rest[0], rest_y = at_rest[1], rest_z = at_rest[2];
const int layer = layers.data[which[0]];
const int slots = near.shape[1];
int found[8] = {};
auto note = [&](int number, masks here) {
    const int* corners = (const int*)triangles.data + 3 * number;
    const wp::vec3 a = place.data[corners[0]];
    const wp::vec3 b = place.data[corners[1]] - a;
    const wp::vec3 c = place.data[corners[2]] - a;
    const wp::vec3 normal = wp::cross(b, c);
    const float square = wp::dot(normal, normal);
    if (!(square > SMALLEST_M4))
        return;
    const lanes p = x - a[0], q = y - a[1], r = z - a[2];
    const lanes height = p * normal[0] + q * normal[1] + r * normal[2];
    here &= height * height < margin * margin * square;
    if (!any(here))
        return;
    const float bb = wp::dot(b, b), cc = wp::dot(c, c), bc = wp::dot(b, c);
    const lanes pb = p * b[0] + q * b[1] + r * b[2];
    const lanes pc = p * c[0] + q * c[1] + r * c[2];
    const float scale = 1.0f / square;
    const lanes u = (cc * pb - bc * pc) * scale, v = (bb * pc - bc * pb) * scale;
    here &= (u > -ASIDE) & (v > -ASIDE) & (u + v < 1.0f + ASIDE);
    if (!any(here))
        return;
    for (int k = 0; k < size; ++k)
        if (here[k] && found[k] < slots)
            near.data[slots * which[k] + found[k]++] = height[k] < 0.0f ? -number - 1 : number + 1;
};
auto look = [&](int face) {
    const wp::vec3 start = lower.data[face] - wp::vec3(margin);
    const wp::vec3 end = upper.data[face] + wp::vec3(margin);
    masks here = (x > start[0]) & (x < end[0]) & (y > start[1]) & (y < end[1]);
    here &= (z > start[2]) & (z < end[2]);
    const int* corners = (const int*)triangles.data + 3 * halves * face;
    if (layers.data[corners[0]] == layer) {
        // Parts of a garment that are close at rest are held apart by the cloth itself; a face's
        // own corners always are, however large it is.
        const wp::vec3 centre = rest_centres.data[face];
        const float radius = rest_radii.data[face], held = free > radius ? free : radius;
        const lanes u = rest_x - centre[0], v = rest_y - centre[1], w = rest_z - centre[2];
        here &= u * u + v * v + w * w > held * held;
    }
    if (any(here))
        for (int k = 0; k < halves; ++k)
            note(halves * face + k, here);
};
descend(look);
for (int k = 0; k < size; ++k)
    count.data[which[k]] = found[k];
"""


@wp.func_native(near_code("place.data[number]", _FIND, SMALLEST_M4=SMALLEST_M4, ASIDE=ASIDE))
def _find(
    tree: wp.uint64,
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    patches: wp.array(dtype=INDICES),
    patch: int,
    sizes: wp.array(dtype=int),
    rest: wp.array2d(dtype=NUMBERS),
    rest_centres: wp.array(dtype=wp.vec3),
    rest_radii: wp.array(dtype=float),
    place: wp.array(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    halves: int,
    layers: wp.array(dtype=int),
    margin: float,
    free: float,
    count: wp.array(dtype=int),
    near: wp.array2d(dtype=int),
): ...


@wp.kernel
def find_near_in_lanes(
    patches: wp.array(dtype=INDICES),  # vertices of a garment; empty lanes repeat the first
    sizes: wp.array(dtype=int),
    rest: wp.array2d(dtype=NUMBERS),
    tree: wp.uint64,
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    rest_centres: wp.array(dtype=wp.vec3),
    rest_radii: wp.array(dtype=float),
    place: wp.array(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    halves: int,
    layers: wp.array(dtype=int),
    margin: float,
    free: float,
    count: wp.array(dtype=int),
    near: wp.array2d(dtype=int),
):
    """As `cloth_contact.find_near_in_turn`, for the vertices of a patch."""
    _find(
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
        triangles,
        halves,
        layers,
        margin,
        free,
        count,
        near,
    )
