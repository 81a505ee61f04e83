"""Dressed people in motion, as those are told who say where their cloth is."""

import numpy as np
from scipy.spatial.transform import Rotation

from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.models.contract import MovingPerson
from drapeline.seeding import rng_for
from toys.tiny_sample import tube

SHAPE = np.array([0.5, -0.3, *np.zeros(8)])


def person_in(pose: np.ndarray) -> MovingPerson:
    """In a skirt and a t-shirt, after two frames of something else."""
    sheets = {"Skirt": tube(0.3, -0.4, 0.05), "Tshirt": tube(0.25, 0.0, 0.5)}
    poses = np.stack([REST_POSE + 0.3, REST_POSE - 0.3, pose])
    trans = np.array([[0.0, 0.0, 0.9], [0.1, 0.0, 0.9], [0.2, 0.1, 1.0]])
    rest = {name: Mesh(one.vertices, triangulate(one.faces)) for name, one in sheets.items()}
    return MovingPerson("00001", "female", SHAPE, poses, trans, rest)


def standing_person() -> MovingPerson:
    """In the rest pose."""
    return person_in(REST_POSE)


def turned_person(turn: Rotation) -> MovingPerson:
    """In the rest pose, turned as a whole."""
    pose = REST_POSE.copy()
    pose[:3] = (turn * Rotation.from_rotvec(pose[:3])).as_rotvec()
    return person_in(pose)


def bent_person() -> MovingPerson:
    """In a pose in which every joint is turned a little."""
    return person_in(REST_POSE + rng_for(0, "bent").normal(0, 0.2, 72))
