"""Dressed people side by side in motion, as an endless picture."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.geometry.collision import PenetrationResolver
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.outfits.worn import push_over
from drapeline.rendering.camera import Camera, facing_direction, frame_points, look_at
from drapeline.rendering.pictures import save_animation
from drapeline.rendering.raytracer import ColouredMesh, raytrace
from drapeline.report.dataset.paint import paint
from drapeline.rule_log import progress

_BLENDED = 8  # frames over which the end of a loop becomes its beginning
_LOOP_FRAMES = range(40, 61)
LEAST_FRAMES = _LOOP_FRAMES[0] + _BLENDED  # of a sample
_DISTANCE_M = 10.0
_EYE_M = 1.9
_TURN_DEG = 20.0  # people look past the camera by this angle
_GAP_M = 0.05
_MARGIN = 0.03
_COMPARED = 300  # vertices of the body that poses are compared by
_FLOOR_REACH_M = 12.0


@dataclass(frozen=True)
class _MovingPerson:
    """Moves on the spot before the camera."""

    # The body, and garments from the innermost to the outermost, with the vertices of the first
    # frame.
    meshes: Sequence[ColouredMesh]
    moving: Sequence[np.ndarray]  # (N, V, 3) of each mesh, metres, Z up, -Y to the camera

    def looped(self, start: int, frames: int) -> "_MovingPerson":
        """The frames from `start` on, of which the last ones become those before `start`.

        Cloth that would pass through the body or other cloth on this way is kept off it.
        """
        weight = (np.arange(1, _BLENDED + 1) / (_BLENDED + 1))[:, None, None]
        loops = []
        for vertices in self.moving:
            loop = vertices[start : start + frames].copy()
            before = vertices[start - _BLENDED : start]
            loop[-_BLENDED:] = (1 - weight) * loop[-_BLENDED:] + weight * before
            loops.append(loop)
        faces = [triangulate(mesh.faces) for mesh in self.meshes]
        keep_off(loops, faces, range(frames - _BLENDED, frames))
        return _MovingPerson(self.meshes, loops)


def keep_off(
    moving: Sequence[np.ndarray], faces: Sequence[np.ndarray], frames: Iterable[int]
) -> None:
    """Move cloth off the body and off inner cloth in some frames, in place.

    Args:
        moving: (N, V, 3) metres, of the body and of garments from the innermost to the outermost.
        faces: (F, 3) of each.
        frames: numbers of the frames.
    """
    body, *garments = moving
    sheets = list(zip(garments, faces[1:], strict=True))
    averages = [averaging_matrix(sheet, cloth.shape[1]) for cloth, sheet in sheets]
    resolver = PenetrationResolver(body[0], faces[0])
    for frame in frames:
        resolver.move(body[frame])
        worn: list[Mesh] = []
        for (cloth, sheet), average in zip(sheets, averages, strict=True):
            cloth[frame] = resolver.push_out(cloth[frame], average)
            for inner in worn:
                cloth[frame] = push_over(cloth[frame], average, inner)
            worn.append(Mesh(cloth[frame], sheet))


def render_people(
    path: str | Path, folders: Sequence[str | Path], *, size: tuple[int, int] = (900, 340)
) -> None:
    """Write an endless animation of samples side by side, each on the spot, in real time.

    A loop takes 40 to 60 frames, as many as let all samples end most like they begin.

    Args:
        path: `.webp` or `.png`.
        folders: accepted samples, from left to right.
        size: width and height in pixels; all figures fill one of them.

    Raises:
        InputError: a sample is too short, or its files are missing or damaged.
    """
    people = [_read_person(folder) for folder in folders]
    frames, starts = best_loop([person.moving[0] for person in people])
    people = _line_up(
        [person.looped(start, frames) for person, start in zip(people, starts, strict=True)]
    )
    camera = _camera(people, size)
    pictures = [
        raytrace(
            [
                replace(mesh, vertices=vertices[frame])
                for person in people
                for mesh, vertices in zip(person.meshes, person.moving, strict=True)
            ],
            camera,
            floor_reach_m=_FLOOR_REACH_M,
        )
        for frame in progress(range(frames), label="people")
    ]
    save_animation(path, pictures, 1000 / FPS)


def best_loop(moving: Sequence[np.ndarray]) -> tuple[int, list[int]]:
    """Find where motions can be cut to begin again with the least jump, all after as many frames.

    Args:
        moving: (N, V, 3) vertices of each; N may differ.

    Returns:
        The number of frames, and the first frame of each motion.
    """
    best: tuple[float, int, list[int]] = (np.inf, 0, [])
    shortest = min(map(len, moving))
    for frames in _LOOP_FRAMES:
        if frames + _BLENDED > shortest:
            break
        total, starts = 0.0, []
        for vertices in moving:
            seen = vertices[:, :: max(1, vertices.shape[1] // _COMPARED)]
            jump = [
                np.linalg.norm(
                    seen[k - _BLENDED : k] - seen[k + frames - _BLENDED : k + frames], axis=-1
                ).mean()
                for k in range(_BLENDED, len(seen) - frames + 1)
            ]
            starts.append(_BLENDED + int(np.argmin(jump)))
            total += min(jump)
        best = min(best, (total, frames, starts))
    return best[1], best[2]


def _read_person(folder: str | Path) -> _MovingPerson:
    with Sample(folder) as sample:
        count = len(sample)
        if count < LEAST_FRAMES:
            raise InputError(
                f"{folder}: has {count} frames, expected {LEAST_FRAMES} or more for a loop"
            )
        front = facing_direction(sample.info.poses[count // 2, :3])
        turn = np.radians(_TURN_DEG - 90) - np.arctan2(front[1], front[0])
        turned = Rotation.from_euler("z", turn).as_matrix()
        level = sample.root_positions() * [1, 1, 0]
        meshes, moving = [], []
        for part in scene_parts(sample):
            vertices = (part.read(0, count) - level[:, None]) @ turned.T
            meshes.append(paint(part, vertices[0], sample.fabrics.get(part.name)))
            moving.append(vertices.astype(np.float32))
    return _MovingPerson(meshes, moving)


def _line_up(people: Sequence[_MovingPerson]) -> list[_MovingPerson]:
    """Put them side by side, as close as their movements allow, around the origin."""
    spans = [
        (min(v[..., 0].min() for v in p.moving), max(v[..., 0].max() for v in p.moving))
        for p in people
    ]
    total = sum(high - low + _GAP_M for low, high in spans)
    placed, x = [], -total / 2
    for person, (low, high) in zip(people, spans, strict=True):
        shift = np.array([x - low, 0, 0], np.float32)
        placed.append(
            _MovingPerson(person.meshes, [vertices + shift for vertices in person.moving])
        )
        x += high - low + _GAP_M
    return placed


def _camera(people: Sequence[_MovingPerson], size: tuple[int, int]) -> Camera:
    target = np.array([0.0, 0.0, 0.9])
    camera = look_at(np.array([0.0, -_DISTANCE_M, _EYE_M]), target, focal_px=size[0], size=size)
    points = np.concatenate([v.reshape(-1, 3) for p in people for v in p.moving])
    return frame_points([camera], [points], _MARGIN)[0]
