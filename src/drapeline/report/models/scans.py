"""Sheets of what is found in segmented scans, by all models."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.segmented_scans import SegmentedScan, load_scans
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import BODY, TRUE, Fits, load_fitted_scans
from drapeline.metrics.registry import variants
from drapeline.outfits.garment_types import LABELS
from drapeline.rendering.camera import facing_direction
from drapeline.rendering.pictures import GridCell, save_contact_sheet, save_grid, text_card
from drapeline.report.models.scene import Scene, cloud_parts, fit_scene, spread_frames, worn_parts
from drapeline.rule_log import progress

OWN = "own"
_SHOWN_POINTS = 4000
_UNKNOWN = "This model does not know these garments."
_NOTHING = "No sample of the test split was accepted, or none wears a garment that a model knows."


def plot_scans(
    path: str | Path, scans: Sequence[str | Path], fits: Sequence[str | Path], most: int
) -> None:
    """Write a row for each scan: its points, what the models find, and the simulated garments.

    Args:
        scans: files of scans.
        fits: files of fits, by whatever models.
        most: rows; of more scans, some that are evenly spread.

    Raises:
        InputError: a file is missing or lacks an array.
    """
    found: dict[str, dict[str, Mapping[str, Mesh]]] = {}
    for file in fits:
        for name, by_variant in load_fitted_scans(file).items():
            found.setdefault(name, {}).update(by_variant)
    every = [one for file in scans for one in load_scans(file)]
    fitted = [scan for scan, _ in every if BODY in found.get(scan.name, {})]
    shown = [fitted[k] for k in spread_frames(len(fitted), most)]
    if not shown:
        save_contact_sheet(path, [(text_card("Nothing to show", _NOTHING, (640, 200)), "")], 1)
        return
    titles = {name: one.short for name, one in variants("scan").items() if one.short}
    titles[TRUE] = "simulated"
    columns = [name for name in titles if any(name in found[scan.name] for scan in shown)]
    rows = [_row(scan, found[scan.name], columns) for scan in progress(shown, label="scans")]
    save_grid(
        path,
        rows,
        columns=["scan", *(titles[name] for name in columns)],
        labels=[scan.name.replace("_", "\nframe ") for scan in shown],
    )


def plot_own_scans(path: str | Path, shown: Sequence[tuple[SegmentedScan, Fits]]) -> None:
    """Write a row for each of a user's scans: its points, and what was found."""
    rows = [_row(scan, fits, [OWN]) for scan, fits in progress(shown, label="scans")]
    names = [scan.name for scan, _ in shown]
    save_grid(path, rows, columns=["scan", "body and garments"], labels=names)


def _row(scan: SegmentedScan, fits: Fits, columns: Sequence[str]) -> list[GridCell]:
    body = fits[BODY][BODY]
    scene = _scene(scan, scan.estimate, [body.vertices, scan.points])
    some = np.linspace(0, len(scan.points) - 1, min(_SHOWN_POINTS, len(scan.points))).astype(int)
    known = some[scan.labels[some] < len(LABELS)]
    cloud = cloud_parts(scan.points[known], scan.labels[known], scene)
    cells = [GridCell(scene.picture(cloud))]
    for name in columns:
        garments = dict(fits.get(name, {}))
        wearer = garments.pop(BODY, body)
        height, width = cells[0].picture.shape[:2]
        picture = (
            scene.picture(worn_parts(wearer, garments))
            if garments
            else text_card("", _UNKNOWN, (width, height))
        )
        cells.append(GridCell(picture))
    return cells


def _scene(scan: SegmentedScan, body: BodyState, meshes: Sequence[np.ndarray]) -> Scene:
    front = facing_direction(body.pose[:3])
    low = min(float(part[:, 2].min()) for part in meshes)
    return fit_scene(Scene(front=front, floor_z=low), meshes)
