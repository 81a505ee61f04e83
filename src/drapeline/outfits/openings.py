"""Openings of a garment, and the limbs of the body that pass through them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import boundary_loops, loop_count

SIDES = ("left", "right")
_LIMB_M = 0.12  # around the narrowest opening that a limb passes; smaller ones are buttonholes
_ROOM = 1.5  # openings are taken to be wider, so that a body of other proportions passes as well
_LEGS = {f"{side} leg" for side in SIDES}
_OPEN_FRONT_M = 0.3  # height of an edge that runs from the neck to the hem
_COLLAR = 1.0  # a collar may reach up to the ears
_EDGE = 1e-4  # by which a triangle of a fan reaches over its neighbour, of its own size


def limb_openings(vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Boundary loops, ids of vertices, that are wide enough for a limb."""
    loops = boundary_loops(faces)
    return [loop for loop in loops if _length(vertices[loop]) > _LIMB_M]


def limb_bones(joints: np.ndarray, *, beyond_head: float = 0.0) -> dict[str, np.ndarray]:
    """Bones of each limb (n, 2, 3), from joint to joint.

    Arms and legs go on for what sleeves and hems may cover.

    Args:
        joints: (24, 3) metres.
        beyond_head: how far the trunk goes on above the head's joint, in lengths of the neck.
    """

    def line(*names: str, beyond: float = 0) -> np.ndarray:
        places = [joints[JOINT_NAMES.index(name)] for name in names]
        places.append(places[-1] + beyond * (places[-1] - places[-2]))
        return np.stack([places[:-1], places[1:]], axis=1).astype(np.float64)

    hips = [line("pelvis", f"{side}_hip") for side in SIDES]
    spine = ("spine1", "spine2", "spine3")
    trunk = line("pelvis", *spine, "neck", "head", beyond=beyond_head)
    bones = {"trunk": np.concatenate([trunk, *hips])}
    for side in SIDES:
        arm = (f"{side}_{joint}" for joint in ("collar", "shoulder", "elbow", "wrist", "hand"))
        bones[f"{side} arm"] = line("spine3", *arm, beyond=2)
        leg = (f"{side}_{joint}" for joint in ("hip", "knee", "ankle"))
        bones[f"{side} leg"] = line("pelvis", *leg, beyond=0.6)
    return bones


def passing_limbs(bones: dict[str, np.ndarray], opening: np.ndarray) -> set[str]:
    """Names of the limbs that pass through an opening.

    Args:
        bones: as `limb_bones` gives them.
        opening: (m, 3) metres, the loop around it.
    """
    return {name for name, limb in bones.items() if _passes(limb, opening.astype(np.float64))}


@dataclass(frozen=True)
class WornOpenings:
    """The openings of a garment that a limb passes at rest.

    Hems that both legs pass do not count: legs may be drawn up into a skirt. Nor does the edge of
    an open jacket, all around its fronts, neck and hem; and where edges touch, openings cannot be
    told apart, so there are none.
    """

    loops: Sequence[np.ndarray]  # ids of vertices

    @classmethod
    def at_rest(cls, vertices: np.ndarray, faces: np.ndarray, joints: np.ndarray) -> "WornOpenings":
        """Those of a garment with vertices (V, 3) on a body with joints (24, 3), in metres."""
        if loop_count(faces) < 0:  # rims that touch one another, as of decoded garments
            return cls([])
        bones = limb_bones(joints, beyond_head=_COLLAR)
        passed = [
            (loop, passing_limbs(bones, vertices[loop]))
            for loop in limb_openings(vertices, faces)
            if np.ptp(vertices[loop, 2]) < _OPEN_FRONT_M
        ]
        return cls([loop for loop, limbs in passed if limbs and limbs != _LEGS])

    def lost(self, vertices: np.ndarray, joints: np.ndarray) -> list[np.ndarray]:
        """The loops among them that no limb passes in another pose, as of trousers that fell off.

        Args:
            vertices: (V, 3) metres.
            joints: (24, 3) in the same frame.
        """
        bones = limb_bones(joints, beyond_head=_COLLAR)
        return [loop for loop in self.loops if not passing_limbs(bones, vertices[loop])]


def _passes(bones: np.ndarray, loop: np.ndarray) -> bool:
    """Whether a bone (n, 2, 3) crosses the fan of triangles that spans a loop (m, 3)."""
    centre = loop.mean(axis=0)
    a = _ROOM * (loop - centre)
    b = np.roll(a, -1, axis=0)
    normals = np.cross(a, b)
    start, end = np.moveaxis(bones - centre, 1, 0)
    before, after = start @ normals.T, end @ normals.T
    bone, face = np.nonzero((before < 0) != (after < 0))
    share = before[bone, face] / (before - after)[bone, face]
    point = start[bone] + share[:, None] * (end - start)[bone]
    square = np.einsum("fc,fc->f", normals[face], normals[face])
    u = np.einsum("fc,fc->f", np.cross(point, b[face]), normals[face]) / square
    v = np.einsum("fc,fc->f", np.cross(a[face], point), normals[face]) / square
    # Bones in the middle of a symmetric loop lie on an edge of the fan.
    return bool(((u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1)).any())


def _length(loop: np.ndarray) -> float:
    return float(np.linalg.norm(loop - np.roll(loop, -1, axis=0), axis=1).sum())
