"""Pictures of SMPLicit's garments: rebuilt ones, those of its gallery, and one in motion."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drapeline.frames import FPS
from drapeline.metrics.garment import distances_mm
from drapeline.metrics.predictions import GalleryGarment, RebuiltGarment, WornGarment
from drapeline.rendering.animation import save_animation
from drapeline.rendering.camera import facing_direction
from drapeline.rendering.picture_grid import GridCell, save_contact_sheet, save_grid, text_card
from drapeline.report.colours import garment_colour
from drapeline.report.models.scene import (
    Scene,
    View,
    fit_scene,
    plot_views,
    share_scale,
    view_picture,
    wearer_view,
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


def plot_rebuilt(path: str | Path, garments: list[RebuiltGarment]) -> None:
    """Write the figure of rebuilt garments: each as one layer, its error, and the paper's walls."""
    plot_views(
        path, {g.label: _rebuilt_views(g) for g in garments}, columns=REBUILT_COLUMNS, heat=True
    )


def _rebuilt_views(garment: RebuiltGarment) -> list[View]:
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
    """Write a sheet.

    Args:
        path: the PNG.
        garments: of one sheet, row by row; a card says so if there are none.
    """
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
        for row in progress(rows.values(), total=len(rows), label="rows")
    ]
    columns = [garment.column for garment in next(iter(rows.values()))]
    save_grid(path, cells, labels=list(rows), columns=columns)


def plot_clip(path: str | Path, rows: Mapping[str, Sequence[WornGarment]]) -> None:
    """Write a sheet of frames in motion, a row for each way of moving the same garment.

    Args:
        path: the PNG.
        rows: title -> frames in the world, the floor at zero.
    """
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
        for worn in progress(frames[::_EVERY], total=len(frames[::_EVERY]), label="frames")
    ]
    save_animation(path, pictures, 1000 * _EVERY / FPS)


def _facing(worn: WornGarment) -> Scene:
    return Scene(front=facing_direction(worn.root_rotation))


def _worn_view(worn: WornGarment, scene: Scene) -> View:
    return View(worn.garment, worn.wearer, garment_colour(worn.garment_type), scene=scene)


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


def _view(garment: GalleryGarment, height: float, middle: float) -> View:
    view = wearer_view(garment.wearer, garment_colour(garment.garment))
    floor = view.scene.floor_z
    scene = replace(view.scene, height_m=height, target=(0.0, 0.0, middle - floor))
    return replace(view, garment=garment.mesh, scene=scene)
