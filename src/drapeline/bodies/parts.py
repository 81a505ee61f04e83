"""Parts of a body that can collide with one another, and the mesh data that finding out takes."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from drapeline.bodies.model import BodyModel
from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import edges

TORSO = ("pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar")
LIMBS = {
    "upper_arm": ("shoulder",),
    "forearm": ("elbow",),
    "hand": ("wrist", "hand"),
    "thigh": ("hip",),
    "shin": ("knee",),
    "foot": ("ankle", "foot"),
}
PART_JOINTS = {
    "torso": TORSO,
    "head": ("neck", "head"),
    **{
        f"{side}_{limb}": tuple(f"{side}_{joint}" for joint in joints)
        for side in ("left", "right")
        for limb, joints in LIMBS.items()
    },
}
PART_NAMES = tuple(PART_JOINTS)

# Flesh beside a joint folds and an arm lies against the chest: overlaps there may be pressed apart
# by this much ...
FOLD_LIMIT_M = 0.06
# ... while for all other parts a deeper overlap means two solids in one place.
TOUCH_LIMIT_M = 0.03


@dataclass(frozen=True)
class Pair:
    """Two parts that may collide, and how deep a collision can be solved."""

    first: str
    second: str
    limit_m: float


def _pairs() -> tuple[Pair, ...]:
    folds = [("head", "torso")]
    touches = [
        # Cloth lies between thighs, and would be caught between thighs that overlap more deeply.
        ("left_thigh", "right_thigh"),
        ("left_hand", "right_hand"),
        ("left_forearm", "right_forearm"),
        ("left_shin", "right_shin"),
        ("left_foot", "right_foot"),
    ]
    for side, other in (("left", "right"), ("right", "left")):
        folds += [
            (f"{side}_upper_arm", "torso"),
            (f"{side}_forearm", "torso"),
            (f"{side}_forearm", f"{side}_upper_arm"),
            (f"{side}_thigh", "torso"),
            (f"{side}_shin", f"{side}_thigh"),
        ]
        for limb in ("forearm", "hand"):
            touches.append((f"{side}_{limb}", "head"))
            touches += [
                (f"{side}_{limb}", f"{leg}_{segment}")
                for leg in ("left", "right")
                for segment in ("thigh", "shin")
            ]
            touches.append((f"{side}_{limb}", f"{other}_upper_arm"))
        touches += [
            (f"{side}_hand", "torso"),
            (f"{side}_hand", f"{other}_forearm"),
            (f"{side}_hand", f"{side}_upper_arm"),
            (f"{side}_upper_arm", "head"),
            (f"{side}_shin", f"{other}_thigh"),
            (f"{side}_foot", f"{other}_shin"),
            (f"{side}_foot", f"{side}_thigh"),
            (f"{side}_foot", "torso"),
            (f"{side}_shin", "torso"),
        ]
    return (
        *(Pair(a, b, FOLD_LIMIT_M) for a, b in folds),
        *(Pair(a, b, TOUCH_LIMIT_M) for a, b in touches),
    )


PAIRS = _pairs()


@dataclass(frozen=True)
class BodyParts:
    """What does not change with the pose about a body's mesh and its parts.

    Attributes:
        faces: (F, 3).
        part_vertices: ids of each part's vertices.
        part_edges: (E', 2) edges within each part.
        part_faces: (F', 3) faces with two or three corners in each part.
        faces_of: (V, F) sparse, with ones where a face has a vertex.
        neighbours: (V, V) sparse adjacency with ones on the diagonal.
        seam: (V, P) bool, vertices within two rings of each part: where parts join, their
            closeness means nothing.
    """

    faces: np.ndarray
    part_vertices: tuple[np.ndarray, ...]
    part_edges: tuple[np.ndarray, ...]
    part_faces: tuple[np.ndarray, ...]
    faces_of: csr_matrix
    neighbours: csr_matrix
    seam: np.ndarray

    def around(self, ids: np.ndarray) -> np.ndarray:
        """Vertices `ids` (n,) and those that share an edge with one of them, sorted."""
        starts = self.neighbours.indptr[ids]
        counts = self.neighbours.indptr[ids + 1] - starts
        # Places of all entries of these rows; slicing the matrix takes several times as long.
        first = np.cumsum(counts) - counts
        places = np.arange(counts.sum()) + np.repeat(starts - first, counts)
        return np.unique(self.neighbours.indices[places])


def part_of_joint() -> np.ndarray:
    """(24,) index into `PART_NAMES` of the part that each joint moves."""
    owner = {joint: i for i, joints in enumerate(PART_JOINTS.values()) for joint in joints}
    return np.array([owner[name] for name in JOINT_NAMES])


def body_parts(body: BodyModel) -> BodyParts:
    """Parts and adjacency of a body."""
    count, faces = len(body.v_template), body.faces
    part = part_of_joint()[body.segmentation]
    pairs = edges(faces)
    ones = np.ones(faces.size, dtype=np.float32)
    rows = np.arange(len(faces)).repeat(3)
    around = np.concatenate([pairs, pairs[:, ::-1], np.arange(count)[:, None].repeat(2, 1)])
    parts = range(len(PART_NAMES))
    neighbours = csr_matrix(
        (np.ones(len(around), dtype=np.float32), around.T), shape=(count, count)
    )
    member = np.eye(len(PART_NAMES), dtype=np.float32)[part]
    return BodyParts(
        faces,
        tuple(np.flatnonzero(part == p) for p in parts),
        tuple(pairs[(part[pairs] == p).all(axis=1)] for p in parts),
        tuple(faces[(part[faces] == p).sum(axis=1) >= 2] for p in parts),
        csr_matrix((ones, (faces.ravel(), rows)), shape=(count, len(faces))),
        neighbours,
        neighbours @ (neighbours @ member) > 0,
    )
