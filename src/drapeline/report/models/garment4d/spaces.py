"""The principal components of Garment4D's canonical garments."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.ticker import PercentFormatter

from drapeline.rendering.picture_grid import GridCell, save_grid
from drapeline.rendering.raytracer import ColouredMesh
from drapeline.report.colours import GARMENT_COLOURS, QUIET, garment_colour
from drapeline.report.models.scene import Scene, fit_scene
from drapeline.report.style import place_legend_above, saved_figure, show_message
from drapeline.rule_log import progress

_DEVIATIONS = (-2, -1, 0, 1, 2)
_SIZE = (210, 210)


class Space(Protocol):
    """Principal components of canonical garments, such as a `GarmentSpace`."""

    faces: np.ndarray
    mean: np.ndarray
    components: np.ndarray
    explained: np.ndarray


def plot_explained(path: str | Path, spaces: Mapping[str, Space]) -> None:
    """Share of the training variance that the first components of each type explain together."""
    with saved_figure(path, 6.4, 3.6) as (_, (axes,)):
        if not spaces:
            show_message(axes, "There are no garment spaces.")
            return
        for name, space in spaces.items():
            share = np.cumsum(np.concatenate([[0.0], space.explained]))
            axes.plot(
                np.arange(len(share)),
                share,
                color=GARMENT_COLOURS[name],
                label=f"{name}: {int(np.argmax(share >= 0.9))} for 90 %"
                if share[-1] >= 0.9
                else name,
            )
        axes.axhline(0.9, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)))
        axes.set(xlabel="Components", ylabel="Variance explained", ylim=(0, 1.02))
        axes.set_xlim(left=0)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        axes.grid(axis="y")
        place_legend_above(axes)


def plot_modes(path: str | Path, spaces: Mapping[str, Space], *, modes: int = 3) -> None:
    """The first components of each type, from -2 to 2 standard deviations from the mean.

    Args:
        path: the PNG.
        spaces: type -> its components, in metres per standard deviation.
        modes: rows of each type, at most.
    """
    rows, labels = [], []
    for name, space in spaces.items():
        count = min(modes, len(space.components))
        shapes = [
            [space.mean + d * space.components[mode] for d in _DEVIATIONS] for mode in range(count)
        ]
        points = np.concatenate(shapes).reshape(-1, 3)
        scene = fit_scene(Scene(floor_z=float(points[:, 2].min())), [points], _SIZE)
        # Lifted high above the floor, on which a garment alone would cast an odd shadow.
        lifted = (*scene.target[:2], scene.target[2] + 10)
        scene = replace(scene, floor_z=scene.floor_z - 10, target=lifted)
        for mode in progress(range(count), label=name):
            parts = [ColouredMesh(v, space.faces, garment_colour(name)) for v in shapes[mode]]
            rows.append([GridCell(scene.picture([part], _SIZE)) for part in parts])
            labels.append(f"{name}\nmode {mode + 1}\n{100 * space.explained[mode]:.1f} %")
    columns = ["mean" if d == 0 else f"{d:+d} std. dev." for d in _DEVIATIONS]
    save_grid(path, rows, columns=columns, labels=labels)
