"""Figures 4 and 5 of the Garment4D paper for our models: from point clouds to garments."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drapeline.dataset.scene_part import BODY_COLOUR
from drapeline.metrics.reconstructions import Reconstruction
from drapeline.metrics.sequence import vertex_errors_mm
from drapeline.rendering.animation import save_animation
from drapeline.rendering.camera import facing_direction
from drapeline.rendering.picture_grid import GridCell, heat_parts, join_pictures, save_grid
from drapeline.rendering.raytracer import ColouredMesh
from drapeline.report.colours import garment_colour
from drapeline.report.models.clouds import cloud_parts
from drapeline.report.models.scene import Scene, fit_scene, share_scale
from drapeline.rule_log import progress

HEAT_SPAN_MM = 80.0
STEP_COLUMNS = (
    "(a) input cloud",
    "(b) canonical garment",
    "(c) interpolated LBS",
    "(d) reconstruction",
    "(e) ground truth",
    "error of (c)",
    "error of (d)",
)
_MOVING_SIZE = (340, 456)  # 480 pixels high with the titles


def plot_steps(path: str | Path, cases: Sequence[tuple[Reconstruction, Sequence[int]]]) -> None:
    """Figure 4: a row per frame, from the cloud to the garment, with errors where truth is known.

    Captions give mean errors over the vertices in mm. The canonical garment stands in the first
    row of its sequence, its error in the second, the registered one in the third.

    Args:
        path: the PNG.
        cases: sequences, each with the indices of those of its frames to show.
    """
    rows, labels = [], []
    for case, frames in progress(cases, label="steps"):
        scenes = _scenes(case, frames)
        for row, (frame, scene) in enumerate(zip(frames, scenes, strict=True)):
            rows.append(step_cells(case, frame, row, scene))
            labels.append(f"{case.garment}\n{case.name}\nframe {case.number[frame]}")
    known = any(len(case.true) for case, _ in cases)
    columns = STEP_COLUMNS if known else STEP_COLUMNS[:4]
    save_grid(path, rows, columns=columns, labels=labels, heat_mm=HEAT_SPAN_MM if known else None)


def plot_results(path: str | Path, cases: Sequence[tuple[Reconstruction, Sequence[int]]]) -> None:
    """Figure 5: clouds and, below them, what is reconstructed; a column per frame.

    Args:
        path: the PNG.
        cases: sequences, each with the indices of those of its frames to show.
    """
    rows, labels = [], []
    for case, frames in progress(cases, label="results"):
        pairs = list(zip(_scenes(case, frames), frames, strict=True))
        rows += [
            [GridCell(s.picture(cloud_parts(case.points[f], case.labels[f], s))) for s, f in pairs],
            [
                GridCell(s.picture(_dress(case, f, case.final[f])), f"frame {case.number[f]}")
                for s, f in pairs
            ],
        ]
        labels += [f"{case.garment}\n{case.name}\ninput", "\nreconstruction"]
    save_grid(path, rows, labels=labels)


def animate_steps(path: str | Path, case: Reconstruction, *, frame_ms: float = 1000 / 15) -> None:
    """Animate a sequence: input, interpolated LBS, reconstruction, ground truth.

    Args:
        path: the animated PNG.
        case: shown whole, from the side that its wearer faces in the first frame.
        frame_ms: time that each frame is shown, in milliseconds.
    """
    columns = ("input cloud", "interpolated LBS", "reconstruction", "ground truth")
    first = Scene(front=facing_direction(case.root_rotation[0]))
    highest = case.body + [0, 0, 1] * case.root_height[:, None, None]
    first = fit_scene(replace(first, floor_z=0.0), [highest.reshape(-1, 3)], _MOVING_SIZE)
    steps = [case.proposal, case.final, *([case.true] if len(case.true) else [])]
    pictures = []
    for frame in progress(range(len(case.final)), label="animation"):
        scene = replace(first, floor_z=-float(case.root_height[frame]))
        parts = [cloud_parts(case.points[frame], case.labels[frame], scene)]
        parts += [_dress(case, frame, garment[frame]) for garment in steps]
        shown = [scene.picture(each, _MOVING_SIZE, samples=8) for each in parts]
        pictures.append(join_pictures(shown, columns[: len(shown)]))
    save_animation(path, pictures, frame_ms)


def spread_frames(count: int, shown: int) -> list[int]:
    """Indices of at most `shown` of `count` frames, evenly spread."""
    shown = min(shown, count)
    return [round((k + 0.5) * count / shown - 0.5) for k in range(shown)]


def step_cells(case: Reconstruction, frame: int, row: int, scene: Scene) -> list[GridCell | None]:
    """The cells of one frame of figure 4; `row` counts the shown frames of the sequence."""
    cells = [
        GridCell(scene.picture(cloud_parts(case.points[frame], case.labels[frame], scene))),
        _canonical_cell(case, row),
        GridCell(scene.picture(_dress(case, frame, case.proposal[frame]))),
        GridCell(scene.picture(_dress(case, frame, case.final[frame]))),
    ]
    if not len(case.true):
        return cells
    cells.append(GridCell(scene.picture(_dress(case, frame, case.true[frame]))))
    wearer = ColouredMesh(case.body[frame], case.body_faces, BODY_COLOUR)
    for vertices in (case.proposal[frame], case.final[frame]):
        error = vertex_errors_mm(vertices, case.true[frame])
        heat = heat_parts(vertices, case.faces, error[case.faces].mean(axis=1), HEAT_SPAN_MM)
        cells.append(GridCell(scene.picture([wearer, *heat]), f"{error.mean():.1f} mm"))
    return cells


def _canonical_cell(case: Reconstruction, row: int) -> GridCell | None:
    if row > 2 or (row > 0 and not len(case.true_canonical)):
        return None
    standing = Scene(floor_z=float(case.rest_body[:, 2].min()))
    scene = fit_scene(standing, [case.rest_body, case.canonical])
    if row == 1:
        error = vertex_errors_mm(case.canonical, case.true_canonical)
        wearer = ColouredMesh(case.rest_body, case.body_faces, BODY_COLOUR)
        of_faces = error[case.faces].mean(axis=1)
        heat = heat_parts(case.canonical, case.faces, of_faces, HEAT_SPAN_MM)
        return GridCell(scene.picture([wearer, *heat]), f"its error: {error.mean():.1f} mm")
    shown = case.true_canonical if row == 2 else case.canonical
    wearer = ColouredMesh(case.rest_body, case.body_faces, BODY_COLOUR)
    garment = ColouredMesh(shown, case.faces, garment_colour(case.garment))
    return GridCell(scene.picture([wearer, garment]), "registered" if row == 2 else "")


def _scenes(case: Reconstruction, frames: Sequence[int]) -> list[Scene]:
    """Each frame seen from where its wearer faces, in the middle, all at one scale."""
    scenes = []
    for frame in frames:
        front, height = facing_direction(case.root_rotation[frame]), float(case.root_height[frame])
        worn = [case.body[frame], case.proposal[frame], case.final[frame]]
        scenes.append(fit_scene(Scene(front=front, floor_z=-height), worn))
    return share_scale(scenes)


def _dress(case: Reconstruction, frame: int, garment: np.ndarray) -> list[ColouredMesh]:
    """Put a posed garment (N, 3) on its wearer."""
    return [
        ColouredMesh(case.body[frame], case.body_faces, BODY_COLOUR),
        ColouredMesh(garment, case.faces, garment_colour(case.garment)),
    ]
