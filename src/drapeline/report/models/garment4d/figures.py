"""Figures of Garment4D: from clouds to garments, its spaces, ablations and sweeps (4 to 10)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.ticker import FixedLocator, NullLocator, PercentFormatter
from PIL import Image, ImageDraw

from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart
from drapeline.geometry.mesh import Mesh, edges
from drapeline.job import Job
from drapeline.metrics.garment4d import COMPARED, MODEL
from drapeline.metrics.predictions import Reconstruction, first_reconstructions, load_reconstruction
from drapeline.metrics.registry import metric, variant
from drapeline.metrics.sequence import vertex_errors_mm
from drapeline.outfits.garment_types import BODY, LABELS, TABLE_TYPES
from drapeline.registration.to_template.garment_space import GarmentSpace, load_space
from drapeline.rendering.camera import facing_direction
from drapeline.rendering.pictures import (
    GridCell,
    heat_parts,
    join_pictures,
    save_animation,
    save_grid,
)
from drapeline.rendering.raytracer import ColouredMesh, ray_share
from drapeline.report.colours import BLUE, GARMENT_COLOURS, GREEN, INK, QUIET, SKY, garment_colour
from drapeline.report.dataset.viewer import write_parts
from drapeline.report.models.scene import (
    Scene,
    cloud_parts,
    fit_scene,
    share_scale,
    spread_frames,
    worn_parts,
)
from drapeline.report.style import label_bar, place_legend_above, saved_figure, show_message
from drapeline.report.tables import read_test_metrics
from drapeline.rule_log import progress
from drapeline.schema import Table

HEAT_SPAN_MM = 80.0
STEP_COLUMNS = (
    "(a) input cloud",
    "(b) canonical garment",
    "(c) proposal",
    "(d) reconstruction",
    "(e) ground truth",
    "error of (c)",
    "error of (d)",
)
_MOVING_SIZE = (340, 456)  # 480 pixels high with the titles
_BASELINE = "#b4b8be"
_DASHED: dict[str, Any] = {"linewidth": 1, "linestyle": (0, (4, 3))}
_ABLATIONS = (
    *("lbs", "mgn", "mgn_pulled", "no_body_encoder", "no_transformer", "released_loss", "pulled"),
    *("nearest_weights", "posed", "ours"),
)
_RING = (213, 94, 0)
_CLOSE_M = 0.75  # what the height of a close-up spans
_DEVIATIONS = (-2, -1, 0, 1, 2)
_SIZE = (210, 210)


def plot_steps(path: str | Path, cases: Sequence[tuple[Reconstruction, Sequence[int]]]) -> None:
    """Figure 4: a row per frame, from the cloud to the garment, with errors where truth is known.

    Captions give mean errors over the vertices in mm. The canonical garment stands in the first
    row of its sequence, its error in the second, the registered one in the third. Cases have the
    indices of the frames to show.
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
    """Figure 5: clouds and, below them, what is reconstructed; a column per frame shown."""
    rows, labels = [], []
    for case, frames in progress(cases, label="results"):
        pairs = list(zip(_scenes(case, frames), frames, strict=True))
        rows += [
            [GridCell(s.picture(cloud_parts(case.points[f], case.labels[f], s))) for s, f in pairs],
            [
                GridCell(s.picture(_worn(case, f, case.final[f])), f"frame {case.number[f]}")
                for s, f in pairs
            ],
        ]
        labels += [f"{case.garment}\n{case.name}\ninput", "\nreconstruction"]
    save_grid(path, rows, labels=labels)


def animate_steps(path: str | Path, case: Reconstruction, *, frame_ms: float = 1000 / 15) -> None:
    """Animate a sequence: input, proposal, reconstruction, ground truth.

    Args:
        path: the animated PNG.
        case: shown whole, from the side that its wearer faces in the first frame.
        frame_ms: time that each frame is shown, in milliseconds.
    """
    columns = ("input cloud", "proposal", "reconstruction", "ground truth")
    first = Scene(front=facing_direction(case.root_rotation[0]))
    highest = case.body + [0, 0, 1] * case.root_height[:, None, None]
    first = fit_scene(replace(first, floor_z=0.0), [highest.reshape(-1, 3)], _MOVING_SIZE)
    steps = [case.proposal, case.final, *([case.true] if len(case.true) else [])]
    pictures = []
    for frame in progress(range(len(case.final)), label="animation"):
        scene = replace(first, floor_z=-float(case.root_height[frame]))
        parts = [cloud_parts(case.points[frame], case.labels[frame], scene)]
        parts += [_worn(case, frame, garment[frame]) for garment in steps]
        shown = [scene.picture(each, _MOVING_SIZE, samples=8) for each in parts]
        pictures.append(join_pictures(shown, columns[: len(shown)]))
    save_animation(path, pictures, frame_ms)


def write_page(path: str | Path, case: Reconstruction) -> None:
    """Write the result over its points as a page to turn and play; the person walks on the spot."""
    label, count = LABELS.index(case.garment), len(case.final)

    def part(
        name: str, colour: tuple[float, float, float], frames: np.ndarray, faces: np.ndarray
    ) -> ScenePart:
        raised = frames + [0, 0, 1] * case.root_height[:, None, None]
        mesh = Mesh(raised[0], faces)
        return ScenePart(name, mesh, colour, lambda start, stop: raised[start:stop], count)

    def points(own: np.ndarray) -> np.ndarray:
        """As many of some points (F, P) in every frame, repeated where there are fewer."""
        most = max(int(own.sum(axis=1).max()), 1)
        # Of none, the middle of the body stands for them, where nobody sees it.
        middles = case.body.mean(axis=1, keepdims=True)
        frames = zip(case.points, own, middles, strict=True)
        some = [cloud[chosen] if chosen.any() else middle for cloud, chosen, middle in frames]
        return np.stack([np.resize(each, (most, 3)) for each in some])

    none, its = np.zeros((0, 3), dtype=np.int32), case.labels == label
    write_parts(
        path,
        case.name,
        [f"{case.garment} reconstructed from {case.points.shape[1]} points in each frame"],
        [
            part(BODY, BODY_COLOUR, case.body, case.body_faces),
            part(case.garment, PLAIN_COLOUR, case.final, case.faces),
            part("Points taken for it", to_rgb(GARMENT_COLOURS[case.garment]), points(its), none),
            part("Other points", to_rgb(QUIET), points(~its), none),
        ],
    )


def step_cells(case: Reconstruction, frame: int, row: int, scene: Scene) -> list[GridCell | None]:
    """The cells of one frame of figure 4; `row` counts the shown frames of the sequence."""
    cells = [
        GridCell(scene.picture(cloud_parts(case.points[frame], case.labels[frame], scene))),
        _canonical_cell(case, row),
        GridCell(scene.picture(_worn(case, frame, case.proposal[frame]))),
        GridCell(scene.picture(_worn(case, frame, case.final[frame]))),
    ]
    if not len(case.true):
        return cells
    cells.append(GridCell(scene.picture(_worn(case, frame, case.true[frame]))))
    wearer = worn_parts(Mesh(case.body[frame], case.body_faces), {})
    for vertices in (case.proposal[frame], case.final[frame]):
        error = vertex_errors_mm(vertices, case.true[frame])
        heat = heat_parts(vertices, case.faces, error[case.faces].mean(axis=1), HEAT_SPAN_MM)
        cells.append(GridCell(scene.picture([*wearer, *heat]), f"{error.mean():.1f} mm"))
    return cells


def _canonical_cell(case: Reconstruction, row: int) -> GridCell | None:
    if row > 2 or (row > 0 and not len(case.true_canonical)):
        return None
    wearer = Mesh(case.rest_body, case.body_faces)
    standing = Scene(floor_z=float(case.rest_body[:, 2].min()))
    scene = fit_scene(standing, [case.rest_body, case.canonical])
    if row == 1:
        error = vertex_errors_mm(case.canonical, case.true_canonical)
        of_faces = error[case.faces].mean(axis=1)
        heat = heat_parts(case.canonical, case.faces, of_faces, HEAT_SPAN_MM)
        picture = scene.picture([*worn_parts(wearer, {}), *heat])
        return GridCell(picture, f"its error: {error.mean():.1f} mm")
    shown = case.true_canonical if row == 2 else case.canonical
    parts = worn_parts(wearer, {case.garment: Mesh(shown, case.faces)})
    return GridCell(scene.picture(parts), "registered" if row == 2 else "")


def _scenes(case: Reconstruction, frames: Sequence[int]) -> list[Scene]:
    """Each frame seen from where its wearer faces, in the middle, all at one scale."""
    scenes = []
    for frame in frames:
        front, height = facing_direction(case.root_rotation[frame]), float(case.root_height[frame])
        worn = [case.body[frame], case.proposal[frame], case.final[frame]]
        scenes.append(fit_scene(Scene(front=front, floor_z=-height), worn))
    return share_scale(scenes)


def _worn(case: Reconstruction, frame: int, garment: np.ndarray) -> list[ColouredMesh]:
    """A posed garment (N, 3) on its wearer."""
    wearer = Mesh(case.body[frame], case.body_faces)
    return worn_parts(wearer, {case.garment: Mesh(garment, case.faces)})


class SkinnedTwice(NamedTuple):
    """A garment posed by skinning weights of one body vertex, and of many."""

    label: str  # of its row in the figure; may have several lines
    garment: str
    canonical: np.ndarray  # (N, 3) metres
    faces: np.ndarray  # (n, 3) of the template
    nearest: np.ndarray  # (N, 3) posed with K = 1
    interpolated: np.ndarray  # (N, 3) posed with more neighbours
    body: np.ndarray  # (V, 3) in the same pose
    body_faces: np.ndarray  # (f, 3)
    root_height: float  # metres of the root joint above the floor


def plot_neighbours(path: str | Path, cases: Sequence[SkinnedTwice], neighbours: int) -> None:
    """Figure 7: what K = 1 does to a garment, and what `neighbours` do; a row per case.

    The camera stands before the place where K = 1 deforms the garment most, which is ringed.
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
        wearer = Mesh(case.body, case.body_faces)
        parts = worn_parts(wearer, {case.garment: Mesh(vertices, case.faces)})
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


def plot_explained(path: str | Path, spaces: Mapping[str, GarmentSpace]) -> None:
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


def plot_modes(path: str | Path, spaces: Mapping[str, GarmentSpace], *, modes: int = 3) -> None:
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


def curve(
    measured: Table, prefix: str, garment: str, name: str, ends: Mapping[float, str] | None = None
) -> pd.DataFrame:
    """A metric of the variants `{prefix}_{number}`, by rising number.

    Args:
        measured: rows of the test split, see `read_test_metrics`.
        prefix: such as "neighbours".
        ends: number -> variant that stands for it where none of the prefix does.

    Returns:
        Columns "at", and "value", "low" and "high" as they are shown; no rows if the prefix has
        none.
    """
    rows = _of(measured, garment, name)
    start = f"{prefix}_"
    numbered = rows[rows["variant"].str.startswith(start)]
    found = numbered.assign(at=numbered["variant"].str.removeprefix(start).astype(float))
    if len(found):
        known = set(found["at"])
        beside = {other: at for at, other in (ends or {}).items() if at not in known}
        others = rows[rows["variant"].isin([*beside])]
        found = pd.concat([found, others.assign(at=others["variant"].map(beside))])
    numbers = found[["value", "low", "high"]] * metric(name).scale
    return numbers.assign(at=found["at"]).astype(float).sort_values("at")


def _of(measured: Table, garment: str, name: str) -> Table:
    """Rows of a metric and type, on the samples of all solvers."""
    wanted = {"garment": garment, "metric": name, "source": ""}
    return measured[(measured[[*wanted]] == pd.Series(wanted)).all(axis=1)]


def _value(measured: Table, name: str, garment: str, key: str) -> pd.Series | None:
    found = _of(measured, garment, key)
    found = found[found["variant"] == name]
    return found.iloc[0] if len(found) else None


def _draw_curve(axes: Axes, found: pd.DataFrame, colour: str, label: str) -> None:
    at = found["at"].to_numpy()
    if found["low"].notna().all():
        axes.fill_between(at, found["low"], found["high"], color=colour, alpha=0.14, linewidth=0)
    axes.plot(at, found["value"], color=colour, marker="o", markersize=4.5, label=label)


def plot_neighbour_curve(path: str | Path, measured: Table) -> None:
    """Figure 8: error and time over the number K of body vertices that weights come from."""
    with saved_figure(path, 9.0, 3.4, columns=2) as (_, axes):
        for panel, name in zip(axes, ("vertex_error_mm", "inference_s_per_frame"), strict=True):
            drawn = []
            for garment in TABLE_TYPES:
                found = curve(measured, "neighbours", garment, name)
                if len(found):
                    _draw_curve(panel, found, GARMENT_COLOURS[garment], garment)
                    drawn += found["at"].tolist()
            if not drawn:
                show_message(panel, "Not measured.")
                continue
            panel.set_xscale("log", base=2)
            panel.xaxis.set_major_locator(FixedLocator(sorted(set(drawn))))
            panel.xaxis.set_minor_locator(NullLocator())
            panel.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
            panel.set(xlabel="Neighbours K", ylabel=metric(name).heading, ylim=(0, None))
            panel.grid(axis="y")
            place_legend_above(panel)


# Kinds of worse inputs -> label of the axis, and where on it the sequences are as they are.
_WORSE: dict[str, tuple[str, float | None]] = {
    "missing": ("Points missing (%)", 0.0),
    "accuracy": ("Segmentation accuracy (%)", None),
    "body_noise": ("Noise on poses (mrad)", 0.0),
    "point_noise": ("Noise on points (mm)", 0.0),
    "views": ("Cameras around the person", None),
    "frame_rate": ("Frames per second", 30.0),
}
_MODEL_COLOURS = {"lbs": _BASELINE, "mgn": SKY, "posed": BLUE, "ours": GREEN}


def plot_worse(path: str | Path, measured: Table, kind: str) -> None:
    """Errors of all models over how much worse one kind of input is, for each garment type."""
    label, whole = _WORSE[kind]
    shown = [
        garment
        for garment in TABLE_TYPES
        if any(len(_worse_curve(measured, name, kind, garment, whole)) for name in COMPARED)
    ]
    with saved_figure(path, 9.0, 3.4, columns=max(len(shown), 1)) as (_, axes):
        if not shown:
            show_message(axes[0], "Not measured.")
            return
        for panel, garment in zip(axes, shown, strict=True):
            for name, title in COMPARED.items():
                found = _worse_curve(measured, name, kind, garment, whole)
                if len(found):
                    _draw_curve(panel, found, _MODEL_COLOURS[name], title)
            heading = metric("vertex_error_mm").heading if panel is axes[0] else ""
            panel.set(xlabel=label, ylabel=heading, ylim=(0, None), title=garment)
            panel.grid(axis="y")
        axes[0].legend(frameon=False, fontsize="small")


def _worse_curve(
    measured: Table, name: str, kind: str, garment: str, whole: float | None
) -> pd.DataFrame:
    ends = None if whole is None else {whole: f"{name}_undegraded"}
    return curve(measured, f"{name}_{kind}", garment, "vertex_error_mm", ends)


def plot_ablation(path: str | Path, measured: Table, garment: str) -> None:
    """Figure 6: vertex and acceleration errors of a type without single parts of the model."""
    names = [n for n in _ABLATIONS if _value(measured, n, garment, "vertex_error_mm") is not None]
    with saved_figure(path, 9.0, 0.9 + 0.36 * max(len(names), 3), columns=2) as (_, axes):
        for panel, key in zip(axes, ("vertex_error_mm", "acceleration_error_m_s2"), strict=True):
            if not names:
                show_message(panel, "Not measured.")
                continue
            for place, name in enumerate(names):
                row = _value(measured, name, garment, key)
                if row is not None:
                    _draw_bar(panel, row, place, metric(key).digits)
            first = panel is axes[0]
            titles = [variant(MODEL, name).title for name in names]
            panel.set_yticks(range(len(names)), titles if first else [])
            panel.invert_yaxis()
            panel.set(xlabel=metric(key).heading, title=garment if first else "")
            panel.tick_params(axis="y", length=0)
            panel.margins(x=0.18)
            panel.set_xlim(left=0)
            panel.grid(axis="x")


def _draw_bar(axes: Axes, row: pd.Series, place: int, digits: int) -> None:
    colour = {"posed": BLUE, "ours": GREEN, "lbs": _BASELINE, "mgn": _BASELINE}
    axes.barh(place, row["value"], height=0.62, color=colour.get(row["variant"], SKY))
    measured = not np.isnan(row["high"])
    if measured:
        axes.plot([row["low"], row["high"]], [place, place], color=INK, linewidth=1.2)
    end = row["high"] if measured else row["value"]
    label_bar(axes, end, place, f"{row['value']:.{digits}f}")


def plot_reconstructions(job: Job) -> None:
    """From points to the garment, and reconstructions, as figures 4 and 5 of the paper."""
    printed, ours = zip(*first_reconstructions(job.input.evaluated), strict=True)
    with ray_share(job.params.rays):
        for path, plot, sequences, shown in (
            (job.output.steps, plot_steps, printed, 2),
            (job.output.results, plot_results, ours, 5),
        ):
            cases = map(load_reconstruction, sequences)
            plot(path, [(case, spread_frames(len(case.final), shown)) for case in cases])


_ANIMATED_FRAMES = 24
_PER_FRAME = (
    *("proposal", "final", "true", "points", "labels", "body"),
    *("root_rotation", "root_height", "number"),
)


def animate_reconstruction(job: Job) -> None:
    """The first reconstruction in motion."""
    _, ours = first_reconstructions(job.input.evaluated)[0]
    shown = load_reconstruction(ours)
    frames = {name: getattr(shown, name)[:_ANIMATED_FRAMES] for name in _PER_FRAME}
    with ray_share(job.params.rays):
        animate_steps(job.output[0], replace(shown, **frames))


def plot_spaces(job: Job) -> None:
    """Principal components of each type: how much they explain, and the first ones."""
    spaces = {
        garment: load_space(Path(folder) / "space.npz") for garment, folder in job.input.items()
    }
    plot_explained(job.output.explained, spaces)
    with ray_share(job.params.rays):
        plot_modes(job.output.modes, spaces)


def plot_curves(job: Job) -> None:
    """Figures 6 and 8 to 10 of the paper."""
    rows = read_test_metrics(job.input.metrics, [MODEL])
    plot_ablation(job.output.ablation, rows, job.params.garment)
    plot_neighbour_curve(job.output.neighbours, rows)
    for kind in _WORSE:
        plot_worse(job.output[kind], rows, kind)
