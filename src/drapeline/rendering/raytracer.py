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

BACKDROP = 1.0  # sRGB grey: white like the page that pictures stand on
FLOOR_REACH_M = 1.6  # shadows fade out at this distance from where they are darkest


@dataclass(frozen=True)
class Texture:
    """A picture on a mesh."""

    picture: np.ndarray  # (H, W, 3) uint8 sRGB, the highest row first
    uv: np.ndarray  # (T, 2), (0, 0) at the picture's lower left, (1, 1) at its upper right
    uv_faces: np.ndarray  # (F, 3) or (F, 4) rows of `uv`, as the mesh's faces


@dataclass(frozen=True)
class ColouredMesh:
    """A mesh in one colour, or with a picture on it."""

    vertices: np.ndarray  # (V, 3) world, metres
    faces: np.ndarray  # (F, 3) or (F, 4)
    colour: Sequence[float] | np.ndarray  # (3,) sRGB in 0-1
    gloss: float = 0.0  # strength of the highlight, 0 for none
    texture: Texture | None = None


# What a pixel shows, in `_Pixels.kind`: nothing, the floor, or a mesh.
_BACKDROP, _FLOOR, _MESH = wp.constant(0), wp.constant(1), wp.constant(2)
# Pixels of a tile share the samples of the light out among them, and `_blend` brings them together
# (Keller and Heidrich, "Interleaved sampling", 2001).
_TILE = wp.constant(5)
_FILTER = wp.constant(1.3)  # width of the box over which edges are averaged, in pixels
_LONE_SAMPLES = wp.constant(4)  # of the light on what is too thin for any pixel's middle
# On the floor, the lamp's shadows of what is farther away are not seen, nor the sky's.
_SHADOW_M, _CONTACT_M = wp.constant(1.7), wp.constant(0.5)


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
    height: int
    # Image coordinates between which the meshes lie.
    first_x: float
    first_y: float
    last_x: float
    last_y: float
    floor_x: float
    floor_y: float
    floor_reach: float
    # Corners of the part of the floor that can lie in shadow.
    first_floor: wp.vec3
    last_floor: wp.vec3
    samples: int
    edge_samples: int


@wp.struct
class _Surfaces:
    mesh: wp.uint64
    normals: wp.array[wp.vec3]
    colours: wp.array[wp.vec3]
    gloss: wp.array[float]
    # Of each face: number of its picture's first pixel, or -1; width and height of the picture.
    picture: wp.array[wp.vec3i]
    uv: wp.array[wp.vec2]  # of each face's corners, in pixels
    pixels: wp.array[wp.vec3]


@wp.struct
class _Spot:
    """End of a ray through the picture."""

    kind: int
    face: int
    place: wp.vec3
    normal: wp.vec3
    flat: wp.vec3
    rounded: wp.vec3
    u: float
    v: float


@wp.struct
class _Pixels:
    """Spots that the middles of pixels show."""

    kind: wp.array[int]
    face: wp.array[int]
    place: wp.array[wp.vec3]
    normal: wp.array[wp.vec3]
    where: wp.array[wp.vec2]  # in the face


@wp.func
def _spread(index: int):
    """The sequence R2, which fills the unit square evenly (Roberts 2018)."""
    return wp.frac(0.5 + 0.7548777 * float(index)), wp.frac(0.5 + 0.5698403 * float(index))


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
def _above(place: wp.vec3, corner: wp.vec3, normal: wp.vec3) -> wp.vec3:
    """The place, or its projection on the tangent plane of a corner that it is below."""
    return place - wp.min(0.0, wp.dot(place - corner, normal)) * normal


@wp.func
def _ray(view: _View, x: float, y: float) -> wp.vec3:
    return wp.normalize(
        view.forward
        + view.right * ((x - view.centre_x) / view.focal)
        + view.down * ((y - view.centre_y) / view.focal)
    )


@wp.func
def _look(surfaces: _Surfaces, view: _View, x: float, y: float) -> _Spot:
    """The spot at image coordinates."""
    ray = _ray(view, x, y)
    spot = _Spot()
    if x > view.first_x and x < view.last_x and y > view.first_y and y < view.last_y:
        hit = wp.mesh_query_ray(surfaces.mesh, view.position, ray, 1.0e3)
        if hit.result:
            corners = wp.mesh_get(surfaces.mesh).indices
            points = wp.mesh_get(surfaces.mesh).points
            a = corners[3 * hit.face]
            b = corners[3 * hit.face + 1]
            c = corners[3 * hit.face + 2]
            w = 1.0 - hit.u - hit.v
            normal = wp.normalize(
                hit.u * surfaces.normals[a] + hit.v * surfaces.normals[b] + w * surfaces.normals[c]
            )
            flat = hit.normal
            if wp.dot(flat, ray) > 0.0:
                flat = -flat
            side = 1.0
            if wp.dot(normal, flat) < 0.0:
                side = -1.0
            place = view.position + hit.t * ray
            spot.kind = _MESH
            spot.face = hit.face
            spot.place = place
            spot.normal = side * normal
            spot.flat = flat
            spot.u = hit.u
            spot.v = hit.v
            # Facets would shade one another where light grazes (Hanika 2021).
            spot.rounded = (
                hit.u * _above(place, points[a], side * surfaces.normals[a])
                + hit.v * _above(place, points[b], side * surfaces.normals[b])
                + w * _above(place, points[c], side * surfaces.normals[c])
            )
            return spot
    if ray[2] < 0.0:
        place = view.position - view.position[2] / ray[2] * ray
        away = wp.vec3(place[0] - view.floor_x, place[1] - view.floor_y, 0.0)
        if (
            wp.length(away) < view.floor_reach
            and place[0] > view.first_floor[0]
            and place[0] < view.last_floor[0]
            and place[1] > view.first_floor[1]
            and place[1] < view.last_floor[1]
        ):
            spot.kind = _FLOOR
            spot.place = place
            spot.normal = wp.vec3(0.0, 0.0, 1.0)
    return spot


@wp.func
def _gather(surfaces: _Surfaces, view: _View, spot: _Spot, u: float, v: float) -> wp.vec4:
    """One sample of the light at a spot: RGB from around, and what comes through of the lamp's.

    Of the floor: how near things are above it, and how much of the lamp's light they take.
    """
    # The lamp is a disc seen 12 degrees wide: its rim gives the shadows their soft edge.
    to_lamp = _tilt(view.light, 1.0 - 0.0055 * u, 6.2831853 * v)
    up = _tilt(spot.normal, wp.sqrt(1.0 - u), 6.2831853 * wp.frac(v + 0.5))
    if spot.kind == _FLOOR:
        # Shadows are palest where what casts them is far up, like those of a large lamp.
        shadow = wp.mesh_query_ray(surfaces.mesh, spot.place, to_lamp, _SHADOW_M)
        lamp = float(0.0)
        if shadow.result:
            lamp = 1.0 - shadow.t / _SHADOW_M
        above = wp.mesh_query_ray(surfaces.mesh, spot.place, up, _CONTACT_M)
        near = float(0.0)
        if above.result:
            near = 1.0 - above.t / _CONTACT_M
        return wp.vec4(near, near, near, lamp)
    lamp = float(0.0)
    if wp.dot(spot.normal, view.light) > -0.1:  # noqa: SIM102  (Warp would cast the ray anyway)
        if not wp.mesh_query_ray_anyhit(
            surfaces.mesh, spot.rounded + 2.0e-3 * spot.normal, to_lamp, 10.0
        ):
            lamp = 1.0
    fill = _sky(up)
    if wp.dot(spot.flat, up) > 0.0:
        beside = wp.mesh_query_ray(surfaces.mesh, spot.place + 2.0e-3 * spot.flat, up, 3.0)
        if beside.result:
            fill = 0.35 * surfaces.colours[beside.face]
        elif up[2] < 0.0:
            fill = fill * 0.75
    else:
        fill = fill * 0.5
    return wp.vec4(fill[0], fill[1], fill[2], lamp)


@wp.func
def _floor_share(view: _View, place: wp.vec3, x: float, y: float) -> float:
    """Share that is left of shadows on the floor: none far away and at the picture's borders."""
    away = wp.length(wp.vec3(place[0] - view.floor_x, place[1] - view.floor_y, 0.0))
    border = wp.min(wp.min(x, float(view.width) - x), wp.min(y, float(view.height) - y)) / float(
        wp.min(view.width, view.height)
    )
    near = 1.0 - wp.smoothstep(0.3 * view.floor_reach, view.floor_reach, away)
    return near * wp.smoothstep(0.0, 0.1, border)


@wp.func
def _paint(
    surfaces: _Surfaces,
    view: _View,
    spot: _Spot,
    x: float,
    y: float,
    light: wp.vec4,
    backdrop: wp.vec3,
) -> wp.vec3:
    """Colour of a spot, seen at image coordinates, in its light."""
    if spot.kind == _BACKDROP:
        return backdrop
    if spot.kind == _FLOOR:
        shade = 0.55 * light[3] + 0.35 * light[0]
        return backdrop * (1.0 - shade * _floor_share(view, spot.place, x, y))
    lamp = light[3] * wp.max(0.0, wp.dot(spot.normal, view.light))
    half = wp.normalize(view.light - wp.normalize(spot.place - view.position))
    shine = (
        light[3] * surfaces.gloss[spot.face] * wp.pow(wp.max(0.0, wp.dot(spot.normal, half)), 24.0)
    )
    found = wp.cw_mul(
        _cloth(surfaces, spot),
        0.68 * wp.vec3(light[0], light[1], light[2]) + 0.8 * lamp * wp.vec3(1.0, 0.97, 0.93),
    ) + shine * wp.vec3(1.0, 1.0, 1.0)
    return wp.vec3(_shoulder(found[0]), _shoulder(found[1]), _shoulder(found[2]))


@wp.func
def _cloth(surfaces: _Surfaces, spot: _Spot) -> wp.vec3:
    """The colour of a mesh at a spot."""
    picture = surfaces.picture[spot.face]
    if picture[0] < 0:
        return surfaces.colours[spot.face]
    place = (
        spot.u * surfaces.uv[3 * spot.face]
        + spot.v * surfaces.uv[3 * spot.face + 1]
        + (1.0 - spot.u - spot.v) * surfaces.uv[3 * spot.face + 2]
    )
    width = picture[1]
    height = picture[2]
    x = wp.clamp(place[0] - 0.5, 0.0, float(width - 1))
    y = wp.clamp(place[1] - 0.5, 0.0, float(height - 1))
    column = int(x)
    row = int(y)
    right = wp.min(column + 1, width - 1)
    upper = picture[0] + row * width
    lower = picture[0] + wp.min(row + 1, height - 1) * width
    aside = x - float(column)
    return wp.lerp(
        wp.lerp(surfaces.pixels[upper + column], surfaces.pixels[upper + right], aside),
        wp.lerp(surfaces.pixels[lower + column], surfaces.pixels[lower + right], aside),
        y - float(row),
    )


@wp.func
def _shoulder(light: float) -> float:
    """Bright light, bent to stay below white, so that white cloth keeps its folds."""
    if light < 0.5:
        return light
    return 0.5 + 0.42 * (1.0 - wp.exp((0.5 - light) / 0.42))


@wp.func
def _alike(place: wp.vec3, normal: wp.vec3, other: wp.vec3, its_normal: wp.vec3) -> bool:
    """Whether two spots are of one smooth surface, where the light hardly differs."""
    way = other - place
    far = wp.length(way)
    return (
        wp.dot(normal, its_normal) > 0.8
        and wp.abs(wp.dot(normal, way)) + wp.abs(wp.dot(its_normal, way)) < 0.002 + 0.7 * far
    )


@wp.kernel
def _expose(surfaces: _Surfaces, view: _View, pixels: _Pixels, light: wp.array[wp.vec4]):
    """See what each pixel's middle shows, and sample the light there."""
    pixel = wp.tid()
    column = pixel % view.width
    row = pixel / view.width
    spot = _look(surfaces, view, float(column) + 0.5, float(row) + 0.5)
    pixels.kind[pixel] = spot.kind
    pixels.face[pixel] = spot.face
    pixels.place[pixel] = spot.place
    pixels.normal[pixel] = spot.normal
    pixels.where[pixel] = wp.vec2(spot.u, spot.v)
    if spot.kind == _BACKDROP:
        return
    # Neighbours differ as much as possible in their place of the sequence.
    first = _TILE * ((2 * column + row) % _TILE) + (column + 2 * row) % _TILE
    total = wp.vec4(0.0, 0.0, 0.0, 0.0)
    for sample in range(view.samples):
        u, v = _spread(first + _TILE * _TILE * sample)
        total += _gather(surfaces, view, spot, u, v)
    light[pixel] = total / float(view.samples)


@wp.kernel
def _blend(
    view: _View,
    pixels: _Pixels,
    step: int,
    light: wp.array[wp.vec4],
    blended: wp.array[wp.vec4],
):
    """Average the light over the tile around each pixel, on its own surface."""
    pixel = wp.tid()
    kind = pixels.kind[pixel]
    if kind == _BACKDROP:
        return
    column = pixel % view.width
    row = pixel / view.width
    place = pixels.place[pixel]
    normal = pixels.normal[pixel]
    total = wp.vec4(0.0, 0.0, 0.0, 0.0)
    count = float(0.0)
    for down in range(-2, 3):
        for aside in range(-2, 3):
            y = row + step * down
            x = column + step * aside
            other = y * view.width + x
            if (
                x >= 0
                and x < view.width
                and y >= 0
                and y < view.height
                and pixels.kind[other] == kind
                and _alike(place, normal, pixels.place[other], pixels.normal[other])
            ):
                total += light[other]
                count += 1.0
    blended[pixel] = total / count


@wp.kernel
def _develop(
    surfaces: _Surfaces,
    view: _View,
    pixels: _Pixels,
    light: wp.array[wp.vec4],
    backdrop: wp.vec3,
    image: wp.array[wp.vec3],
):
    """Colour each pixel: with one sample where it shows one surface, with many at edges."""
    pixel = wp.tid()
    column = pixel % view.width
    row = pixel / view.width
    kind = pixels.kind[pixel]
    first_x = wp.max(column - 1, 0)
    last_x = wp.min(column + 2, view.width)
    first_y = wp.max(row - 1, 0)
    last_y = wp.min(row + 2, view.height)
    edge = int(0)  # a plain 0 would be a constant, which Warp does not let loops change
    for j in range(first_y, last_y):
        for i in range(first_x, last_x):
            other = j * view.width + i
            if pixels.kind[other] != kind:
                if kind == _MESH or pixels.kind[other] == _MESH:
                    edge = 1
            elif kind == _MESH and not _alike(
                pixels.place[pixel], pixels.normal[pixel], pixels.place[other], pixels.normal[other]
            ):
                edge = 1
    if edge == 0:
        spot = _Spot()
        spot.kind = kind
        spot.face = pixels.face[pixel]
        spot.place = pixels.place[pixel]
        spot.normal = pixels.normal[pixel]
        spot.u = pixels.where[pixel][0]
        spot.v = pixels.where[pixel][1]
        x = float(column) + 0.5
        y = float(row) + 0.5
        image[pixel] = _paint(surfaces, view, spot, x, y, light[pixel], backdrop)
        return
    total = wp.vec3(0.0, 0.0, 0.0)
    for sample in range(view.edge_samples):
        u, v = _spread(sample)
        x = float(column) + 0.5 + _FILTER * (u - 0.5)
        y = float(row) + 0.5 + _FILTER * (v - 0.5)
        spot = _look(surfaces, view, x, y)
        here = wp.vec4(0.0, 0.0, 0.0, 0.0)
        if spot.kind != _BACKDROP:
            # The light of the neighbours that show the same surface; of the spot if none does.
            found = float(0.0)
            for j in range(first_y, last_y):
                for i in range(first_x, last_x):
                    other = j * view.width + i
                    if pixels.kind[other] == spot.kind and _alike(
                        spot.place, spot.normal, pixels.place[other], pixels.normal[other]
                    ):
                        here += light[other]
                        found += 1.0
            if found == 0.0:
                for _ in range(_LONE_SAMPLES):
                    u, v = _spread(_LONE_SAMPLES * (sample + pixel) + int(found))
                    here += _gather(surfaces, view, spot, u, v)
                    found += 1.0
            here = here / found
        total += _paint(surfaces, view, spot, x, y, here, backdrop)
    image[pixel] = total / float(view.edge_samples)


_DEVICE = "cpu"
_RAY_SHARE: ContextVar[float] = ContextVar("ray share", default=1.0)


@contextmanager
def ray_share(share: float) -> Iterator[None]:
    """Multiply the rays per pixel of all pictures: below 1 they are faster and coarser."""
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
    floor_reach_m: float = FLOOR_REACH_M,
    samples: int = 16,
) -> np.ndarray:
    """(H, W, 3) uint8 sRGB of meshes that stand on the floor z = 0; equal inputs, equal pictures.

    Args:
        parts: the meshes.
        floor_centre: (x, y) where shadows are darkest; they fade out with the distance from it, and
            towards the picture's borders.
        floor_reach_m: from where on there are no shadows.
        samples: at edges, per pixel, before `ray_share`; an eighth as many for the light, which
            neighbouring pixels share. A block of pixels is one colour where its pixels have less
            than a sample each.
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
    surfaces = _Surfaces()
    mesh = warp_mesh(vertices, corners)
    surfaces.mesh = mesh.id
    surfaces.normals = _array(normals, wp.vec3)
    surfaces.colours = _array(np.repeat(linear, counts, axis=0), wp.vec3)
    surfaces.gloss = _array(np.repeat([p.gloss for p in parts], counts), float)
    rays = _RAY_SHARE.get() * samples
    block = max(1, round(rays**-0.5))
    size, camera = (camera.height, camera.width), camera.reduced(block)
    _lay_pictures(surfaces, parts, counts, camera)
    view = _view(camera, vertices, (*floor_centre, floor_reach_m), rays)
    count = camera.width * camera.height
    pixels = _Pixels()
    pixels.kind, pixels.face = (wp.zeros(count, dtype=int, device=_DEVICE) for _ in range(2))
    pixels.place, pixels.normal = (wp.zeros(count, dtype=wp.vec3, device=_DEVICE) for _ in range(2))
    pixels.where = wp.zeros(count, dtype=wp.vec2, device=_DEVICE)
    light, blended = (wp.zeros(count, dtype=wp.vec4, device=_DEVICE) for _ in range(2))
    image = wp.zeros(count, dtype=wp.vec3, device=_DEVICE)
    wall = wp.vec3(*[float(_to_linear(np.array(BACKDROP)))] * 3)
    for kernel, inputs in (
        (_expose, [surfaces, view, pixels, light]),
        (_blend, [view, pixels, 1, light, blended]),
        (_blend, [view, pixels, 2, blended, light]),
        (_develop, [surfaces, view, pixels, light, wall, image]),
    ):
        wp.launch(kernel, dim=count, inputs=inputs, device=_DEVICE)
    picture = _to_srgb(image.numpy().reshape(camera.height, camera.width, 3))
    return picture.repeat(block, axis=0).repeat(block, axis=1)[: size[0], : size[1]]


def _lay_pictures(
    surfaces: _Surfaces, parts: Sequence[ColouredMesh], counts: Sequence[int], camera: Camera
) -> None:
    """Put pictures on meshes, as coarse as the camera sees them: finer ones would flicker."""
    first = 0
    pictures, places = np.full((sum(counts), 3), -1), np.zeros((sum(counts), 3, 2))
    pixels = [np.zeros((1, 3))]
    starts = np.cumsum([0, *counts])
    for part, start, count in zip(parts, starts[:-1], counts, strict=True):
        if part.texture is None:
            continue
        picture = _seen_from(part, part.texture, camera)
        height, width = picture.shape[:2]
        corners = part.texture.uv[triangulate(np.asarray(part.texture.uv_faces))]
        places[start : start + count] = (corners * [1, -1] + [0, 1]) * [width, height]
        pictures[start : start + count] = (first + 1, width, height)
        pixels.append(_to_linear(picture.reshape(-1, 3) / 255))
        first += height * width
    surfaces.picture = wp.array(pictures.astype(np.int32), dtype=wp.vec3i, device=_DEVICE)
    surfaces.uv = _array(places.reshape(-1, 2), wp.vec2)
    surfaces.pixels = _array(np.concatenate(pixels), wp.vec3)


def _seen_from(part: ColouredMesh, texture: Texture, camera: Camera) -> np.ndarray:
    """A picture with about as many pixels on the mesh as the camera has."""
    corners = part.vertices[triangulate(np.asarray(part.faces))][:, :2]
    image, _ = camera.project(np.asarray(corners, np.float64))
    places = texture.uv[triangulate(np.asarray(texture.uv_faces))][:, :2] * texture.picture.shape[0]
    seen, laid = (np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) for ends in (image, places))
    picture = texture.picture.astype(np.float32)
    # Cloth that is seen aslant is as short as a tenth; most is not.
    factor = int(np.median(laid) / max(np.quantile(seen, 0.75), 1e-3))
    factor = max(1, min(factor, min(picture.shape[:2]) // 4))
    height, width = (side // factor * factor for side in picture.shape[:2])
    blocks = picture[:height, :width].reshape(height // factor, factor, width // factor, factor, 3)
    return blocks.mean(axis=(1, 3))


def _array(values: np.ndarray, dtype: type) -> wp.array:
    return wp.array(values.astype(np.float32), dtype=dtype, device=_DEVICE)


def _view(camera: Camera, vertices: np.ndarray, floor: Sequence[float], rays: float) -> _View:
    right, _down, forward = camera.axes
    level = np.array([forward[0], forward[1], 0.0])
    level /= np.linalg.norm(level)
    aside = np.array([right[0], right[1], 0.0])
    light = -0.55 * level - 0.5 * aside + np.array([0.0, 0.0, 1.15])
    light /= np.linalg.norm(light)
    view = _View()
    view.position = wp.vec3(*camera.position)
    view.right, view.down, view.forward = (wp.vec3(*axis) for axis in camera.axes)
    view.light = wp.vec3(*light)
    view.focal = float(camera.intrinsics[0, 0])
    view.centre_x, view.centre_y = map(float, camera.intrinsics[:2, 2])
    view.width, view.height = camera.width, camera.height
    seen, depth = camera.project(vertices)
    if (depth > 0).all():
        view.first_x, view.first_y = map(float, seen.min(axis=0))
        view.last_x, view.last_y = map(float, seen.max(axis=0))
    else:
        view.last_x, view.last_y = float(camera.width), float(camera.height)
    view.floor_x, view.floor_y, view.floor_reach = map(float, floor)
    low = vertices[vertices[:, 2] < _SHADOW_M]
    if len(low):
        shadow = np.concatenate([low, low - low[:, 2:] / float(light[2]) * light])
        view.first_floor = wp.vec3(*(shadow.min(axis=0) - _CONTACT_M))
        view.last_floor = wp.vec3(*(shadow.max(axis=0) + _CONTACT_M))
    view.samples, view.edge_samples = max(1, round(rays / 8)), max(1, round(rays))
    return view


def _to_linear(colour: np.ndarray) -> np.ndarray:
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)


def _to_srgb(light: np.ndarray) -> np.ndarray:
    light = np.clip(light, 0.0, 1.0)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(255 * curve).astype(np.uint8)
