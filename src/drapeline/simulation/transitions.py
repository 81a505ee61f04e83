"""What the body does before and during a simulation: shape, then pose, then the sequence."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.sequence import BodySequence, body_sequence_vertices
from drapeline.frames import REST_POSE

_LEAD_FRAMES = 4.0
_CHUNK = 32


def transition_poses(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """Poses (count + 1, 72) from the rest pose towards a sequence's first frame (CLOTH3D 3.3).

    Joints turn by quaternion interpolation, starting at rest, and run into the first frame at the
    sequence's own speed, so that the cloth is not kicked when it starts. Unlike in the
    paper, the root joint is at once where it is a few frames before the sequence: a body that lies
    down or turns round in less than a second would fling what it wears.

    Args:
        first, second: (72,) the first two poses of the sequence, axis-angle in radians.
        count: frames between the rest pose, which comes first, and `first`, which comes next.
    """
    share = _smoothstep(np.arange(count + 1) / (count + 1))
    lead = _lead(count + 1 - np.arange(count + 1))
    rest, start, follow = (
        Rotation.from_rotvec(np.array(pose).reshape(24, 3)) for pose in (REST_POSE, first, second)
    )
    way = (rest.inv() * start).as_rotvec()
    turn = (start.inv() * follow).as_rotvec()  # (24, 3) per frame
    poses = np.zeros((count + 1, 24, 3))
    for row in range(count + 1):
        behind = -lead[row] * turn
        path = rest * Rotation.from_rotvec(share[row] * way)
        poses[row] = (path * Rotation.from_rotvec(share[row] * behind)).as_rotvec()
        poses[row, 0] = (start[0] * Rotation.from_rotvec(behind[0])).as_rotvec()
    return poses.reshape(count + 1, 72)


def transition_path(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """Root positions (count + 1, 3) that come to `first` (3,) at the sequence's speed."""
    return first - _lead(count + 1 - np.arange(count + 1))[:, None] * (second - first)


def _smoothstep(u: np.ndarray) -> np.ndarray:
    return u * u * (3 - 2 * u)


def _lead(frames_left: np.ndarray) -> np.ndarray:
    """Frames of constant speed before the start, fading out after a few."""
    return _LEAD_FRAMES * (1 - np.exp(-frames_left / _LEAD_FRAMES))


def body_frames(
    body: BodyModel,
    record: BodySequence,
    garment_shape: np.ndarray,
    *,
    shape_frames: int,
    pose_frames: int,
) -> Iterator[np.ndarray]:
    """World vertices (V, 3) of every simulated frame, transitions first.

    Frame 0 is the body that the garments were made for, in rest pose. Over `shape_frames` it
    takes the wearer's shape, over `pose_frames` the sequence's first pose; the sequence follows.

    Args:
        garment_shape: (10,) shape plus tightness.
    """
    poses, path = _transition(record, pose_frames)
    rest = [
        posed_vertices(body, shape, poses[:1], path[:1])[0][0]
        for shape in (garment_shape, record.shape)
    ]
    for step in range(shape_frames + 1):
        u = np.float32(step / shape_frames)
        share = float(u * u) * (3 - 2 * float(u))  # NumPy 1 and 2 promote plain floats alike
        yield (1 - share) * rest[0] + share * rest[1]
    moving = posed_vertices(body, record.shape, poses[1:], path[1:])[0]
    # Self-collision corrections of the first frame come in gradually.
    fixed = record.fix_frame == 0
    share = _smoothstep(np.arange(1, pose_frames + 1) / (pose_frames + 1))
    moving[:, record.fix_vertex[fixed]] += (
        share[:, None, None] * record.fix_delta[fixed][None]
    ).astype(np.float32)
    yield from moving
    for start in range(0, len(record.poses), _CHUNK):
        part = slice(start, min(start + _CHUNK, len(record.poses)))
        yield from body_sequence_vertices(body, record, world=True, frames=part)


def rising_floor(lowest_m: np.ndarray, cloth_m: float, count: int) -> np.ndarray:
    """Heights (count,) of the floor in each frame; it lies at 0 once the sequence has begun.

    Garments and bodies at rest may reach through it where the sequence begins on hands and knees.
    So it begins beneath them, and rises during the transition, always beneath the body.

    Args:
        lowest_m: (L,) height of the lowest point of the body in each frame of the transition.
        cloth_m: that of the cloth in the first one.
        count: frames of the transition and the sequence.
    """
    lead = len(lowest_m)
    rising = min(cloth_m, 0.0) * (1 - _smoothstep(np.arange(lead) / lead))
    heights = np.zeros(count)
    heights[:lead] = np.minimum(rising, lowest_m)
    return heights


def place_at_start(points: np.ndarray, record: BodySequence, pose_frames: int) -> np.ndarray:
    """Where points of the body at rest, or on it, are in frame 0.

    Args:
        points: (P, 3) metres, relative to the root joint, in the rest pose.
        record: the body in motion.
        pose_frames: of the transition.

    Returns:
        (P, 3) float32 metres in the world.
    """
    poses, path = _transition(record, pose_frames)
    root, rest = (Rotation.from_rotvec(np.array(pose[:3])) for pose in (poses[0], REST_POSE))
    return ((root * rest.inv()).apply(points) + path[0]).astype(np.float32)


def _transition(record: BodySequence, count: int) -> tuple[np.ndarray, np.ndarray]:
    trans = np.asarray(record.trans, dtype=np.float64)
    follow = min(1, len(trans) - 1)
    poses = transition_poses(record.poses[0], record.poses[follow], count)
    return poses, transition_path(trans[0], trans[follow], count)
