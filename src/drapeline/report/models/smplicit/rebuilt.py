"""Garments as SMPLicit gives them back: one layer, its error, and the walls of the paper."""

from dataclasses import replace
from pathlib import Path

from drapeline.metrics.garment import distances_mm
from drapeline.metrics.predictions import RebuiltGarment
from drapeline.report.colours import garment_colour
from drapeline.report.models.scene import View, plot_views, wearer_view

COLUMNS = ("original", "one layer", "its error", "walls", "mean code")


def plot_rebuilt(path: str | Path, garments: list[RebuiltGarment]) -> None:
    """Write the figure, a row per garment."""
    plot_views(path, {g.label: _views(g) for g in garments}, columns=COLUMNS, heat=True)


def _views(garment: RebuiltGarment) -> list[View]:
    view = wearer_view(garment.wearer, garment_colour(garment.garment))
    error = distances_mm(garment.sheet.vertices, garment.original)
    return [
        replace(view, garment=garment.original),
        replace(view, garment=garment.sheet),
        replace(view, body=None, garment=garment.sheet, error_mm=error),
        replace(view, garment=garment.walls),
        replace(view, garment=garment.mean),
    ]
