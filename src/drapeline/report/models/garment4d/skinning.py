"""Figure 7 of the Garment4D paper for our garments: what interpolated skinning weights do."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from drapeline.dataset.scene_part import BODY_COLOUR
from drapeline.geometry.mesh import edges
from drapeline.rendering.picture_grid import GridCell, save_grid
from drapeline.rendering.raytracer import ColouredMesh
from drapeline.report.colours import garment_colour
from drapeline.report.models.scene import Scene, fit_scene
from drapeline.rule_log import progress

_RING = (213, 94, 0)
_CLOSE_M = 0.75  # what the height of a close-up spans


class SkinnedTwice(NamedTuple):
    """A garment posed by skinning weights of one body vertex, and of many.

    Attributes:
        label: of its row in the figure; may have several lines.
        garment: its type.
        canonical: (N, 3) metres.
        faces: (n, 3) of the template.
        nearest: (N, 3) posed with K = 1.
        interpolated: (N, 3) posed with more neighbours.
        body: (V, 3) in the same pose.
        body_faces: (f, 3).
        root_height: metres of the root joint above the floor.
    """

    label: str
    garment: str
    canonical: np.ndarray
    faces: np.ndarray
    nearest: np.ndarray
    interpolated: np.ndarray
    body: np.ndarray
    body_faces: np.ndarray
    root_height: float


def plot_neighbours(path: str | Path, cases: Sequence[SkinnedTwice], neighbours: int) -> None:
    """Figure 7: what K = 1 does to a garment, and what interpolated weights do.

    The camera stands before the place where K = 1 deforms the garment most, which is ringed.

    Args:
        path: the PNG.
        cases: one for each row.
        neighbours: K of the interpolated weights.
    """
    rows = [_neighbour_cells(case) for case in progress(cases, label="skinned twice")]
    save_grid(
        path,
        rows,
        columns=("K = 1", "close-up", f"K = {neighbours}", "close-up"),
        labels=[case.label for case in cases],
    )


def worst_place(canonical: np.ndarray, posed: np.ndarray, faces: np.ndarray) -> int:
    """Vertex of a garment (N, 3) around which posing changed the lengths of edges most."""
    ends = edges(faces)
    before, after = (
        np.linalg.norm(v[ends[:, 0]] - v[ends[:, 1]], axis=1) for v in (canonical, posed)
    )
    change = np.abs(np.log(np.maximum(after, 1e-9) / np.maximum(before, 1e-9)))
    total = np.bincount(ends.ravel(), np.repeat(change, 2), len(canonical))
    count = np.bincount(ends.ravel(), minlength=len(canonical))
    return int(np.argmax(total / np.maximum(count, 1)))


def _neighbour_cells(case: SkinnedTwice) -> list[GridCell]:
    place = case.nearest[worst_place(case.canonical, case.nearest, case.faces)]
    outwards = (place - case.nearest.mean(axis=0))[:2]
    lifted = place + [0, 0, case.root_height]
    towards = Scene(
        front=(float(outwards[0]), float(outwards[1])), floor_z=-case.root_height, turn_deg=0.0
    )
    far = fit_scene(towards, [case.body, case.nearest, case.interpolated])
    near = replace(far, target=tuple(lifted.tolist()), height_m=_CLOSE_M)
    cells = []
    for vertices in (case.nearest, case.interpolated):
        parts = [
            ColouredMesh(case.body, case.body_faces, BODY_COLOUR),
            ColouredMesh(vertices, case.faces, garment_colour(case.garment)),
        ]
        cells.append(GridCell(_draw_ring(far.picture(parts), far, lifted)))
        cells.append(GridCell(near.picture(parts)))
    return cells


def _draw_ring(picture: np.ndarray, scene: Scene, place: np.ndarray) -> np.ndarray:
    """Draw a ring around what the close-up of a picture shows."""
    height, width = picture.shape[:2]
    (x, y), _ = scene.camera((width, height)).project(place)
    radius = 0.36 * _CLOSE_M / scene.height_m * height
    # Drawn large and shrunk: Pillow's own ellipses have steps.
    image = Image.fromarray(picture).resize((4 * width, 4 * height), Image.Resampling.NEAREST)
    box = [4 * v for v in (x - radius, y - radius, x + radius, y + radius)]
    ImageDraw.Draw(image).ellipse(box, outline=_RING, width=7)
    return np.asarray(image.resize((width, height), Image.Resampling.BOX))
