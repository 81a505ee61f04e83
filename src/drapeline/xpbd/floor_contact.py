"""Cloth against the floor."""

import warp as wp

from drapeline.xpbd.contact import pushed_out

wp.set_module_options({"enable_backward": False})


@wp.kernel
def touch_floor(
    height: wp.array(dtype=wp.vec2),  # at both ends of the frame
    clock: wp.array(dtype=float),
    carry: wp.array(dtype=wp.vec3),
    gap: float,
    release: float,
    stick: float,
    friction: wp.array(dtype=float),
    before: wp.array(dtype=wp.vec3),
    place: wp.array(dtype=wp.vec3),
):
    """Keep vertices above the floor."""
    i = wp.tid()
    rise = height[0][1] - height[0][0]
    start = height[0][0] + rise * clock[0] + gap
    end = height[0][0] + rise * clock[1] + gap
    p = place[i]
    o = before[i]
    depth = end - p[2]
    if depth > 0.0:
        old = wp.clamp(start + carry[0][2] - o[2], 0.0, depth)
        way = wp.vec3(0.0, 0.0, end - start) - carry[0]
        up = wp.vec3(0.0, 0.0, 1.0)
        out, then = pushed_out(p, o, way, up, depth, old, release, friction[0], stick)
        place[i] = out
        before[i] = then
