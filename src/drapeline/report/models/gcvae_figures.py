"""Figures 7 to 10 of the CLOTH3D paper for our models: errors, codes, transitions, wrinkles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from scipy.spatial.transform import Rotation
from sklearn.manifold import TSNE

from drapeline.geometry.mesh import Mesh, faces_within
from drapeline.metrics.garment import distances_mm, garment_mesh
from drapeline.metrics.predictions import GarmentCase, WornGarment
from drapeline.outfits.garment_types import GARMENTS
from drapeline.rendering.animated_png import save_moving
from drapeline.rendering.camera import Camera, look_at
from drapeline.rendering.contact_sheet import contact_sheet
from drapeline.rendering.picture_grid import Cell, heat_parts, save_sheet
from drapeline.rendering.raytracer import ColouredMesh, raytrace
from drapeline.report.style import SERIES, saved_figure
from drapeline.rule_log import progress

GARMENT_COLOURS = dict(zip(GARMENTS, SERIES, strict=True))
HEAT_SPAN_MM = 30.0
_SKIN = (0.83, 0.69, 0.6)
_DISTANCE_M = 7.0
_PERPLEXITY = 30.0
_SEEN_HEIGHT_M = 2.1
_TARGET_HEIGHT_M = 0.95
_TURN_DEG = 24.0  # the camera stands this far to the side of where the body faces
_RISE = 0.12

_CODES_MAX = 1500  # points of the t-SNE, whose time grows with their square


@dataclass(frozen=True)
class View:
    """One picture of a garment.

    Attributes:
        garment: in the frame of the body, Z up; None draws the body alone.
        body: its wearer, or None.
        colour: sRGB of the garment in 0-1.
        error_mm: (V,) of the garment's vertices, drawn as heat in place of the colour.
        floor_z: height of the floor in the garment's frame.
        middle: (x, y) that is in the middle of the picture.
        front: (x, y) direction that the wearer faces.
    """

    garment: Mesh | None
    body: Mesh | None
    colour: Sequence[float] = (0.45, 0.6, 0.8)
    error_mm: np.ndarray | None = None
    floor_z: float = -0.95
    middle: tuple[float, float] = (0.0, 0.0)
    front: tuple[float, float] = (0.0, -1.0)


def view_picture(
    view: View, *, size: tuple[int, int] = (240, 250), samples: int = 14
) -> np.ndarray:
    """(height, width, 3) uint8 studio picture; the same scale for all views of one size."""
    lift = np.array([0.0, 0.0, -view.floor_z])
    parts = []
    if view.body is not None:
        parts.append(ColouredMesh(view.body.vertices + lift, view.body.faces, _SKIN))
    if view.garment is not None and len(view.garment.faces):
        vertices, faces = view.garment.vertices + lift, view.garment.faces
        if view.error_mm is None:
            parts.append(ColouredMesh(vertices, faces, view.colour))
        else:
            error = view.error_mm[faces].mean(axis=1)
            parts += heat_parts(vertices, faces, error, HEAT_SPAN_MM)
    if not parts:
        return np.full((size[1], size[0], 3), 237, dtype=np.uint8)
    camera = _camera(view, size)
    return raytrace(parts, camera, floor_centre=view.middle, samples=samples)


def _camera(view: View, size: tuple[int, int]) -> Camera:
    angle = np.arctan2(view.front[1], view.front[0]) + np.radians(_TURN_DEG)
    direction = np.array([np.cos(angle), np.sin(angle), _RISE])
    direction /= np.linalg.norm(direction)
    target = np.array([*view.middle, _TARGET_HEIGHT_M])
    return look_at(
        target + _DISTANCE_M * direction,
        target,
        focal_px=size[1] * _DISTANCE_M / _SEEN_HEIGHT_M,
        size=size,
    )


def plot_codes(
    path: str | Path, codes: np.ndarray, garments: Sequence[str], splits: Sequence[str]
) -> None:
    """Figure 8: the codes of garments in the plane, coloured by type; held-out ones are ringed.

    Args:
        path: the figure.
        codes: (N, Z) means of the codes; of more than 1500, evenly spaced ones are drawn.
        garments, splits: (N,) type and split of each.
    """
    chosen = np.linspace(0, len(codes) - 1, min(len(codes), _CODES_MAX)).astype(int)
    points = np.asarray(codes, dtype=np.float64)[chosen]
    perplexity = min(_PERPLEXITY, (len(points) - 1) / 3)
    place = TSNE(init="pca", perplexity=perplexity, random_state=0).fit_transform(points)
    garments, splits = np.asarray(garments)[chosen], np.asarray(splits)[chosen]
    with saved_figure(path, 6.4, 5.6) as (_, (axes,)):
        for name, colour in GARMENT_COLOURS.items():
            for held_out in (False, True):
                here = (garments == name) & ((splits != "train") == held_out)
                if here.any():
                    axes.scatter(
                        *place[here].T,
                        s=22 if held_out else 11,
                        color=colour,
                        edgecolor="#222222" if held_out else "none",
                        linewidth=0.7,
                        label=None if held_out else name,
                    )
        axes.set_xticks([])
        axes.set_yticks([])
        axes.spines[:].set_visible(False)
        axes.set_aspect("equal")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=6, markerscale=1.6)


def error_views(case: GarmentCase) -> list[View]:
    """A row of figure 7: original, registered, their difference, reconstruction, its error.

    Errors are drawn without the wearer; that of the reconstruction on the true mask.
    """
    scene = standing(case.wearer, front=front_of(case.root_rotation))
    registered = garment_mesh(case.true, case.faces, case.mask)
    made = garment_mesh(case.predicted, case.faces, case.predicted_mask)
    error_mm = 1000 * np.linalg.norm(case.predicted - case.true, axis=1)
    heat = replace(scene, body=None)
    return [
        replace(scene, garment=case.original),
        replace(scene, garment=registered),
        replace(
            heat,
            garment=case.original,
            error_mm=distances_mm(case.original.vertices, registered),
        ),
        replace(scene, garment=made),
        replace(
            heat,
            garment=garment_mesh(case.predicted, case.faces, case.mask),
            error_mm=error_mm[np.unique(faces_within(case.faces, case.mask))],
        ),
    ]


def front_of(root_rotation: np.ndarray) -> tuple[float, float]:
    """Horizontal direction that a body faces; of one that lies, where its head points from."""
    turn = Rotation.from_rotvec(np.array(root_rotation))
    front, upwards = turn.apply([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    if np.hypot(*front[:2]) < 0.5:
        front = np.array([-upwards[1], upwards[0], 0.0])
    return float(front[0]), float(front[1])


ERROR_COLUMNS = ("original", "registered", "registration error", "reconstruction", "its error")


def plot_views(
    path: str | Path,
    rows: Mapping[str, Sequence[View]],
    *,
    columns: Sequence[str] = (),
    heat: bool = False,
) -> None:
    """Figures 7, 9 and 10: rows of views under their names.

    Args:
        path: the PNG.
        rows: label -> views; a newline breaks the label.
        columns: titles above.
        heat: add the colour bar of the errors.
    """
    pictures = [
        [view_picture(view) for view in views]
        for views in progress(rows.values(), total=len(rows), label="pictures")
    ]
    save_sheet(
        path,
        [[Cell(picture) for picture in row] for row in pictures],
        labels=list(rows),
        columns=columns,
        heat_mm=HEAT_SPAN_MM if heat else None,
    )


def plot_samples(path: str | Path, views: Mapping[str, View], *, columns: int = 6) -> None:
    """A sheet of sampled garments, each under its caption."""
    pictures = [(view_picture(view), name) for name, view in views.items()]
    contact_sheet(path, pictures, columns)


def animate_views(path: str | Path, views: Sequence[View], *, frame_ms: int = 90) -> None:
    """A transition as a moving picture."""
    pictures = [view_picture(v, size=(250, 260), samples=6) for v in views]
    save_moving(path, [*pictures, *pictures[-2:0:-1]], frame_ms)


def standing(
    wearer: Mesh,
    colour: Sequence[float] = View.colour,
    front: tuple[float, float] = View.front,
) -> View:
    """A scene without a garment yet: the wearer on the floor, in the middle of the picture."""
    low, high = wearer.vertices.min(axis=0), wearer.vertices.max(axis=0)
    middle = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2)
    return View(None, wearer, colour, floor_z=float(low[2]), middle=middle, front=front)


def type_colour(garment: str) -> tuple[float, float, float]:
    """sRGB of a garment type, the same in every figure."""
    return to_rgb(GARMENT_COLOURS[garment])


def walk_view(garment: Mesh, wearer: Mesh, kind: str) -> View:
    """A step of a transition: the garment on its wearer in the colour of its type."""
    return replace(standing(wearer, type_colour(kind)), garment=garment)


def worn_view(worn: WornGarment) -> View:
    """A garment in motion on its wearer, in the colour of its type."""
    scene = standing(worn.wearer, type_colour(worn.kind), front_of(worn.root_rotation))
    return replace(scene, garment=worn.garment)
