"""Figures 7 to 10 of the CLOTH3D paper for our models: errors, codes, transitions, wrinkles."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drapeline.geometry.mesh import Mesh, faces_within
from drapeline.metrics.garment import distances_mm, garment_mesh
from drapeline.metrics.predictions import GarmentCase, WornGarment
from drapeline.rendering.camera import facing_direction
from drapeline.rendering.pictures import save_animation, save_contact_sheet
from drapeline.report.colours import GARMENT_COLOURS, garment_colour
from drapeline.report.models.scene import GarmentPicture, view_picture, wearer_view
from drapeline.report.style import saved_figure

ERROR_COLUMNS = ("original", "registered", "registration error", "reconstruction", "its error")

_MOVING_SIZE = (440, 480)


def plot_samples(
    path: str | Path, views: Mapping[str, GarmentPicture], *, columns: int = 6
) -> None:
    """A sheet of sampled garments, each above its caption."""
    pictures = [(view_picture(view), name) for name, view in views.items()]
    save_contact_sheet(path, pictures, columns)


def animate_views(
    path: str | Path, views: Sequence[GarmentPicture], *, frame_ms: float = 1000 / 15
) -> None:
    """Animate a transition, there and back."""
    pictures = [view_picture(view, size=_MOVING_SIZE, samples=8) for view in views]
    save_animation(path, [*pictures, *pictures[-2:0:-1]], frame_ms)


def error_views(case: GarmentCase) -> list[GarmentPicture]:
    """A row of figure 7: original, registered, their difference, reconstruction, its error.

    Errors are drawn without the wearer; that of the reconstruction on the true mask.
    """
    view = wearer_view(case.wearer, front=facing_direction(case.root_rotation))
    registered = garment_mesh(case.true, case.faces, case.mask)
    made = garment_mesh(case.predicted, case.faces, case.predicted_mask)
    error_mm = 1000 * np.linalg.norm(case.predicted - case.true, axis=1)
    heat = replace(view, body=None)
    return [
        replace(view, garment=case.original),
        replace(view, garment=registered),
        replace(
            heat, garment=case.original, error_mm=distances_mm(case.original.vertices, registered)
        ),
        replace(view, garment=made),
        replace(
            heat,
            garment=garment_mesh(case.predicted, case.faces, case.mask),
            error_mm=error_mm[np.unique(faces_within(case.faces, case.mask))],
        ),
    ]


def walk_view(garment: Mesh, wearer: Mesh, garment_type: str) -> GarmentPicture:
    """A step of a transition: the garment on its wearer in the colour of its type."""
    return replace(wearer_view(wearer, garment_colour(garment_type)), garment=garment)


def worn_view(worn: WornGarment) -> GarmentPicture:
    """A garment in motion on its wearer, in the colour of its type."""
    front = facing_direction(worn.root_rotation)
    return replace(
        wearer_view(worn.wearer, garment_colour(worn.garment_type), front), garment=worn.garment
    )


_PERPLEXITY = 30.0

_CODES_MAX = 1500  # points of the t-SNE, whose time grows with their square


def plot_codes(
    path: str | Path, codes: np.ndarray, garments: Sequence[str], splits: Sequence[str]
) -> None:
    """Figure 8: the codes of garments in the plane, coloured by type; held-out ones are ringed.

    Args:
        codes: (N, Z) means of the codes; of more than 1500, evenly spaced ones are drawn.
        garments, splits: (N,) type and split of each.
    """
    from sklearn.manifold import TSNE  # here, because no other figure needs it

    chosen = np.linspace(0, len(codes) - 1, min(len(codes), _CODES_MAX)).astype(int)
    points = np.asarray(codes, dtype=np.float64)[chosen]
    perplexity = min(_PERPLEXITY, (len(points) - 1) / 3)
    place = TSNE(init="pca", perplexity=perplexity, random_state=0).fit_transform(points)
    garments, splits = np.asarray(garments)[chosen], np.asarray(splits)[chosen]
    with saved_figure(path, 6.4, 5.6) as (_, (axes,)):
        for name, colour in GARMENT_COLOURS.items():
            for held_out in (False, True):
                here = np.equal(garments, name) & ((splits != "train") == held_out)
                if here.any():
                    axes.scatter(
                        place[here, 0],
                        place[here, 1],
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
