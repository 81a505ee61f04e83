"""`drapeline check`: how well anybody's clothes move, on a body or without one."""

import argparse
import json
import logging
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from drapeline.commands.health_table import health_lines
from drapeline.dataset.moving_meshes import read_moving_meshes
from drapeline.dataset.reader import Sample
from drapeline.dataset.scene_part import ScenePart
from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.outfits.garment_types import BODY, GARMENTS, layered
from drapeline.rule_log import progress
from drapeline.simulation.health import HealthMonitor, summary, watch_mesh
from drapeline.storage import write_json

LOGGER = logging.getLogger("drapeline")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="garments in motion, from inner to outer, perhaps with their body: .glb or .gltf, a"
        " folder with an OBJ for each frame, .pc2 or .mdd beside an OBJ of the same name, .npz"
        " (vertices, faces, and perhaps body_vertices, body_faces), or a sample's folder",
    )
    parser.add_argument(
        "--body",
        metavar="NAME|FILE",
        help="the mesh that is the body, or a file with it (default: one that is called Body)",
    )
    parser.add_argument(
        "--fps", type=float, default=FPS, help=f"frames per second (default: {FPS})"
    )
    parser.add_argument("--json", metavar="FILE", help="where to write the numbers; - for here")


def run(args: argparse.Namespace) -> int:
    """Measure every frame, and print a table.

    Returns:
        Exit status 0.
    """
    if not 0 < args.fps <= 1000:
        raise InputError(f"--fps {args.fps:g}: expected more than 0, and at most 1000")
    with ExitStack() as opened:
        garments, body = _find(args, opened)
        measures = _measure(garments, body, args.fps, _elastics(args.files))
    for words in _about(garments, body, args.fps):
        print(words)
    for line in health_lines(measures):
        print(line)
    if args.json == "-":
        print(json.dumps(measures, indent=2))
    elif args.json:
        write_json(args.json, measures)
    return 0


def _find(args: argparse.Namespace, opened: ExitStack) -> tuple[list[ScenePart], ScenePart | None]:
    """Garments from inner to outer, and the body."""
    parts = [part for file in args.files for part in _read(file, opened, args.fps)]
    wanted = args.body or BODY
    bodies = [part for part in parts if part.name.lower() == wanted.lower()]
    garments = [part for part in parts if part.name.lower() != wanted.lower()]
    names = [part.name for part in garments]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"two meshes are called {twice}, expected a name for each garment")
    if args.body and not bodies:
        if not Path(args.body).exists():
            raise InputError(
                f"--body {args.body}: no file, expected one or one of {', '.join(names)}"
            )
        bodies = _read(args.body, opened, args.fps)
    if len(bodies) > 1:
        raise InputError(f"--body: {len(bodies)} meshes are called {wanted}, expected one")
    if not garments:
        raise InputError(f"{', '.join(args.files)}: has no garment beside {wanted}, expected one")
    if all(part.name in GARMENTS for part in garments):
        order = layered(part.name for part in garments)
        garments.sort(key=lambda part: order.index(part.name))
    counts = {part.name: part.frame_count for part in [*garments, *bodies]}
    if len(set(counts.values())) > 1:
        words = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise InputError(f"different numbers of frames ({words}), expected equal ones")
    return garments, bodies[0] if bodies else None


def _read(file: str, opened: ExitStack, fps: float) -> list[ScenePart]:
    return read_moving_meshes(file, opened, fps=fps)


def _elastics(files: Sequence[str]) -> dict[str, np.ndarray]:
    """Name -> how much of an elastic each vertex has, in samples that tell."""
    found = {}
    for file in files:
        if (Path(file) / "info.mat").is_file():
            with Sample(file) as sample:
                for name in sample.garments:
                    if masks := sample.masks(name):
                        found[name] = masks["elastic"]
    return found


def _measure(
    garments: Sequence[ScenePart],
    body: ScenePart | None,
    fps: float,
    elastics: dict[str, np.ndarray],
) -> dict[str, dict[str, float]]:
    """Garment -> measure -> value."""
    monitor = HealthMonitor(
        [
            # Where a file has no mesh at rest, the first frame stands for it.
            watch_mesh(part.name, part.mesh.vertices, part.mesh.faces, elastics.get(part.name))
            for part in garments
        ],
        None if body is None else body.mesh.triangles,
        fps=fps,
    )
    count = garments[0].frame_count
    frames = zip(*(part.frames() for part in garments), strict=True)
    skin = [None] * count if body is None else body.frames()
    for cloths, surface in progress(zip(frames, skin, strict=True), total=count, label="frames"):
        monitor.add(cloths, surface)
    arrays = monitor.arrays()
    found = {}
    for column, part in enumerate(garments):
        one = {name: values[:, column : column + 1] for name, values in arrays.items()}
        numbers = summary(one)
        found[part.name] = {name: value for name, value in numbers.items() if np.isfinite(value)}
    return found


def _about(garments: Sequence[ScenePart], body: ScenePart | None, fps: float) -> list[str]:
    count = garments[0].frame_count
    where = "without a body" if body is None else f"on {body.name}"
    names = ", ".join(f"{part.name} ({len(part.mesh.vertices)} vertices)" for part in garments)
    return [f"{names} {where}, {count} frames at {fps:g} per second"]
