"""Pictures of SMPLicit's garments: rebuilt, in galleries, in motion, and found in pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from drapeline.frames import FPS
from drapeline.geometry.mesh import Mesh
from drapeline.job import Job
from drapeline.metrics.garment import distances_mm
from drapeline.metrics.predictions import (
    FittedPicture,
    GalleryGarment,
    PersonShown,
    RebuiltGarment,
    WornGarment,
    load_fitted_picture,
)
from drapeline.rendering.camera import Camera, facing_direction
from drapeline.rendering.modalities import cast_rays
from drapeline.rendering.pictures import (
    GridCell,
    save_animation,
    save_contact_sheet,
    save_grid,
    text_card,
)
from drapeline.rendering.raytracer import ray_share, raytrace
from drapeline.report.colours import garment_colour
from drapeline.report.models.scene import (
    GarmentPicture,
    Scene,
    fit_scene,
    label_colours,
    plot_views,
    share_scale,
    spread_frames,
    view_picture,
    wearer_view,
    worn_parts,
)
from drapeline.rule_log import progress

REBUILT_COLUMNS = ("original", "one layer", "its error", "walls", "mean code")
_PIXELS = 64_000  # of a picture, whatever its sides
_MARGIN = 1.2
_RIGHT = np.array([np.cos(np.radians(Scene.turn_deg)), np.sin(np.radians(Scene.turn_deg))])
_BELOW = 24  # pixels for a caption
_CARD = (640, 200)
_NOTHING = "There are too few training garments, or they differ too little, to show this."
_CLIP_SIZE, _MOVING_SIZE = (230, 290), (400, 440)
_EVERY = 2  # frames that the moving picture goes on by
_ROUND = 10  # sides of pictures are multiples of this
OWN_COLUMNS = ("picture", "found", "from the side")
KNOWN_COLUMNS = (
    "segmentation",
    "found",
    "simulated",
    "found,\nfrom the side",
    "simulated,\nfrom the side",
)
_OWN_PX, _KNOWN_PX = 480, 260
_WIDEST = 1.6  # times as wide as high
_FADE = 0.65  # of a picture towards white, below what was found in it
_TURN = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])  # a quarter turn about the vertical
_SIDE_DISTANCE_M, _SIDE_MARGIN = 7.0, 1.1
_FLOATING_M = 50.0  # high above the floor, whose shadows would fall on the picture
# The camera of a world that is upright in the picture, whatever the axes of the person's.
_LEVEL = np.array([[1, 0, 0, 0], [0, 0, -1, _FLOATING_M], [0, 1, 0, 0], [0, 0, 0, 1.0]])


def plot_rebuilt(path: str | Path, garments: list[RebuiltGarment]) -> None:
    """Write the figure of rebuilt garments: each as one layer, its error, and the paper's walls."""
    plot_views(
        path, {g.label: _rebuilt_views(g) for g in garments}, columns=REBUILT_COLUMNS, heat=True
    )


def _rebuilt_views(garment: RebuiltGarment) -> list[GarmentPicture]:
    view = wearer_view(garment.wearer, garment_colour(garment.garment))
    error = distances_mm(garment.sheet.vertices, garment.original)
    return [
        replace(view, garment=garment.original),
        replace(view, garment=garment.sheet),
        replace(view, body=None, garment=garment.sheet, error_mm=error),
        replace(view, garment=garment.walls),
        replace(view, garment=garment.mean),
    ]


def plot_gallery(path: str | Path, garments: Sequence[GalleryGarment]) -> None:
    """Write a sheet of garments, row by row; a card says so if there are none."""
    if not garments:
        save_contact_sheet(path, [(text_card("Nothing to show", _NOTHING, _CARD), "")], 1)
        return
    rows: dict[str, list[GalleryGarment]] = {}
    for garment in garments:
        rows.setdefault(garment.row, []).append(garment)
    height, middle, size = _frame(garments)
    below = _BELOW if any(garment.caption for garment in garments) else 0
    cells = [
        [
            GridCell(
                np.pad(
                    view_picture(_view(garment, height, middle), size=size),
                    ((0, below), (0, 0), (0, 0)),
                    constant_values=255,
                ),
                garment.caption,
            )
            for garment in row
        ]
        for row in progress(rows.values(), label="rows")
    ]
    columns = [garment.column for garment in next(iter(rows.values()))]
    save_grid(path, cells, labels=list(rows), columns=columns)


def plot_clip(path: str | Path, rows: Mapping[str, Sequence[WornGarment]]) -> None:
    """Write a sheet of frames in the world, a titled row for each way of moving the garment."""
    scenes = share_scale(
        [
            fit_scene(_facing(worn), [worn.wearer.vertices, worn.garment.vertices], _CLIP_SIZE)
            for worn in next(iter(rows.values()))
        ]
    )
    cells = [
        [
            GridCell(view_picture(_worn_view(worn, scene), size=_CLIP_SIZE))
            for worn, scene in zip(row, scenes, strict=True)
        ]
        for row in rows.values()
    ]
    save_grid(path, cells, labels=list(rows))


def animate_clip(path: str | Path, frames: Sequence[WornGarment]) -> None:
    """Write a moving PNG of frames in the world, seen from where the first one faces."""
    every = [mesh.vertices for worn in frames for mesh in (worn.wearer, worn.garment)]
    scene = fit_scene(_facing(frames[0]), every, _MOVING_SIZE)
    pictures = [
        view_picture(_worn_view(worn, scene), size=_MOVING_SIZE, samples=8)
        for worn in progress(frames[::_EVERY], label="frames")
    ]
    save_animation(path, pictures, 1000 * _EVERY / FPS)


def _facing(worn: WornGarment) -> Scene:
    return Scene(front=facing_direction(worn.root_rotation))


def _worn_view(worn: WornGarment, scene: Scene) -> GarmentPicture:
    return GarmentPicture(worn.garment, worn.wearer, garment_colour(worn.garment_type), scene=scene)


def _frame(garments: Sequence[GalleryGarment]) -> tuple[float, float, tuple[int, int]]:
    """Span of all pictures of a sheet: height and middle in metres, and their size in pixels.

    They hold every garment, on the side of the wearer that the camera sees.
    """
    drawn = [garment.mesh.vertices for garment in garments if len(garment.mesh.faces)]
    points = np.concatenate(drawn or [garments[0].wearer.vertices])
    low, high = points[:, 2].min(), points[:, 2].max()
    across = 2 * np.abs(points[:, :2] @ _RIGHT).max()
    height, width = _MARGIN * (high - low), _MARGIN * across
    aspect = float(np.clip(width / height, 0.75, 1.6))
    height = max(height, width / aspect)
    pixels = np.sqrt(_PIXELS * np.array([aspect, 1 / aspect]))
    size = tuple((_ROUND * np.round(pixels / _ROUND)).astype(int).tolist())
    return float(height), float(low + high) / 2, size


def _view(garment: GalleryGarment, height: float, middle: float) -> GarmentPicture:
    view = wearer_view(garment.wearer, garment_colour(garment.garment))
    floor = view.scene.floor_z
    scene = replace(view.scene, height_m=height, target=(0.0, 0.0, middle - floor))
    return replace(view, garment=garment.mesh, scene=scene)


def plot_own_picture(path: str | Path, picture: FittedPicture) -> None:
    """Write a user's picture with what was found in it."""
    before, found = _seen(picture, "garments")
    aspect = min(max(before.shape[1] / before.shape[0], 1), _WIDEST)
    size = (round(aspect * _OWN_PX), _OWN_PX)
    cells = (before, found, _side(picture, "garments", _OWN_PX))
    save_grid(path, [[GridCell(_centre(cell, size)) for cell in cells]], columns=OWN_COLUMNS)


def plot_known_pictures(path: str | Path, pictures: Sequence[FittedPicture]) -> None:
    """Write a row for each picture of simulated garments."""
    rows = []
    for picture in progress(pictures, label="pictures"):
        before, found = _seen(picture, "garments")
        _, true = _seen(picture, "true")
        sides = [_side(picture, kind, _KNOWN_PX) for kind in ("garments", "true")]
        cells = (before, found, true, *sides)
        rows.append([GridCell(_centre(cell, (_KNOWN_PX, _KNOWN_PX))) for cell in cells])
    save_grid(
        path,
        rows,
        columns=KNOWN_COLUMNS,
        labels=[picture.name.replace("_", "\nframe ") for picture in pictures],
    )


def _seen(picture: FittedPicture, kind: str) -> list[np.ndarray]:
    """The picture, and with garments over it, cut to where people are."""
    before = label_colours(picture.labels) if picture.photo is None else picture.photo
    after = np.round(before + _FADE * (255.0 - before)).astype(np.uint8)
    # The nearest last: what is near is large.
    for person in sorted(picture.people, key=_scale):
        after = _draw(after, person, getattr(person, kind))
    return [_cut(image, picture) for image in (before, after)]


def _scale(person: PersonShown) -> float:
    """Pixels per metre at the body."""
    _, depth = _camera(person, (1, 1)).project(person.body.vertices.mean(axis=0))
    return float(person.intrinsics[0, 0] / depth)


def _camera(person: PersonShown, size: tuple[int, int]) -> Camera:
    return Camera(person.intrinsics, person.world_to_camera, *size)


def _draw(image: np.ndarray, person: PersonShown, garments: Mapping[str, Mesh]) -> np.ndarray:
    """A dressed person over an image (H, W, 3) uint8."""
    camera = _camera(person, (image.shape[1], image.shape[0]))
    parts = [
        replace(part, vertices=_upright(part.vertices, camera))
        for part in worn_parts(person.body, garments)
    ]
    level = Camera(camera.intrinsics, _LEVEL, camera.width, camera.height)
    rendered = raytrace(parts, level, samples=12)
    hit = cast_rays([(p.vertices, p.faces, np.zeros_like(p.vertices)) for p in parts], level)
    return np.where(hit.segments[..., None] > 0, rendered, image)


def _upright(points: np.ndarray, camera: Camera) -> np.ndarray:
    """(P, 3) points as the camera sees them: x to the right, y away, z up."""
    seen = points @ camera.axes.T + camera.world_to_camera[:3, 3]
    return np.stack([seen[:, 0], seen[:, 2], _FLOATING_M - seen[:, 1]], axis=1)


def _side(picture: FittedPicture, kind: str, size_px: int) -> np.ndarray:
    """All people from the right of the picture, one beside the other."""
    views = [_side_of_person(one, getattr(one, kind), size_px) for one in picture.people]
    return np.concatenate([_narrow(view) for view in views], axis=1)


def _narrow(view: np.ndarray) -> np.ndarray:
    """A view without the empty columns at its sides, but for a margin."""
    (drawn,) = np.nonzero((view != view[0, 0]).any(axis=(0, 2)))
    margin = view.shape[1] // 20
    return view[:, max(0, drawn[0] - margin) : drawn[-1] + 1 + margin]


def _side_of_person(person: PersonShown, garments: Mapping[str, Mesh], size_px: int) -> np.ndarray:
    camera = _camera(person, (size_px, size_px))
    parts = [
        replace(part, vertices=_upright(part.vertices, camera) @ _TURN.T)
        for part in worn_parts(person.body, garments)
    ]
    low = np.min([part.vertices.min(axis=0) for part in parts], axis=0)
    high = np.max([part.vertices.max(axis=0) for part in parts], axis=0)
    shift = np.array([0, 0, _FLOATING_M]) - (low + high) / 2
    parts = [replace(part, vertices=part.vertices + shift) for part in parts]
    focal = size_px * _SIDE_DISTANCE_M / (_SIDE_MARGIN * float((high - low)[[0, 2]].max()))
    intrinsics = np.array([[focal, 0, size_px / 2], [0, focal, size_px / 2], [0, 0, 1.0]])
    view = _LEVEL.copy()
    view[2, 3] = _SIDE_DISTANCE_M
    return raytrace(parts, Camera(intrinsics, view, size_px, size_px), samples=12)


def _cut(image: np.ndarray, picture: FittedPicture) -> np.ndarray:
    """The part of a picture that shows people, with a margin."""
    rows, columns = np.nonzero(picture.labels)
    part = []
    for places, length in ((rows, image.shape[0]), (columns, image.shape[1])):
        first, last = (int(places.min()), int(places.max())) if len(places) else (0, length)
        margin = round(0.1 * (last - first)) + 2
        part.append(slice(max(0, first - margin), min(length, last + margin)))
    return image[tuple(part)]


def _centre(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """An image scaled to fit a size (width, height), in the middle of white."""
    scale = min(size[0] / image.shape[1], size[1] / image.shape[0])
    inner = (max(1, round(scale * image.shape[1])), max(1, round(scale * image.shape[0])))
    sheet = Image.new("RGB", size, (255, 255, 255))
    place = ((size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2)
    sheet.paste(Image.fromarray(image).resize(inner, Image.Resampling.LANCZOS), place)
    return np.asarray(sheet)


def plot_evaluated_pictures(job: Job) -> None:
    """Garments found in pictures of held-out samples, some of them."""
    files = sorted(Path(job.input.evaluated).glob("*.npz"))
    shown = [files[k] for k in spread_frames(len(files), job.params.most)]
    with ray_share(job.params.rays):
        plot_known_pictures(job.output[0], [load_fitted_picture(file) for file in shown])
