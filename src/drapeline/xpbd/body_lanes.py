"""The body's nearest points on a processor, for `LANES` vertices at once that lie together."""

import warp as wp

from drapeline.geometry.closest_lanes import closest_in_lanes
from drapeline.geometry.lanes import INDICES
from drapeline.geometry.ray_lanes import hits_in_lanes

wp.set_module_options({"enable_backward": False})


@wp.kernel
def search_in_lanes(
    meshes: wp.array(dtype=wp.uint64),
    homes: wp.array(dtype=int),
    patches: wp.array(dtype=INDICES),  # of vertices that have the same home
    place: wp.array(dtype=wp.vec3),
    reach: float,
    reaches: wp.array(dtype=float),
    again: wp.array(dtype=float),
    parts: wp.array(dtype=int),
    found: wp.array(dtype=int),
    found_weights: wp.array(dtype=wp.vec3),
):
    """As `body_contact.search_in_turn`, for the vertices of a patch."""
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
    patches: wp.array(dtype=INDICES),
    starts: wp.array(dtype=wp.vec3),
    ways: wp.array(dtype=wp.vec3),
    reaches: wp.array(dtype=float),
    facing: wp.array(dtype=int),
    facing_weights: wp.array(dtype=wp.vec3),
):
    """As `body_contact.look_in_turn`, for the rays of a patch."""
    hits_in_lanes(whole, patches, wp.tid(), starts, ways, reaches, facing, facing_weights)
