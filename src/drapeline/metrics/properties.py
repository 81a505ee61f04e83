"""A tailor's measures of a garment at rest, taken on its mesh: lengths, neckline, width.

They are shares of the wearer's limbs, so that the same cut has the same numbers on every body.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import Mesh, edges

# As in table 2 of SMPLicit, which has no garments for the whole body.
CLASSES = ("short upper", "long upper", "short lower", "long lower", "whole body")
COMMON = "common types"  # garments of the types that every model can learn, of whatever class
_LONG = 0.5  # share of the limb
_SIDES = ("left", "right")
_SLEEVE_BELOW_M = 0.25  # a sleeve's cuff hangs no lower than this below the arm
_PLACKET_M = 0.02  # a polo is open in the middle, by less than this to either side


class Property(NamedTuple):
    """A property of garments."""

    title: str  # for captions
    unit: str  # of `scale` times the value
    scale: float  # of the value in captions
    about: str  # what is measured


PROPERTIES = {
    "sleeve": Property(
        "sleeves", "% of the arm", 100, "how far sleeves reach from shoulder (0) to wrist (100)"
    ),
    "hem": Property(
        "length", "% of the torso", 100, "how far the hem is below the neck; the hips are at 100"
    ),
    "leg": Property(
        "length", "% of the leg", 100, "how far the hem is from the hip (0) to the ankle (100)"
    ),
    "neckline": Property(
        "neckline",
        "% of the torso",
        100,
        "how far the neckline's front is below the neck; garments that are open in front have none",
    ),
    "waist": Property(
        "waist", "% of the torso", 100, "how far the upper edge is above the hips (0)"
    ),
    "width": Property("looseness", "mm", 1000, "mean distance of the cloth from the wearer's skin"),
}
_OF_REGION = {
    "upper": ("sleeve", "hem", "neckline", "width"),
    "lower": ("leg", "waist", "width"),
    "whole": ("sleeve", "leg", "neckline", "width"),
}


def properties_of(region: str) -> tuple[str, ...]:
    """Names of what is measured on garments of a region of the body, as in `GARMENT_TYPES`."""
    return _OF_REGION[region]


def measure_properties(
    region: str, garment: Mesh, body: BodyModel, shape: np.ndarray
) -> dict[str, float]:
    """Properties of a garment.

    Args:
        region: of the garment's type, which decides what is measured.
        garment: triangles in the rest pose, the root joint at the origin, metres; not empty.
        body: of the wearer.
        shape: (10,) of the wearer.

    Returns:
        Name -> value; a share, or metres for "width". NaN for what the garment lacks.
    """
    wearer, joints = posed_vertices(body, shape, REST_POSE[None])
    places = dict(zip(JOINT_NAMES, joints[0].astype(np.float64), strict=True))
    measures = {
        "sleeve": lambda: _sleeve(garment.vertices, places),
        "hem": lambda: _below_neck(garment.vertices[:, 2].min(), places),
        "leg": lambda: _leg(garment.vertices, places),
        "neckline": lambda: _neckline(garment, places),
        "waist": lambda: 1 - _below_neck(garment.vertices[:, 2].max(), places),
        "width": lambda: _width(garment, wearer[0], body.faces),
    }
    return {name: float(measures[name]()) for name in properties_of(region)}


def _below_neck(height: float, places: Mapping[str, np.ndarray]) -> float:
    """0 at the height of the neck's joint, 1 at the hips'."""
    neck, hips = places["neck"][2], _mean(places, "hip")[2]
    return (neck - height) / (neck - hips)


def _sleeve(vertices: np.ndarray, places: Mapping[str, np.ndarray]) -> float:
    shares = []
    for side in _SIDES:
        shoulder, wrist = places[f"{side}_shoulder"], places[f"{side}_wrist"]
        beside = vertices[vertices[:, 2] > shoulder[2] - _SLEEVE_BELOW_M]
        shares.append(_reach(beside, shoulder, wrist))
    return float(np.mean(shares))


def _leg(vertices: np.ndarray, places: Mapping[str, np.ndarray]) -> float:
    """Mean over both sides of the body of how far the hem there goes down the leg."""
    hip, ankle = _mean(places, "hip")[2], _mean(places, "ankle")[2]
    halves = [vertices[sign * vertices[:, 0] >= 0, 2] for sign in (1, -1)]
    lowest = np.mean([half.min() for half in halves if len(half)])
    return (hip - lowest) / (hip - ankle)


def _reach(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Shares that points go along a limb from its start (0) to its end (1); never below 0."""
    way = end - start
    return float(((points - start) @ way / (way @ way)).max(initial=0.0))


def _neckline(garment: Mesh, places: Mapping[str, np.ndarray]) -> float:
    """Highest point of the garment's front, where a polo's placket is not in the way."""
    back = places["neck"][1]
    heights = [
        front[:, 2].max()
        for at in (0.0, -_PLACKET_M, _PLACKET_M)
        if len(front := _section(garment, at, back))
    ]
    return _below_neck(np.mean(heights[1:]), places) if len(heights) == 3 else np.nan


def _section(garment: Mesh, x: float, back: float) -> np.ndarray:
    """(S, 3) where edges in front of y = back cross the plane at x."""
    start, end = garment.vertices[edges(garment.faces)].swapaxes(0, 1).astype(np.float64)
    crossing = (start[:, 0] < x) != (end[:, 0] < x)
    start, end = start[crossing], end[crossing]
    share = (x - start[:, :1]) / (end[:, :1] - start[:, :1])
    section = start + share * (end - start)
    return section[section[:, 1] < back]


def _width(garment: Mesh, wearer: np.ndarray, faces: np.ndarray) -> float:
    place, _ = closest_points(garment.vertices, wearer, faces)
    return np.linalg.norm(garment.vertices - place, axis=1).mean()


def _mean(places: Mapping[str, np.ndarray], joint: str) -> np.ndarray:
    return (places[f"left_{joint}"] + places[f"right_{joint}"]) / 2


def scan_class(region: str, properties: Mapping[str, float]) -> str:
    """The class that garments in scans are compared by.

    Args:
        region: of the garment's type, as in `GARMENT_TYPES`.
    """
    if region == "whole":
        return CLASSES[-1]
    reach = properties["sleeve" if region == "upper" else "leg"]
    return f"{'long' if reach >= _LONG else 'short'} {region}"
