"""All models fitted to the same segmented scans: tables like SMPLicit's table 2, and a sheet."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.labels import LABELS
from drapeline.dataset.scene_part import BODY_COLOUR
from drapeline.dataset.segmented_scans import SegmentedScan, load_scans
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.fitted_scans import (
    BODY,
    CLASSES,
    COMMON,
    TRUE,
    Fits,
    load_fitted_scans,
)
from drapeline.metrics.table import ALL, HIGH, LOW, MetricRow, find_value, read_metrics
from drapeline.rendering.camera import facing_direction
from drapeline.rendering.picture_grid import GridCell, save_contact_sheet, save_grid, text_card
from drapeline.rendering.raytracer import ColouredMesh
from drapeline.report.colours import garment_colour
from drapeline.report.html import html_table, write_page
from drapeline.report.models.clouds import cloud_parts
from drapeline.report.models.garment4d.steps import spread_frames
from drapeline.report.models.scene import Scene, fit_scene
from drapeline.report.models.sources import tables_by_source
from drapeline.rule_log import progress

_SPLIT = "test"
_FITS = {
    "smplicit_scan_start": "SMPLicit: mean code, estimated body (the start)",
    "smplicit_scan_nearest": "SMPLicit: training code with the least loss",
    "smplicit_scan_code": "SMPLicit: fitted code",
    "smplicit_scan_joint": "SMPLicit: code and body fitted jointly",
    "smplicit_scan_nearest_hung": "SMPLicit: training code with the least loss, hung",
    "smplicit_scan_hung": "SMPLicit: code fitted again to cloth that hangs",
    "svae_scan": "SVAE: fitted code",
    "static_ppca_scan": "Masked PPCA: fitted code",
    "garment4d_scan_pca": "PCA of Garment4D's templates: fitted components",
    "garment4d_scan_posed": "Garment4D's networks",
    "smplicit_scan_hung_moved": "SMPLicit, hung, then moved to the points",
    "smplicit_scan_moved": "SMPLicit, skinned, then moved to the points",
    "svae_scan_moved": "SVAE, skinned, then moved to the points",
    "static_ppca_scan_moved": "Masked PPCA, skinned, then moved to the points",
    "garment4d_scan_moved": "PCA of Garment4D's templates, skinned, then moved to the points",
    "garment4d_scan_ours": "Garment4D's networks, then moved to the points",
}
_BODIES = {
    "scan_body_estimated": "as estimated",
    "scan_body_fitted": "fitted to the scan",
    "scan_body_joint": "fitted again, jointly with SMPLicit's codes",
}
_WAYS = {
    "surface_to_true_mm": "From the fitted garment to the simulated one",
    "true_to_surface_mm": "From the simulated garment to the fitted one",
}
# Table 2 of the paper: mean distances in mm, on scans of the Sizer dataset.
_PAPER = [
    {"Method": method} | dict(zip(CLASSES[:4], errors, strict=True))
    for method, errors in (
        ("CAPE", (0.87, 1.35, 1.15, 1.09)),
        ("TailorNet", (0.32, 0.41, "-", 0.48)),
        ("SMPLicit", (0.46, 0.52, 0.78, 0.58)),
    )
]
_COLUMNS = {
    "smplicit_scan_start": "SMPLicit:\nthe start",
    "smplicit_scan_joint": "SMPLicit:\ncode and body",
    "smplicit_scan_hung": "SMPLicit:\nhung",
    "smplicit_scan_moved": "SMPLicit:\nskinned, moved",
    "smplicit_scan_hung_moved": "SMPLicit:\nhung, moved",
    "svae_scan": "SVAE:\ncode",
    "static_ppca_scan": "Masked PPCA:\ncode",
    "garment4d_scan_pca": "Garment4D:\ncomponents",
    "garment4d_scan_posed": "Garment4D:\nnetworks",
    "garment4d_scan_ours": "Garment4D:\nmoved",
    TRUE: "simulated",
}
OWN = "own"
_SHOWN_POINTS = 4000
_UNKNOWN = "This model does not know these garments."
_NOTHING = "No sample of the test split was accepted, or none wears a garment that a model knows."


def write_scans_page(path: str | Path, metrics: str | Path) -> None:
    """Write the page of tables.

    Args:
        path: the HTML page.
        metrics: table of metrics with the rows of `compare_scan_fits`.

    Raises:
        InputError: the table is missing or unusable.
    """
    rows = read_metrics(metrics)
    parts = [
        "<p>Segmented scans of simulated samples of the test split, all of the dataset's and some"
        " of the learning group's, with noise. The body is"
        " estimated wrongly on purpose and fitted to each scan first; all models but the start get"
        " the same points and the same fitted body, and wear their garments in the same way, but"
        " for the rows of SMPLicit that hang, which are to be compared with one another, and its"
        " other rows with the other models. Mean"
        " distances over the area of the surfaces in mm, with 95 % intervals over samples. Models"
        " are compared on the garments that they know, so rows with other numbers of garments are"
        f" not about the same garments; the column '{COMMON}' has the means over t-shirts, trousers"
        " and skirts, which all models know.</p>"
    ]
    for metric, title in _WAYS.items():
        parts += [f"<h2>{title} (mm)</h2>", html_table(_table(rows, metric))]
        parts += tables_by_source(rows, partial(_table, metric=metric))
    parts += [
        "<h2>Bodies: mean distance of vertices (mm)</h2>",
        html_table(_bodies(rows)),
        "<h2>The paper's own figures</h2>",
        "<p>Table 2 of SMPLicit: distances within the segmented garments of real scans of the Sizer"
        " dataset in mm. Those scans cannot be had here; the figures cannot be compared with those"
        " above.</p>",
        html_table(_PAPER),
    ]
    write_page(path, "All models fitted to the same scans", *parts)


def _table(rows: Sequence[MetricRow], metric: str) -> list[dict[str, object]]:
    found = {row.garment for row in rows if row.metric == metric}
    columns = [name for name in (*CLASSES, COMMON) if name in found]
    table = []
    for variant, title in _FITS.items():
        total = find_value(rows, variant, _SPLIT, ALL, metric)
        if total:
            cells = {name: _cell(rows, variant, name, metric) for name in (*columns, ALL)}
            table.append({"Fit": title, "Garments": total.n, **cells})
    return table


def _bodies(rows: Sequence[MetricRow]) -> list[dict[str, object]]:
    return [
        {"Body": title, "Error": _cell(rows, variant, ALL, "vertex_error_mm")}
        for variant, title in _BODIES.items()
    ]


def _cell(rows: Sequence[MetricRow], variant: str, name: str, metric: str) -> str:
    value, low, high = (
        find_value(rows, variant, _SPLIT, name, metric + end) for end in ("", LOW, HIGH)
    )
    if value is None:
        return "-"
    interval = f" ({low.value:.1f} to {high.value:.1f})" if low and high else ""
    return f"{value.value:.1f}{interval}"


def plot_scans(
    path: str | Path, scans: Sequence[str | Path], fits: Sequence[str | Path], most: int
) -> None:
    """Write a row for each scan: its points, what the models find, and the simulated garments.

    Args:
        path: the PNG.
        scans: files of scans.
        fits: files of fits, by whatever models.
        most: rows; of more scans, some that are evenly spread.

    Raises:
        InputError: a file is missing or lacks an array.
    """
    found: dict[str, dict[str, Mapping[str, Mesh]]] = {}
    for file in fits:
        for name, variants in load_fitted_scans(file).items():
            found.setdefault(name, {}).update(variants)
    every = [one for file in scans for one in load_scans(file)]
    fitted = [scan for scan, _ in every if BODY in found.get(scan.name, {})]
    shown = [fitted[k] for k in spread_frames(len(fitted), most)]
    if not shown:
        save_contact_sheet(path, [(text_card("Nothing to show", _NOTHING, (640, 200)), "")], 1)
        return
    columns = [name for name in _COLUMNS if any(name in found[scan.name] for scan in shown)]
    rows = [
        _row(scan, found[scan.name], columns)
        for scan in progress(shown, total=len(shown), label="scans")
    ]
    save_grid(
        path,
        rows,
        columns=["scan", *(_COLUMNS[name] for name in columns)],
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
        parts = [ColouredMesh(wearer.vertices, wearer.faces, BODY_COLOUR)]
        parts += [
            ColouredMesh(mesh.vertices, mesh.faces, garment_colour(garment))
            for garment, mesh in garments.items()
            if len(mesh.faces)
        ]
        height, width = cells[0].picture.shape[:2]
        picture = scene.picture(parts) if garments else text_card("", _UNKNOWN, (width, height))
        cells.append(GridCell(picture))
    return cells


def _scene(scan: SegmentedScan, body: BodyState, meshes: Sequence[np.ndarray]) -> Scene:
    front = facing_direction(body.pose[:3])
    low = min(float(part[:, 2].min()) for part in meshes)
    return fit_scene(Scene(front=front, floor_z=low), meshes)
