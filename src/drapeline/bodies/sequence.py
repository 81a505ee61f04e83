"""One sample's body in motion, and its file."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.frames import GENDERS, PARENTS
from drapeline.storage import load_record, save_record


@dataclass(frozen=True)
class ClipLabels:
    """Origin of a motion."""

    sequence: str = ""  # name of the sub-sequence, such as "walk_s0"
    action: str = ""  # such as "walk"; empty if unknown
    subject: str = ""  # who moved; empty if unknown
    source: str = ""  # file the motion was read from
    start_frame: int = 0  # first frame of the sub-sequence in its clip, at 30 fps
    speed: float = 1.0  # seconds of the clip per second of the sub-sequence
    mirrored: bool = False  # whether left and right are exchanged


@dataclass(frozen=True)
class BodySequence:
    """A shaped body in motion, and what self-collision solving did to it."""

    shape: Annotated[np.ndarray, "float 10"]  # float64 shape coefficients, after thinning
    gender: str  # "female" or "male"
    poses: Annotated[np.ndarray, "float n 72"]  # float64 axis-angle, radians
    # World position of the root joint in metres, float64, feet on the floor.
    trans: Annotated[np.ndarray, "float n 3"]
    # "free" of collisions, "solved", "removed" (parts left out), "thinned" or "rejected"; the last
    # that applies.
    outcome: str
    reason: str  # one sentence if rejected, else empty
    thinned: int  # how many times the body was made thinner
    redrawn: int  # how many shapes were given up before this one
    # Joints whose segments take no part in collisions.
    removed_segments: Annotated[np.ndarray, f"int<{len(PARENTS)} *"]
    fix_frame: Annotated[np.ndarray, "int<n m"]  # frames in which vertices are moved
    fix_vertex: Annotated[np.ndarray, "int m"]  # these vertices
    fix_delta: Annotated[np.ndarray, "float m 3"]  # float32 metres, world axes
    collided_frames: int  # frames in which parts overlapped before they were pressed apart
    deepest_m: float  # greatest distance that a vertex was moved, metres
    overlap_share: float  # this and the next: what is left, see `overlap.Overlap`
    overlap_depth_m: float
    penetration_m: float  # this and the next three: see `contact.FloorContact`
    sliding_m_s: float
    hover_s: float
    flight_s: float
    labels: ClipLabels


def untouched_sequence(
    shape: np.ndarray, gender: str, poses: np.ndarray, trans: np.ndarray
) -> BodySequence:
    """A body that moves as it is told: nothing is done about self-collisions.

    Args:
        shape: (10,).
        gender: "female" or "male".
        poses: (N, 72) rad.
        trans: (N, 3) of the root joint, world metres.
    """
    none = np.zeros(0, dtype=np.int64)
    return BodySequence(
        np.asarray(shape, dtype=np.float64),
        gender,
        np.asarray(poses, dtype=np.float64),
        np.asarray(trans, dtype=np.float64),
        outcome="free",
        reason="",
        thinned=0,
        redrawn=0,
        removed_segments=none,
        fix_frame=none,
        fix_vertex=none,
        fix_delta=np.zeros((0, 3), dtype=np.float32),
        collided_frames=0,
        deepest_m=0.0,
        overlap_share=0.0,
        overlap_depth_m=0.0,
        penetration_m=0.0,
        sliding_m_s=0.0,
        hover_s=0.0,
        flight_s=0.0,
        labels=ClipLabels(),
    )


def press_apart(
    vertices: np.ndarray,
    frames: np.ndarray,
    fix_frame: np.ndarray,
    fix_vertex: np.ndarray,
    fix_delta: np.ndarray,
) -> None:
    """Correct self-collisions of a posed body in place.

    Args:
        vertices: (n, V, 3) metres.
        frames: (n,) their numbers, each once.
        fix_frame, fix_vertex, fix_delta: see `BodySequence`.
    """
    row = np.full(max(frames.max(initial=-1), fix_frame.max(initial=-1)) + 1, -1)
    row[frames] = np.arange(len(frames))
    kept = row[fix_frame] >= 0
    vertices[row[fix_frame[kept]], fix_vertex[kept]] += fix_delta[kept]


def body_sequence_vertices(
    body: BodyModel, record: BodySequence, *, world: bool = False, frames: slice = slice(None)
) -> np.ndarray:
    """(n, V, 3) float32 metres: the body's vertices, self-collision corrections included.

    Args:
        body: the model that `record` was made with.
        world: whether to add `trans`; else vertices are relative to the root joint, as garments
            and caches are.
    """
    vertices, _ = posed_vertices(body, record.shape, record.poses[frames])
    chosen = np.arange(len(record.poses))[frames]
    press_apart(vertices, chosen, record.fix_frame, record.fix_vertex, record.fix_delta)
    if world:
        vertices += record.trans[frames, None].astype(np.float32)
    return vertices


def first_frames(record: BodySequence, count: int) -> BodySequence:
    """The first frames of a body in motion; what is said of all of them stays."""
    kept = record.fix_frame < count
    return replace(
        record,
        poses=record.poses[:count],
        trans=record.trans[:count],
        fix_frame=record.fix_frame[kept],
        fix_vertex=record.fix_vertex[kept],
        fix_delta=record.fix_delta[kept],
    )


def collides(body: BodyModel, record: BodySequence) -> np.ndarray:
    """Mask (V,) of the vertices that cloth collides with: all but those of removed segments."""
    return ~np.isin(body.segmentation, record.removed_segments)


def collision_faces(body: BodyModel, record: BodySequence) -> np.ndarray:
    """Faces (F', 3) int32 that cloth collides with."""
    return body.faces[collides(body, record)[body.faces].all(axis=1)]


def save_body_sequence(path: str | Path, record: BodySequence) -> None:
    """Write a `.npz` with one key per field, labels included."""
    save_record(path, record, gender=GENDERS.index(record.gender))


def load_body_sequence(path: str | Path) -> BodySequence:
    """Read what `save_body_sequence` wrote.

    Raises:
        InputError: the file is missing, unreadable or lacks a field.
    """
    record = load_record(path, BodySequence, gender=f"int<{len(GENDERS)}")
    return replace(record, gender=GENDERS[int(record.gender)])
