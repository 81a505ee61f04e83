"""Pictures of garments on their wearers, in rows under names, for figures of all models."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.dataset.scene_part import BODY_COLOUR
from drapeline.geometry.mesh import Mesh
from drapeline.rendering.picture_grid import GridCell, heat_parts, save_grid
from drapeline.rendering.raytracer import ColouredMesh
from drapeline.report.models.scene import Scene
from drapeline.rule_log import progress

HEAT_SPAN_MM = 30.0
_TARGET_HEIGHT_M = 0.95
_EMPTY = 255  # white, like the background of the others


_STANDING = Scene(target=(0.0, 0.0, _TARGET_HEIGHT_M), floor_z=-0.95)


@dataclass(frozen=True)
class View:
    """One picture of a garment.

    Attributes:
        garment: in the frame of the body, Z up; None draws the body alone.
        body: its wearer, or None.
        colour: sRGB of the garment in 0-1.
        error_mm: (V,) of the garment's vertices, drawn as heat in place of the colour.
        scene: where the picture is taken from.
    """

    garment: Mesh | None
    body: Mesh | None
    colour: Sequence[float] = (0.45, 0.6, 0.8)
    error_mm: np.ndarray | None = None
    scene: Scene = _STANDING


def view_picture(
    view: View, *, size: tuple[int, int] = (240, 250), samples: int = 14
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
    rows: Mapping[str, Sequence[View]],
    *,
    columns: Sequence[str] = (),
    heat: bool = False,
) -> None:
    """Rows of views under their names.

    Args:
        path: the PNG.
        rows: label -> views; labels may have several lines.
        columns: titles above.
        heat: add the colour bar of the errors.
    """
    pictures = [
        [view_picture(view) for view in views]
        for views in progress(rows.values(), total=len(rows), label="pictures")
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
    colour: Sequence[float] = View.colour,
    front: tuple[float, float] = Scene.front,
) -> View:
    """A view without a garment yet: the wearer on the floor, in the middle of the picture."""
    low, high = wearer.vertices.min(axis=0), wearer.vertices.max(axis=0)
    middle = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2)
    scene = Scene(target=(*middle, _TARGET_HEIGHT_M), front=front, floor_z=float(low[2]))
    return View(None, wearer, colour, scene=scene)
