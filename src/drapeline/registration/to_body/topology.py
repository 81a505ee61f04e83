"""The two topologies of the super-resolved body and what else does not change with its shape."""

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from drapeline.bodies.model import posed_vertices
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.outfits.garment_types import GARMENTS, SKIRTS
from drapeline.registration.to_body.inner_legs import Smoother, skirt_topology
from drapeline.registration.to_body.segments import garment_variability, segment_body
from drapeline.registration.to_body.super_body import SuperBody
from drapeline.storage import load_npz, save_npz

TOPOLOGIES = ("body", "skirt")  # index = code of a topology


def topology_codes(garments: np.ndarray) -> np.ndarray:
    """(N,) indices into `GARMENTS` -> (N,) int64 indices into `TOPOLOGIES`."""
    return np.array([name in SKIRTS for name in GARMENTS], dtype=np.int64)[garments]


@dataclass(frozen=True)
class Topology:
    """Meshes on V vertices.

    Attributes:
        faces: (F, 3) int32, the body's own.
        skirt_faces: (F2, 3) int32, legs joined; the last `joining` of them are the new ones.
        joining: () int32.
        inner_leg: (V,) bool, vertices that are smoothed for skirts.
        segments: (V,) int32, 0 to 20.
        corners, shares: (V, 3) int32 and (V, 3) float64: places on the mesh of the body's file,
            for carrying further arrays over; see `super_body.interpolation`.
        rest: (V, 3) float32 mean of both genders in the rest pose, metres.
    """

    faces: np.ndarray
    skirt_faces: np.ndarray
    joining: np.ndarray
    inner_leg: np.ndarray
    segments: np.ndarray
    corners: np.ndarray
    shares: np.ndarray
    rest: np.ndarray

    def faces_of(self, garment: str) -> np.ndarray:
        """(F, 3) faces to use with a garment's type."""
        return self.skirt_faces if garment in SKIRTS else self.faces

    @cached_property
    def smoother(self) -> Smoother:
        """Smoothing of the inner legs."""
        return Smoother(self.skirt_faces, self.inner_leg)


def build_topology(body: SuperBody) -> Topology:
    """Derive both topologies and the segments from the bodies' mean in the rest pose.

    Raises:
        InputError: the legs cannot be joined.
    """
    posed = [posed_vertices(b, np.zeros(10), REST_POSE[None]) for b in body.bodies.values()]
    rest = np.mean([vertices[0] for vertices, _ in posed], axis=0).astype(np.float64)
    joints = np.mean([places[0] for _, places in posed], axis=0)
    hips = float(joints[[JOINT_NAMES.index(f"{s}_hip") for s in ("left", "right")], 2].mean())
    try:
        skirt = skirt_topology(rest, body.faces, hips)
    except ValueError as error:
        names = " and ".join(b.name for b in body.bodies.values())
        raise InputError(f"{names}: {error}, expected two legs apart") from error
    variability = garment_variability(rest, joints)
    return Topology(
        faces=body.faces,
        skirt_faces=skirt.faces,
        joining=np.int32(skirt.added),
        inner_leg=skirt.inner_leg,
        segments=segment_body(rest, body.faces, skirt.faces, variability),
        corners=body.corners,
        shares=body.shares,
        rest=rest.astype(np.float32),
    )


def skirt_body(topology: Topology, vertices: np.ndarray) -> np.ndarray:
    """Smooth the inner legs of a body in the rest pose, for skirts and dresses.

    Args:
        topology: of the body.
        vertices: (V, 3) of any shape.

    Returns:
        (V, 3) of the same type: vertices outside `inner_leg` unchanged.
    """
    return topology.smoother(vertices)


def save_topology(path: str | Path, topology: Topology) -> None:
    """Write a topology as `.npz`."""
    save_npz(path, **{f.name: getattr(topology, f.name) for f in fields(topology)})


_ARRAYS = {
    "faces": "int<v * 3",
    "skirt_faces": "int<v * 3",
    "joining": "int",
    "inner_leg": "bool v",
    "segments": "int v",
    "corners": "int v 3",
    "shares": "float v 3",
    "rest": "float v 3",
}


def load_topology(path: str | Path) -> Topology:
    """Read a topology.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    return Topology(**load_npz(path, _ARRAYS))
