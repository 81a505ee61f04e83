"""A small ray tracer in Warp, with the light of a photographer's studio and a white floor.

A still takes about a second on one core, so every sample of a dataset can have a picture and an
animation.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np
import warp as wp

from drapeline.geometry.mesh import triangulate, vertex_normals
from drapeline.geometry.warp_mesh import warp_mesh
from drapeline.rendering.camera import Camera


@dataclass(frozen=True)
class ColouredMesh:
    """A mesh in one colour.

    Attributes:
        vertices: (V, 3) world, metres.
        faces: (F, 3) or (F, 4).
        colour: sRGB in 0-1.
        gloss: strength of the highlight, 0 for none.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colour: Sequence[float]
    gloss: float = 0.0


@wp.struct
class _View:
    position: wp.vec3
    right: wp.vec3
    down: wp.vec3
    forward: wp.vec3
    light: wp.vec3
    focal: float
    centre_x: float
    centre_y: float
    width: int
    floor_x: float
    floor_y: float
    floor_radius: float
    samples: int


@wp.func
def _sky(direction: wp.vec3) -> wp.vec3:
    """Light from a bright ceiling and white walls."""
    return wp.lerp(wp.vec3(0.78, 0.79, 0.82), wp.vec3(1.0, 1.0, 1.0), 0.5 + 0.5 * direction[2])


@wp.func
def _tilt(axis: wp.vec3, cosine: float, turn: float) -> wp.vec3:
    """A direction at an angle to the axis, given by its cosine, turned about it by `turn` rad."""
    side = wp.vec3(1.0, 0.0, 0.0)
    if wp.abs(axis[0]) > 0.7:
        side = wp.vec3(0.0, 1.0, 0.0)
    across = wp.normalize(wp.cross(axis, side))
    along = wp.cross(axis, across)
    sine = wp.sqrt(wp.max(0.0, 1.0 - cosine * cosine))
    return cosine * axis + sine * (wp.cos(turn) * across + wp.sin(turn) * along)


@wp.func
def _incoming_light(
    mesh: wp.uint64,
    colours: wp.array(dtype=wp.vec3),
    place: wp.vec3,
    rounded: wp.vec3,
    normal: wp.vec3,
    flat: wp.vec3,
    light: wp.vec3,
    u: float,
    v: float,
) -> wp.vec4:
    """Incoming light: RGB from the surroundings and the light's share in the fourth number.

    The lamp's rays start at `rounded`, where the place would be on a smooth surface.
    """
    start = place + 2.0e-3 * flat
    # The lamp is a disc seen 12 degrees wide: its rim gives the shadows their soft edge.
    to_lamp = _tilt(light, 1.0 - 0.0055 * u, 6.2831853 * v)
    lamp = wp.max(0.0, wp.dot(normal, to_lamp))
    if lamp > 0.0:  # noqa: SIM102  (Warp would cast the ray for any lamp)
        if wp.mesh_query_ray_anyhit(mesh, rounded + 2.0e-3 * normal, to_lamp, 10.0):
            lamp = 0.0
    up = _tilt(normal, wp.sqrt(1.0 - u), 6.2831853 * wp.frac(v + 0.5))
    fill = _sky(up)
    if wp.dot(flat, up) > 0.0:
        near = wp.mesh_query_ray(mesh, start, up, 3.0)
        if near.result:
            fill = 0.35 * colours[near.face]
        elif up[2] < 0.0:
            fill = fill * 0.75
    else:
        fill = fill * 0.5
    return wp.vec4(fill[0], fill[1], fill[2], lamp)


@wp.func
def _above(place: wp.vec3, corner: wp.vec3, normal: wp.vec3) -> wp.vec3:
    """The place, or its projection on the tangent plane of a corner that it is below."""
    return place - wp.min(0.0, wp.dot(place - corner, normal)) * normal


@wp.func
def _floor_shade(mesh: wp.uint64, view: _View, place: wp.vec3, u: float, v: float) -> float:
    """How much darker the floor is along one ray: by the lamp's shadow, and by things nearby."""
    away = wp.length(wp.vec3(place[0] - view.floor_x, place[1] - view.floor_y, 0.0))
    if away > view.floor_radius:
        return 0.0
    shade = 0.0
    to_lamp = _tilt(view.light, 1.0 - 0.0055 * u, 6.2831853 * v)
    if wp.mesh_query_ray_anyhit(mesh, place, to_lamp, 10.0):
        shade += 0.38
    up = _tilt(wp.vec3(0.0, 0.0, 1.0), wp.sqrt(1.0 - u), 6.2831853 * wp.frac(v + 0.5))
    near = wp.mesh_query_ray(mesh, place, up, 0.6)
    if near.result:
        shade += 0.3 * (1.0 - near.t / 0.6)
    return shade * wp.min(1.0, 2.0 * (1.0 - away / view.floor_radius))


@wp.kernel
def _expose(
    mesh: wp.uint64,
    normals: wp.array(dtype=wp.vec3),
    colours: wp.array(dtype=wp.vec3),
    gloss: wp.array(dtype=float),
    view: _View,
    backdrop: wp.vec3,
    image: wp.array(dtype=wp.vec3),
):
    pixel = wp.tid()
    column = float(pixel % view.width)
    row = float(pixel / view.width)
    state = wp.rand_init(17, pixel)
    shift_u = wp.randf(state)
    shift_v = wp.randf(state)
    total = wp.vec3(0.0, 0.0, 0.0)
    taken = float(0.0)
    shaded = int(0)  # a plain 0 would be a constant, which Warp does not let loops change
    for sample in range(view.samples):
        # Additive recurrences spread the samples evenly over pixel, lamp and sky.
        k = float(sample)
        x = column + wp.frac(0.5 + 0.8566749 * k)
        y = row + wp.frac(0.5 + 0.7338919 * k)
        u = wp.frac(shift_u + 0.6287067 * k)
        v = wp.frac(shift_v + 0.5385973 * k)
        ray = wp.normalize(
            view.forward
            + view.right * ((x - view.centre_x) / view.focal)
            + view.down * ((y - view.centre_y) / view.focal)
        )
        hit = wp.mesh_query_ray(mesh, view.position, ray, 1.0e3)
        found = backdrop
        if hit.result:
            corners = wp.mesh_get(mesh).indices
            points = wp.mesh_get(mesh).points
            a = corners[3 * hit.face]
            b = corners[3 * hit.face + 1]
            c = corners[3 * hit.face + 2]
            w = 1.0 - hit.u - hit.v
            normal = wp.normalize(hit.u * normals[a] + hit.v * normals[b] + w * normals[c])
            flat = hit.normal
            if wp.dot(flat, ray) > 0.0:
                flat = -flat
            side = 1.0
            if wp.dot(normal, flat) < 0.0:
                side = -1.0
            normal = side * normal
            place = view.position + hit.t * ray
            # Facets would shade one another where light grazes (Hanika 2021).
            rounded = (
                hit.u * _above(place, points[a], side * normals[a])
                + hit.v * _above(place, points[b], side * normals[b])
                + w * _above(place, points[c], side * normals[c])
            )
            light = _incoming_light(mesh, colours, place, rounded, normal, flat, view.light, u, v)
            half = wp.normalize(view.light - ray)
            shine = gloss[hit.face] * wp.pow(wp.max(0.0, wp.dot(normal, half)), 24.0)
            if light[3] <= 0.0:
                shine = 0.0
            found = wp.cw_mul(
                colours[hit.face],
                0.68 * wp.vec3(light[0], light[1], light[2])
                + 0.8 * light[3] * wp.vec3(1.0, 0.97, 0.93),
            ) + shine * wp.vec3(1.0, 1.0, 1.0)
            shaded = 1
        elif ray[2] < 0.0:
            shade = _floor_shade(mesh, view, view.position - view.position[2] / ray[2] * ray, u, v)
            if shade > 0.0:
                found = backdrop * (1.0 - shade)
                shaded = 1
        total += found
        taken += 1.0
        if sample == 5 and shaded == 0:
            break  # plain backdrop: more rays would tell nothing new
    image[pixel] = total / taken


_RAY_SHARE: ContextVar[float] = ContextVar("ray share", default=1.0)


@contextmanager
def ray_share(share: float) -> Iterator[None]:
    """Multiply the rays per pixel of all pictures: below 1 they are faster and grainier."""
    token = _RAY_SHARE.set(share)
    try:
        yield
    finally:
        _RAY_SHARE.reset(token)


def raytrace(
    parts: Sequence[ColouredMesh],
    camera: Camera,
    *,
    floor_centre: Sequence[float] = (0.0, 0.0),
    samples: int = 16,
    backdrop: float = 0.93,
) -> np.ndarray:
    """Render meshes that stand on the floor z = 0; equal inputs give equal pictures.

    Args:
        parts: the meshes.
        camera: takes the picture.
        floor_centre: (x, y) where shadows are darkest; they fade out 2.2 m away from it.
        samples: rays per pixel, before `ray_share`.
        backdrop: sRGB grey of background and unshaded floor.

    Returns:
        (height, width, 3) uint8 sRGB.
    """
    vertices = np.concatenate([p.vertices for p in parts]).astype(np.float32)
    starts = np.cumsum([0, *(len(p.vertices) for p in parts)])
    triangles = [triangulate(np.asarray(p.faces)) for p in parts]
    normals = np.concatenate(
        [vertex_normals(p.vertices, t) for p, t in zip(parts, triangles, strict=True)]
    )
    counts = [len(t) for t in triangles]
    corners = np.concatenate([t + s for t, s in zip(triangles, starts[:-1], strict=True)])
    linear = _to_linear(np.array([p.colour for p in parts], dtype=np.float64))
    device = "cpu"
    mesh = warp_mesh(vertices, corners)
    image = wp.zeros(camera.width * camera.height, dtype=wp.vec3, device=device)
    wp.launch(
        _expose,
        dim=camera.width * camera.height,
        inputs=[
            mesh.id,
            wp.array(normals.astype(np.float32), dtype=wp.vec3, device=device),
            wp.array(
                np.repeat(linear, counts, axis=0).astype(np.float32), dtype=wp.vec3, device=device
            ),
            wp.array(
                np.repeat([p.gloss for p in parts], counts).astype(np.float32),
                dtype=float,
                device=device,
            ),
            _view(camera, floor_centre, max(1, round(_RAY_SHARE.get() * samples))),
            wp.vec3(*[float(_to_linear(np.array(backdrop)))] * 3),
        ],
        outputs=[image],
        device=device,
    )
    return _to_srgb(image.numpy().reshape(camera.height, camera.width, 3))


def _view(camera: Camera, floor_centre: Sequence[float], samples: int) -> _View:
    right, _down, forward = camera.axes
    level = np.array([forward[0], forward[1], 0.0])
    level /= np.linalg.norm(level)
    aside = np.array([right[0], right[1], 0.0])
    light = -0.55 * level - 0.5 * aside + np.array([0.0, 0.0, 1.15])
    view = _View()
    view.position = wp.vec3(*camera.position)
    view.right, view.down, view.forward = (wp.vec3(*axis) for axis in camera.axes)
    view.light = wp.vec3(*(light / np.linalg.norm(light)))
    view.focal = float(camera.intrinsics[0, 0])
    view.centre_x, view.centre_y = map(float, camera.intrinsics[:2, 2])
    view.width = camera.width
    view.floor_x, view.floor_y = map(float, floor_centre)
    view.floor_radius = 2.2
    view.samples = samples
    return view


def _to_linear(colour: np.ndarray) -> np.ndarray:
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)


def _to_srgb(light: np.ndarray) -> np.ndarray:
    light = np.clip(light, 0.0, 1.0)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(255 * curve).astype(np.uint8)
