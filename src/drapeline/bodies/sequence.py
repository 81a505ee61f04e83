"""One sample's body: a shape moving through a sequence, freed of self-collisions."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.storage import load_npz, save_npz


@dataclass(frozen=True)
class BodySequence:
    """A shaped body in motion, and what self-collision solving did to it.

    Attributes:
        shape: (10,) float64 shape coefficients, after thinning.
        gender: 0 female, 1 male.
        poses: (N, 72) float64 axis-angle, radians.
        trans: (N, 3) float64 world position of the root joint in metres, feet on the floor.
        outcome: "free", "solved", "thinned", "removed" or "rejected".
        thinned: how many times the body was made thinner.
        removed_segments: (k,) int32 joints whose segments take no part in collisions.
        fix_frame, fix_vertex: (m,) int32, which vertex is moved in which frame.
        fix_delta: (m, 3) float32 metres, world axes.
        sequence, action, subject, source: the motion's labels.
        start_frame: first frame of this sub-sequence in its source clip, at 30 fps.
    """

    shape: np.ndarray
    gender: int
    poses: np.ndarray
    trans: np.ndarray
    outcome: str
    thinned: int
    removed_segments: np.ndarray
    fix_frame: np.ndarray
    fix_vertex: np.ndarray
    fix_delta: np.ndarray
    sequence: str
    action: str
    subject: str
    source: str
    start_frame: int


def make_body_sequence(
    body: BodyModel,
    shape: np.ndarray,
    poses: np.ndarray,
    trans: np.ndarray,
    *,
    gender: int,
    reference_leg_length_m: float | None = None,
    removable: str = "none",
    sequence: str = "",
    action: str = "",
    subject: str = "",
    source: str = "",
    start_frame: int = 0,
) -> BodySequence:
    """Put a motion on a body and free it of self-collisions (CLOTH3D 3.1).

    Args:
        shape: (10,) shape coefficients.
        poses: (N, 72) axis-angle in radians.
        trans: (N, 3) world position of the motion's own root joint in metres.
        reference_leg_length_m: leg length of the skeleton the motion was recorded on; root
            displacements are scaled by the ratio of leg lengths. None keeps them.
        removable: what the outfit leaves bare and collisions may drop: "none", "hands",
            "forearms" (with hands) or "arms" (with both).
    """
    none = np.zeros(0, dtype=np.int32)
    return BodySequence(
        np.asarray(shape, dtype=np.float64),
        gender,
        poses,
        trans,
        "free",
        0,
        none,
        none,
        none,
        np.zeros((0, 3), dtype=np.float32),
        sequence,
        action,
        subject,
        source,
        start_frame,
    )


def body_sequence_vertices(
    body: BodyModel,
    record: BodySequence,
    *,
    world: bool = False,
    frames: slice = slice(None),
) -> np.ndarray:
    """Rebuild the body's vertices (n, V, 3) float32, self-collision corrections included.

    Root-relative (as garments and caches are) unless `world`, which adds `trans`.
    """
    chosen = np.arange(len(record.poses))[frames]
    vertices, _ = posed_vertices(body, record.shape, record.poses[frames])
    row = np.full(len(record.poses), -1)
    row[chosen] = np.arange(len(chosen))
    kept = row[record.fix_frame] >= 0
    vertices[row[record.fix_frame[kept]], record.fix_vertex[kept]] += record.fix_delta[kept]
    if world:
        vertices += record.trans[frames, None].astype(np.float32)
    return vertices


def collision_faces(body: BodyModel, record: BodySequence) -> np.ndarray:
    """(F', 3) int32 faces that cloth collides with: those of removed segments are left out."""
    gone = np.isin(body.segmentation, record.removed_segments)
    return body.faces[~gone[body.faces].any(axis=1)]


def save_body_sequence(path: str | Path, record: BodySequence) -> None:
    """Write the record as a plain `.npz`, one key per field."""
    save_npz(path, **asdict(record))


def load_body_sequence(path: str | Path) -> BodySequence:
    """Read what `save_body_sequence` wrote.

    Raises:
        InputError: the file is missing, unreadable or lacks a field.
    """
    fields = BodySequence.__dataclass_fields__
    arrays = load_npz(path, *fields)
    plain = {str: str, int: int}
    return BodySequence(
        **{
            name: plain[field.type](arrays[name]) if field.type in plain else arrays[name]
            for name, field in fields.items()
        }
    )
