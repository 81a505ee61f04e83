"""The worst frame of a simulation that was not accepted, and what in it is wrong."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.dataset.record import EXTRAS
from drapeline.geometry.crossings import Crossings
from drapeline.geometry.mesh import edges, triangulate
from drapeline.geometry.moving_surface import MovingSheet, MovingSurface
from drapeline.geometry.point_cache import PointCache
from drapeline.outfits.openings import WornOpenings
from drapeline.outfits.outfit import Garment
from drapeline.storage import load_npz, save_npz

FILE = "worst_frame.npz"
_REACH_M = 0.03  # beneath another garment
_LONG, _SHORT = 1.25, 0.75  # of an edge's length at rest
# Beginning of a reason -> the measure by which a frame is the worst, and whether the lowest is.
_MEASURES = {
    "inside": ("inside_open_share", False),
    "depth_m": ("depth_open_m", False),
    "stretch_low": ("stretch_p01", True),
    "stretch_high": ("stretch_p99", False),
    "slip_m": ("slip_m", False),
    "lost_openings": ("lost_openings", False),
    "layer_share": ("layer_share", False),
    "self_share": ("self_share", False),
    "acceleration": ("acceleration_m_s2", False),
}


class WorstFrame(NamedTuple):
    """What is kept of a rejected sample.

    Attributes:
        frame: its number in the sequence.
        root_rotation: (3,) axis-angle of the root joint, rad.
        body: (B, 3) root-relative metres.
        body_faces: (F, 3).
        garments: name -> vertices (V, 3), triangles (F, 3), and which vertices are wrong (V,) bool.
    """

    frame: int
    root_rotation: np.ndarray
    body: np.ndarray
    body_faces: np.ndarray
    garments: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


def find_worst_frame(health: dict[str, np.ndarray], reason: str) -> int:
    """Number of the frame that is the worst by the measure which a reason begins with.

    Args:
        health: measure -> (N, garments) or (N,).
    """
    measure, lowest = next(
        (found for start, found in _MEASURES.items() if reason.startswith(start)),
        ("inside_share", False),
    )
    values = health[measure if measure in health else next(iter(health))]
    values = np.nan_to_num(-values if lowest else values, nan=-np.inf)
    return int(values.reshape(len(values), -1).max(axis=1).argmax())


def write_worst_frame(
    folder: Path,
    simulation: Path,
    frame: int,
    reason: str,
    root_rotation: np.ndarray,
    body: np.ndarray,
    joints: np.ndarray,
    rest_joints: np.ndarray,
    body_faces: np.ndarray,
    garments: Sequence[Garment],
) -> None:
    """Write `extras/worst_frame.npz` of a sample.

    Args:
        folder: of the sample.
        simulation: with `{Garment}.f32`.
        frame: as `find_worst_frame` gives it.
        reason: why the sample was not accepted.
        root_rotation: (3,) axis-angle, rad.
        body, joints: (B, 3), (24, 3) in that frame, root-relative metres.
        rest_joints: (24, 3) of the body at rest.
        garments: from inner to outer.
    """
    cloths = []
    for garment in garments:
        with PointCache(simulation / f"{garment.name}.f32", len(garment.vertices)) as cache:
            cloths.append(cache.frames(frame, frame + 1)[0])
    wrong = _wrong(reason, cloths, garments, body, (rest_joints, joints), body_faces)
    arrays = {
        "frame": frame,
        "root_rotation": root_rotation,
        "body": body,
        "body_faces": body_faces,
    }
    for garment, cloth, marked in zip(garments, cloths, wrong, strict=True):
        arrays |= {
            f"{garment.name}/vertices": cloth,
            f"{garment.name}/faces": triangulate(garment.faces),
            f"{garment.name}/wrong": marked,
        }
    save_npz(folder / EXTRAS / FILE, **arrays)


def read_worst_frame(folder: str | Path) -> WorstFrame | None:
    """What `write_worst_frame` wrote; None where there is nothing.

    Raises:
        InputError: the file is damaged.
    """
    path = Path(folder) / EXTRAS / FILE
    if not path.is_file():
        return None
    forms = {
        "frame": "int",
        "root_rotation": "float 3",
        "body": "float b 3",
        "body_faces": "int<b f 3",
    }
    forms |= {"*/vertices": "float * 3", "*/faces": "int * 3", "*/wrong": "bool *"}
    arrays = load_npz(path, forms)
    names = [key.partition("/")[0] for key in arrays if key.endswith("/vertices")]
    return WorstFrame(
        int(arrays["frame"]),
        arrays["root_rotation"],
        arrays["body"],
        arrays["body_faces"],
        {
            name: (arrays[f"{name}/vertices"], arrays[f"{name}/faces"], arrays[f"{name}/wrong"])
            for name in names
        },
    )


def _wrong(
    reason: str,
    cloths: Sequence[np.ndarray],
    garments: Sequence[Garment],
    body: np.ndarray,
    joints: tuple[np.ndarray, np.ndarray],
    body_faces: np.ndarray,
) -> list[np.ndarray]:
    """Which vertices of each garment the reason is about."""
    if reason.startswith("stretch"):
        return [_strained(g, cloth) for g, cloth in zip(garments, cloths, strict=True)]
    if reason.startswith("self_share"):
        crossings = Crossings(cloths, [garment.faces for garment in garments])
        corners = crossings.corners(crossings.pairs_through(cloths))
        marked = np.zeros(sum(map(len, cloths)), dtype=bool)
        marked[corners] = True
        return np.split(marked, np.cumsum([len(cloth) for cloth in cloths])[:-1])
    if reason.startswith("layer_share"):
        return [_beneath(number, cloths, garments) for number in range(len(cloths))]
    if reason.startswith("lost_openings"):
        return [
            _at_lost_openings(g, cloth, *joints) for g, cloth in zip(garments, cloths, strict=True)
        ]
    if reason.startswith(("inside", "depth")):
        surface = MovingSurface(body, body_faces)
        return [surface.locate(cloth)[1] for cloth in cloths]
    return [np.zeros(len(cloth), dtype=bool) for cloth in cloths]


def _strained(garment: Garment, cloth: np.ndarray) -> np.ndarray:
    pairs = edges(garment.faces)
    now, rest = (
        np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        for points in (cloth, garment.vertices)
    )
    gathered = (garment.elastic[pairs] > 0).any(axis=1)
    ratio = np.where(gathered, 1.0, now / rest)
    marked = np.zeros(len(cloth), dtype=bool)
    marked[pairs[(ratio < _SHORT) | (ratio > _LONG)]] = True
    return marked


def _at_lost_openings(
    garment: Garment, cloth: np.ndarray, rest_joints: np.ndarray, joints: np.ndarray
) -> np.ndarray:
    marked = np.zeros(len(cloth), dtype=bool)
    worn = WornOpenings.at_rest(garment.vertices, garment.faces, rest_joints)
    for loop in worn.lost(cloth, joints):
        marked[loop] = True
    return marked


def _beneath(number: int, cloths: Sequence[np.ndarray], garments: Sequence[Garment]) -> np.ndarray:
    marked = np.zeros(len(cloths[number]), dtype=bool)
    for inner, garment in zip(cloths[:number], garments, strict=False):
        sheet = MovingSheet(inner, triangulate(garment.faces))
        marked |= sheet.beneath(cloths[number], _REACH_M)
    return marked
