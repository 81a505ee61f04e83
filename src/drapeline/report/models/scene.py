"""Pictures of dressed bodies: the camera, and garments, clouds and errors before it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from trimesh.creation import icosahedron

from drapeline.dataset.scene_part import BODY_COLOUR
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import BODY_PIXEL, FIRST_GARMENT_PIXEL, UNKNOWN_PIXEL
from drapeline.outfits.garment_types import BODY, GARMENTS, LABELS
from drapeline.rendering.camera import Camera, look_at, view_direction
from drapeline.rendering.pictures import GridCell, heat_parts, save_grid
from drapeline.rendering.raytracer import BACKDROP, ColouredMesh, raytrace
from drapeline.report.colours import garment_colour
from drapeline.rule_log import progress

PICTURE_SIZE = (250, 290)
_DISTANCE_M = 7.0
_TURN_DEG = 24.0
_RISE = 0.12
_MARGIN = 1.12
_FLOOR_SHARE = 0.44  # of a picture's height lies between its middle and the floor
_SURFACE_M2 = 2.2  # of a dressed body, roughly: what a cloud's points are spread over
_POINT_SHARE = 0.37  # radius of a drawn point, of the distance between them
_DEPTH_LEVELS, _HAZE = 6, 0.6  # distant points are drawn paler, so that near ones stand out
HEAT_SPAN_MM = 30.0
_TARGET_HEIGHT_M = 0.95
_UNKNOWN_COLOUR = (0.9, 0.9, 0.6)
_EMPTY = 255  # white, like the background of the others


def draw(meshes: Mapping[str, Mesh], size: tuple[int, int] = PICTURE_SIZE) -> np.ndarray:
    """A picture of somebody in clothes, by the ray tracer that draws the report's.

    Args:
        meshes: garment type, or "Body" -> mesh, metres, Z up; each type has its colour.
        size: width and height of the picture, pixels.

    Returns:
        (height, width, 3) uint8. The floor is at the lowest vertex; empty meshes are left out.

    Raises:
        InputError: a name is of no garment type, or nothing is left to draw.
    """
    for name in meshes:
        if name not in LABELS:
            raise InputError(f"draw: '{name}', expected one of {', '.join(LABELS)}")
    parts = _coloured(meshes)
    if not parts:
        raise InputError("draw: no mesh has a face, expected one or more to draw")
    vertices = [part.vertices for part in parts]
    floor = float(min(part[:, 2].min() for part in vertices))
    return fit_scene(Scene(floor_z=floor), vertices, size).picture(parts, size)


def _coloured(meshes: Mapping[str, Mesh]) -> list[ColouredMesh]:
    """Meshes by label, in the colours of their types; empty ones are left out."""
    return [
        ColouredMesh(
            mesh.vertices, mesh.faces, BODY_COLOUR if name == BODY else garment_colour(name)
        )
        for name, mesh in meshes.items()
        if len(mesh.faces)
    ]


@dataclass(frozen=True)
class Scene:
    """The view of a dressed body that stands, or moves, above the floor."""

    # (3,) middle of the picture, metres above the floor in Z.
    target: tuple[float, float, float] = (0.0, 0.0, 0.9)
    front: tuple[float, float] = (0.0, -1.0)  # (x, y) direction that the wearer faces
    height_m: float = 2.1  # what the height of the picture spans at the target
    floor_z: float = 0.0  # height of the floor in the frame of the meshes
    turn_deg: float = _TURN_DEG  # how far to the side of the front the camera stands

    def camera(self, size: tuple[int, int]) -> Camera:
        """The camera for pictures of a size (width, height)."""
        direction = view_direction(self.front, turn_deg=self.turn_deg, rise=_RISE)
        target = np.array(self.target)
        return look_at(
            target + _DISTANCE_M * direction,
            target,
            focal_px=size[1] * _DISTANCE_M / self.height_m,
            size=size,
        )

    def picture(
        self, parts: Sequence[ColouredMesh], size: tuple[int, int] = PICTURE_SIZE, samples: int = 10
    ) -> np.ndarray:
        """(height, width, 3) uint8 picture of meshes, at a size (width, height)."""
        lift = np.array([0.0, 0.0, -self.floor_z])
        lifted = [replace(part, vertices=part.vertices + lift) for part in parts]
        return raytrace(lifted, self.camera(size), floor_centre=self.target[:2], samples=samples)


def spread_frames(count: int, shown: int) -> list[int]:
    """Indices of at most `shown` of `count` frames, evenly spread."""
    shown = min(shown, count)
    return [round((k + 0.5) * count / shown - 0.5) for k in range(shown)]


def fit_scene(
    scene: Scene, meshes: Sequence[np.ndarray], size: tuple[int, int] = PICTURE_SIZE
) -> Scene:
    """The same view, moved and scaled to hold meshes (V, 3) and the floor below them.

    Args:
        scene: gives the side that the camera stands on, and the floor.
        meshes: in the frame of the floor's height.
        size: of the pictures, (width, height) in pixels.
    """
    points = np.concatenate(meshes) - [0, 0, scene.floor_z]
    right = scene.camera(size).axes[0]
    axes = np.array([right, [-right[1], right[0], 0.0]])  # level: across the picture, into it
    along = points @ axes.T
    x, y, _ = (along.min(axis=0) + along.max(axis=0)) / 2 @ axes
    across, deep = np.ptp(along, axis=0)
    nearer = _DISTANCE_M / (_DISTANCE_M - deep / 2)  # what is near looks larger
    height = _MARGIN * nearer * float(max(points[:, 2].max(), across * size[1] / size[0]))
    return replace(scene, target=(float(x), float(y), _FLOOR_SHARE * height), height_m=height)


def share_scale(scenes: Sequence[Scene]) -> list[Scene]:
    """The same views at the smallest of their scales, with the floor at one height."""
    height = max(scene.height_m for scene in scenes)
    middle_z = _FLOOR_SHARE * height
    return [
        replace(scene, height_m=height, target=(*scene.target[:2], middle_z)) for scene in scenes
    ]


def worn_parts(wearer: Mesh, garments: Mapping[str, Mesh]) -> list[ColouredMesh]:
    """A body in garments (type -> mesh) of their types' colours; empty meshes are left out."""
    return _coloured({BODY: wearer, **garments})


def label_colours(labels: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8 segmentation (H, W) in the colours of garments."""
    colours = np.ones((FIRST_GARMENT_PIXEL + len(GARMENTS), 3))
    colours[BODY_PIXEL], colours[UNKNOWN_PIXEL] = BODY_COLOUR, _UNKNOWN_COLOUR
    colours[FIRST_GARMENT_PIXEL:] = [garment_colour(garment) for garment in GARMENTS]
    return np.round(255 * colours).astype(np.uint8)[labels]


def cloud_parts(points: np.ndarray, labels: np.ndarray, scene: Scene) -> list[ColouredMesh]:
    """Draw a cloud (P, 3) as balls in the colours of its labels (P,), paler in the distance."""
    colours = [BODY_COLOUR if name not in GARMENTS else garment_colour(name) for name in LABELS]
    depth = points @ scene.camera(PICTURE_SIZE).axes[2]
    share = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-9)
    level = np.minimum((share * _DEPTH_LEVELS).astype(int), _DEPTH_LEVELS - 1)
    radius = _POINT_SHARE * np.sqrt(_SURFACE_M2 / len(points))
    parts = []
    for label, far in sorted(set(zip(labels.tolist(), level.tolist(), strict=True))):
        haze = _HAZE * far / (_DEPTH_LEVELS - 1)
        colour = (1 - haze) * np.array(colours[label]) + haze * BACKDROP
        parts.append(
            ColouredMesh(*_balls(points[(labels == label) & (level == far)], radius), colour)
        )
    return parts


def _balls(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Icosahedra, which smooth normals make round."""
    ball = icosahedron()
    vertices = np.asarray(points, dtype=np.float64)[:, None] + radius * ball.vertices
    first = len(ball.vertices) * np.arange(len(points))[:, None, None]
    return vertices.reshape(-1, 3), (first + ball.faces).reshape(-1, 3)


_STANDING = Scene(target=(0.0, 0.0, _TARGET_HEIGHT_M), floor_z=-0.95)


@dataclass(frozen=True)
class GarmentPicture:
    """One picture of a garment."""

    garment: Mesh | None  # in the frame of the body, Z up; None draws the body alone
    body: Mesh | None  # its wearer, or None
    colour: Sequence[float] = (0.45, 0.6, 0.8)  # sRGB of the garment in 0-1
    # (V,) of the garment's vertices, drawn as heat in place of the colour.
    error_mm: np.ndarray | None = None
    scene: Scene = _STANDING


def view_picture(
    view: GarmentPicture, *, size: tuple[int, int] = (240, 250), samples: int = 14
) -> np.ndarray:
    """(height, width, 3) uint8 picture; the same scale for all views of one size."""
    parts = []
    if view.body is not None:
        parts.append(ColouredMesh(view.body.vertices, view.body.faces, BODY_COLOUR))
    if view.garment is not None and len(view.garment.faces):
        vertices, faces = view.garment.vertices, view.garment.faces
        if view.error_mm is None:
            parts.append(ColouredMesh(vertices, faces, view.colour))
        else:
            error = view.error_mm[faces].mean(axis=1)
            parts += heat_parts(vertices, faces, error, HEAT_SPAN_MM)
    if not parts:
        return np.full((size[1], size[0], 3), _EMPTY, dtype=np.uint8)
    return view.scene.picture(parts, size, samples)


def plot_views(
    path: str | Path,
    rows: Mapping[str, Sequence[GarmentPicture]],
    *,
    columns: Sequence[str] = (),
    heat: bool = False,
) -> None:
    """Rows of views under their names.

    Args:
        rows: label -> views; labels may have several lines.
        columns: titles above.
        heat: add the colour bar of the errors.
    """
    pictures = [
        [view_picture(view) for view in views]
        for views in progress(rows.values(), label="pictures")
    ]
    save_grid(
        path,
        [[GridCell(picture) for picture in row] for row in pictures],
        labels=list(rows),
        columns=columns,
        heat_mm=HEAT_SPAN_MM if heat else None,
    )


def wearer_view(
    wearer: Mesh,
    colour: Sequence[float] = GarmentPicture.colour,
    front: tuple[float, float] = Scene.front,
) -> GarmentPicture:
    """A view without a garment yet: the wearer on the floor, in the middle of the picture."""
    low, high = wearer.vertices.min(axis=0), wearer.vertices.max(axis=0)
    middle = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2)
    scene = Scene(target=(*middle, _TARGET_HEIGHT_M), front=front, floor_z=float(low[2]))
    return GarmentPicture(None, wearer, colour, scene=scene)
