"""Pictures of Garment4D: figures 4, 5 and 7 of the paper for our models, and the garment spaces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from matplotlib.ticker import PercentFormatter
from PIL import Image, ImageDraw, ImageFont
from trimesh.creation import icosahedron

from drapeline.dataset.labels import LABELS
from drapeline.geometry.mesh import edges
from drapeline.metrics.reconstructions import Reconstruction
from drapeline.metrics.sequence import vertex_errors_mm
from drapeline.outfits.garment_types import GARMENTS
from drapeline.rendering.animated_png import save_moving
from drapeline.rendering.camera import Camera, look_at
from drapeline.rendering.picture_grid import Cell, heat_parts, save_sheet
from drapeline.rendering.raytracer import ColouredMesh, raytrace
from drapeline.report.models.gcvae_figures import (
    GARMENT_COLOURS,
    front_of,
    type_colour,
)
from drapeline.report.style import (
    QUIET,
    legend_above,
    saved_figure,
    say_nothing_to_show,
)
from drapeline.rule_log import progress

HEAT_SPAN_MM = 80.0
_BACKDROP = 0.93
_SKIN, _GREY = (0.83, 0.69, 0.6), (0.8, 0.8, 0.81)
_INK, _PAPER, _RING = (34, 34, 34), (255, 255, 255), (213, 94, 0)
_SIZE = (250, 290)
_DISTANCE_M = 7.0
_TURN_DEG = 24.0  # the camera stands this far to the side of where the body faces
_RISE = 0.12
_MARGIN = 1.12
_FLOOR_SHARE = 0.44  # of a picture's height lies between its middle and the floor
_SURFACE_M2 = 2.2  # of a dressed body, roughly: what a cloud's points are spread over
_POINT_SHARE = 0.37  # radius of a drawn point, of the distance between them
_DEPTH_LEVELS, _HAZE = 6, 0.6  # the farthest points are drawn paler, that the near ones stand out
_CLOSE_M = 0.75  # what the height of a close-up spans
_DEVIATIONS = (-2, -1, 0, 1, 2)


@dataclass(frozen=True)
class Scene:
    """Where a picture is taken from.

    Attributes:
        target: (3,) middle of the picture, metres above the floor in Z.
        front: (x, y) direction that the wearer faces.
        height_m: what the height of the picture spans at the target.
        floor_z: height of the floor in the frame of the meshes.
        turn_deg: how far to the side of the front the camera stands.
    """

    target: tuple[float, float, float] = (0.0, 0.0, 0.9)
    front: tuple[float, float] = (0.0, -1.0)
    height_m: float = 2.1
    floor_z: float = 0.0
    turn_deg: float = _TURN_DEG

    def camera(self, size: tuple[int, int]) -> Camera:
        """The camera for pictures of a size (width, height)."""
        angle = np.arctan2(self.front[1], self.front[0]) + np.radians(self.turn_deg)
        direction = np.array([np.cos(angle), np.sin(angle), _RISE])
        direction /= np.linalg.norm(direction)
        target = np.array(self.target)
        return look_at(
            target + _DISTANCE_M * direction,
            target,
            focal_px=size[1] * _DISTANCE_M / self.height_m,
            size=size,
        )

    def picture(
        self, parts: Sequence[ColouredMesh], size: tuple[int, int] = _SIZE, samples: int = 10
    ) -> np.ndarray:
        """(height, width, 3) uint8 studio picture of meshes."""
        lift = np.array([0.0, 0.0, -self.floor_z])
        lifted = [replace(part, vertices=part.vertices + lift) for part in parts]
        return raytrace(lifted, self.camera(size), floor_centre=self.target[:2], samples=samples)


def fitted(scene: Scene, meshes: Sequence[np.ndarray], size: tuple[int, int] = _SIZE) -> Scene:
    """The scene from the same side, as wide as meshes (V, 3) and the floor below them need."""
    points = np.concatenate(meshes) - [0, 0, scene.floor_z]
    right = scene.camera(size).axes[0]
    axes = np.array([right, [-right[1], right[0], 0.0]])  # level: across the picture, into it
    along = points @ axes.T
    x, y, _ = (along.min(axis=0) + along.max(axis=0)) / 2 @ axes
    across, deep = np.ptp(along, axis=0)
    nearer = _DISTANCE_M / (_DISTANCE_M - deep / 2)  # what is near looks larger
    height = _MARGIN * nearer * float(max(points[:, 2].max(), across * size[1] / size[0]))
    return replace(scene, target=(float(x), float(y), _FLOOR_SHARE * height), height_m=height)


def cloud_parts(points: np.ndarray, labels: np.ndarray, scene: Scene) -> list[ColouredMesh]:
    """A cloud (P, 3) as small balls in the colours of its labels (P,), paler in the distance."""
    colours = [_SKIN if name not in GARMENTS else type_colour(name) for name in LABELS]
    depth = points @ scene.camera(_SIZE).axes[2]
    share = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-9)
    level = np.minimum((share * _DEPTH_LEVELS).astype(int), _DEPTH_LEVELS - 1)
    radius = _POINT_SHARE * np.sqrt(_SURFACE_M2 / len(points))
    parts = []
    for label, far in sorted(set(zip(labels.tolist(), level.tolist(), strict=True))):
        haze = _HAZE * far / (_DEPTH_LEVELS - 1)
        colour = (1 - haze) * np.array(colours[label]) + haze * _BACKDROP
        parts.append(
            ColouredMesh(*_balls(points[(labels == label) & (level == far)], radius), colour)
        )
    return parts


def _balls(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Icosahedra, which smooth normals make round."""
    ball = icosahedron()
    vertices = np.asarray(points, dtype=np.float64)[:, None] + radius * ball.vertices
    first = len(ball.vertices) * np.arange(len(points))[:, None, None]
    return vertices.reshape(-1, 3), (first + ball.faces).reshape(-1, 3)


STEP_COLUMNS = (
    "(a) input cloud",
    "(b) canonical garment",
    "(c) interpolated LBS",
    "(d) reconstruction",
    "(e) ground truth",
    "error of (c)",
    "error of (d)",
)


def spread(count: int, shown: int) -> list[int]:
    """At most `shown` of `count` frames, evenly spread."""
    shown = min(shown, count)
    return [round((k + 0.5) * count / shown - 0.5) for k in range(shown)]


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
    save_sheet(path, rows, columns=columns, labels=labels, heat_mm=HEAT_SPAN_MM if known else None)


def step_cells(case: Reconstruction, frame: int, row: int, scene: Scene) -> list[Cell | None]:
    """The cells of one frame of figure 4; `row` counts the shown frames of the sequence."""
    cells = [
        Cell(scene.picture(cloud_parts(case.points[frame], case.labels[frame], scene))),
        _canonical_cell(case, row),
        Cell(scene.picture(_worn(case, frame, case.proposal[frame]))),
        Cell(scene.picture(_worn(case, frame, case.final[frame]))),
    ]
    if not len(case.true):
        return cells
    cells.append(Cell(scene.picture(_worn(case, frame, case.true[frame]))))
    wearer = ColouredMesh(case.body[frame], case.body_faces, _GREY)
    for vertices in (case.proposal[frame], case.final[frame]):
        error = vertex_errors_mm(vertices, case.true[frame])
        heat = heat_parts(vertices, case.faces, error[case.faces].mean(axis=1), HEAT_SPAN_MM)
        cells.append(Cell(scene.picture([wearer, *heat]), f"{error.mean():.1f} mm"))
    return cells


def _canonical_cell(case: Reconstruction, row: int) -> Cell | None:
    if row > 2 or (row > 0 and not len(case.true_canonical)):
        return None
    standing = Scene(floor_z=float(case.rest_body[:, 2].min()))
    scene = fitted(standing, [case.rest_body, case.canonical])
    if row == 1:
        error = vertex_errors_mm(case.canonical, case.true_canonical)
        wearer = ColouredMesh(case.rest_body, case.body_faces, _GREY)
        of_faces = error[case.faces].mean(axis=1)
        heat = heat_parts(case.canonical, case.faces, of_faces, HEAT_SPAN_MM)
        return Cell(scene.picture([wearer, *heat]), f"its error: {error.mean():.1f} mm")
    shown = case.true_canonical if row == 2 else case.canonical
    wearer = ColouredMesh(case.rest_body, case.body_faces, _SKIN)
    garment = ColouredMesh(shown, case.faces, type_colour(case.garment))
    return Cell(scene.picture([wearer, garment]), "registered" if row == 2 else "")


def _scenes(case: Reconstruction, frames: Sequence[int]) -> list[Scene]:
    """Each frame from where its wearer faces, all of one scale, each in the middle."""
    found = []
    for frame in frames:
        front, height = front_of(case.root_rotation[frame]), float(case.root_height[frame])
        worn = [case.body[frame], case.proposal[frame], case.final[frame]]
        found.append(fitted(Scene(front=front, floor_z=-height), worn))
    scale = max(scene.height_m for scene in found)
    target_z = _FLOOR_SHARE * scale
    return [replace(s, height_m=scale, target=(*s.target[:2], target_z)) for s in found]


def _worn(case: Reconstruction, frame: int, garment: np.ndarray) -> list[ColouredMesh]:
    """A posed garment (N, 3) on its wearer."""
    return [
        ColouredMesh(case.body[frame], case.body_faces, _SKIN),
        ColouredMesh(garment, case.faces, type_colour(case.garment)),
    ]


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
            [Cell(s.picture(cloud_parts(case.points[f], case.labels[f], s))) for s, f in pairs],
            [
                Cell(s.picture(_worn(case, f, case.final[f])), f"frame {case.number[f]}")
                for s, f in pairs
            ],
        ]
        labels += [f"{case.garment}\n{case.name}\ninput", "\nreconstruction"]
    save_sheet(path, rows, labels=labels)


def animate_steps(path: str | Path, case: Reconstruction, *, frame_ms: int = 66) -> None:
    """A sequence as a moving picture: input, interpolated LBS, reconstruction, ground truth.

    Args:
        path: the animated PNG.
        case: all its frames are shown, from the side that the first one's wearer faces.
        frame_ms: time that each is shown.
    """
    size = (220, 270)
    columns = ("input cloud", "interpolated LBS", "reconstruction", "ground truth")
    first = Scene(front=front_of(case.root_rotation[0]))
    highest = case.body + [0, 0, 1] * case.root_height[:, None, None]
    first = fitted(replace(first, floor_z=0.0), [highest.reshape(-1, 3)], size)
    steps = [case.proposal, case.final, *([case.true] if len(case.true) else [])]
    pictures = []
    for frame in progress(range(len(case.final)), label="animation"):
        scene = replace(first, floor_z=-float(case.root_height[frame]))
        parts = [cloud_parts(case.points[frame], case.labels[frame], scene)]
        parts += [_worn(case, frame, garment[frame]) for garment in steps]
        shown = [scene.picture(each, size, samples=6) for each in parts]
        pictures.append(_titled(shown, columns[: len(shown)]))
    save_moving(path, pictures, frame_ms)


def _titled(pictures: Sequence[np.ndarray], titles: Sequence[str]) -> np.ndarray:
    """Pictures side by side under their titles."""
    font, top = ImageFont.load_default(14), 24
    row = np.concatenate(pictures, axis=1)
    image = Image.new("RGB", (row.shape[1], row.shape[0] + top), _PAPER)
    image.paste(Image.fromarray(row), (0, top))
    draw = ImageDraw.Draw(image)
    for index, title in enumerate(titles):
        draw.text((index * pictures[0].shape[1] + 5, 4), title, _INK, font=font)
    return np.asarray(image)


class SkinnedTwice(NamedTuple):
    """A garment posed by skinning weights of one body vertex, and of many.

    Attributes:
        label: what it is called in the figure; a newline breaks the line.
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
        cases: a row each.
        neighbours: K of the interpolated weights.
    """
    rows = [_neighbour_cells(case) for case in progress(cases, label="skinned twice")]
    save_sheet(
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


def _neighbour_cells(case: SkinnedTwice) -> list[Cell]:
    place = case.nearest[worst_place(case.canonical, case.nearest, case.faces)]
    outwards = (place - case.nearest.mean(axis=0))[:2]
    lifted = place + [0, 0, case.root_height]
    towards = Scene(
        front=(float(outwards[0]), float(outwards[1])), floor_z=-case.root_height, turn_deg=0.0
    )
    far = fitted(towards, [case.body, case.nearest, case.interpolated])
    near = replace(far, target=tuple(lifted.tolist()), height_m=_CLOSE_M)
    cells = []
    for vertices in (case.nearest, case.interpolated):
        parts = [
            ColouredMesh(case.body, case.body_faces, _SKIN),
            ColouredMesh(vertices, case.faces, type_colour(case.garment)),
        ]
        cells.append(Cell(_ringed(far.picture(parts), far, lifted)))
        cells.append(Cell(near.picture(parts)))
    return cells


def _ringed(picture: np.ndarray, scene: Scene, place: np.ndarray) -> np.ndarray:
    """The picture with a ring around what its close-up shows."""
    height, width = picture.shape[:2]
    (x, y), _ = scene.camera((width, height)).project(place)
    radius = 0.36 * _CLOSE_M / scene.height_m * height
    # Drawn large and shrunk: Pillow's own ellipses have steps.
    image = Image.fromarray(picture).resize((4 * width, 4 * height), Image.Resampling.NEAREST)
    box = [4 * v for v in (x - radius, y - radius, x + radius, y + radius)]
    ImageDraw.Draw(image).ellipse(box, outline=_RING, width=7)
    return np.asarray(image.resize((width, height), Image.Resampling.BOX))


class Space(Protocol):
    """Principal components of canonical garments, as `registration.garment_space` fits them."""

    faces: np.ndarray
    mean: np.ndarray
    components: np.ndarray
    explained: np.ndarray


def plot_explained(path: str | Path, spaces: Mapping[str, Space]) -> None:
    """Share of the training variance that the first components of each type hold together."""
    with saved_figure(path, 6.4, 3.6) as (_, (axes,)):
        if not spaces:
            say_nothing_to_show(axes, "There are no garment spaces.")
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
        legend_above(axes)


def plot_modes(path: str | Path, spaces: Mapping[str, Space], *, modes: int = 3) -> None:
    """First principal components of each type: from -2 to 2 standard deviations from the mean.

    Args:
        path: the PNG.
        spaces: type -> its components, in metres per standard deviation.
        modes: rows of each type, at most.
    """
    rows, labels, size = [], [], (210, 210)
    for name, space in spaces.items():
        count = min(modes, len(space.components))
        shapes = [
            [space.mean + d * space.components[mode] for d in _DEVIATIONS] for mode in range(count)
        ]
        points = np.concatenate(shapes).reshape(-1, 3)
        scene = fitted(Scene(floor_z=float(points[:, 2].min())), [points], size)
        # Lifted high above the floor, on which a garment alone would cast an odd shadow.
        lifted = (*scene.target[:2], scene.target[2] + 10)
        scene = replace(scene, floor_z=scene.floor_z - 10, target=lifted)
        for mode in progress(range(count), label=name):
            parts = [ColouredMesh(v, space.faces, type_colour(name)) for v in shapes[mode]]
            rows.append([Cell(scene.picture([part], size)) for part in parts])
            labels.append(f"{name}\nmode {mode + 1}\n{100 * space.explained[mode]:.1f} %")
    columns = ["mean" if d == 0 else f"{d:+d} std. dev." for d in _DEVIATIONS]
    save_sheet(path, rows, columns=columns, labels=labels)
