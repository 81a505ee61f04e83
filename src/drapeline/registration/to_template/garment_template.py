"""Templates of garment types, as in Garment4D: the mesh that all garments of a type are brought to.

They are made with our own generator or of a user's mesh.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import Mesh, boundary_loops, triangulate
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.garment_types import GARMENT_TYPES, GARMENTS
from drapeline.outfits.generate import make_outfit
from drapeline.outfits.templates import Templates
from drapeline.outfits.user_garment import load_user_garment
from drapeline.storage import load_record, save_record

# The openings of each type, in the order of their numbers. Cuffs are where sleeves end, or armholes
# where there are none. The edge of a jacket runs along hem, front and neck.
LOOP_NAMES = {
    "Tshirt": ("neck", "hem", "left_cuff", "right_cuff"),
    "Top": ("neck", "hem", "left_cuff", "right_cuff"),
    "Trousers": ("waist", "left_leg", "right_leg"),
    "Skirt": ("waist", "hem"),
    "Jumpsuit": ("neck", "left_cuff", "right_cuff", "left_leg", "right_leg"),
    "Dress": ("neck", "hem", "left_cuff", "right_cuff"),
    "Jacket": ("edge", "left_cuff", "right_cuff"),
}


@dataclass(frozen=True)
class GarmentTemplate:
    """A garment whose topology stands for its whole type."""

    # Metres, root frame, in `REST_POSE` on the mean body.
    vertices: Annotated[np.ndarray, "float n 3"]
    faces: Annotated[np.ndarray, "int<n * 3"]  # counter-clockwise seen from outside
    loop: Annotated[np.ndarray, "int n"]  # number of a vertex's opening, -1 within the cloth
    loop_names: tuple[str, ...]  # of the openings, see `LOOP_NAMES`

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        save_record(path, self)


def load_template(path: str | Path) -> GarmentTemplate:
    """Read what `GarmentTemplate.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    return load_record(path, GarmentTemplate)


def named_loops(
    vertices: np.ndarray, loops: list[np.ndarray], names: tuple[str, ...]
) -> dict[str, np.ndarray]:
    """Tell which boundary loop is which opening, by its place on the body.

    Args:
        vertices: (V, 3) in the rest pose, root frame.
        loops: ordered vertex ids of each.
        names: openings of the garment's type.

    Returns:
        Name -> loop. Legs end lowest, and cuffs lie furthest to either side; of the other loops
        the highest is the waist or neck, the lowest the hem, and the longest a jacket's edge.
        Missing openings are left out, and surplus loops are ignored.
    """
    rest = list(loops)
    middle = {id(loop): vertices[loop].mean(axis=0) for loop in loops}
    named = {}

    def take(name: str, axis: int, sign: float) -> None:
        if name in names and rest:
            best = max(range(len(rest)), key=lambda k: sign * middle[id(rest[k])][axis])
            named[name] = rest.pop(best)

    take("waist", 2, 1.0)
    if "left_leg" in names and len(rest) >= 2:
        rest.sort(key=lambda loop: middle[id(loop)][2])
        legs, rest = rest[:2], rest[2:]
        named["right_leg"], named["left_leg"] = sorted(legs, key=lambda loop: middle[id(loop)][0])
    if "left_cuff" in names and len(rest) >= 2:
        take("left_cuff", 0, 1.0)
        take("right_cuff", 0, -1.0)
    take("neck", 2, 1.0)
    take("hem", 2, -1.0)
    if "edge" in names and rest:
        named["edge"] = max(rest, key=len)
    return {name: named[name] for name in names if name in named}


def make_template(
    garment: str,
    templates: Mapping[str, Templates],
    bodies: Mapping[str, BodyModel],
    edge_length_m: float,
) -> GarmentTemplate:
    """Make a template with our own generator, all numbers in the middle of their ranges.

    It is made on the mean female body, which all types fit, or on the male one if there is no
    other: a template provides the topology, and shapes come from the garments brought to it.

    Args:
        garment: one of `GARMENTS`.
        templates, bodies: by gender.
        edge_length_m: mean edge length wanted; about 0.035 gives 600 to 1000 vertices.

    Raises:
        InputError: there is no such type.
    """
    if garment not in GARMENTS:
        raise InputError(
            f"there is no garment type '{garment}', expected one of {', '.join(GARMENTS)}"
        )
    gender = next(gender for gender in GENDERS if gender in templates)
    outfit = make_outfit(
        [(garment, {"elastic": {}, "parameters": _middle_numbers(garment)})],
        templates[gender],
        bodies[gender],
        gender=gender,
        shape=np.zeros(10),
        tightness=np.full(2, np.mean(OutfitRanges().tightness)),
        edge_length_m=edge_length_m,
    )
    made = outfit.garments[0]
    return _template(garment, made.vertices, triangulate(made.faces), garment)


def template_from_mesh(garment: str, path: str | Path, body: BodyModel) -> GarmentTemplate:
    """Make a template of a user's own mesh.

    Args:
        garment: one of `GARMENTS`.
        path: OBJ in metres, Z up, root-relative, on the body's mean shape in rest pose.
        body: the one it lies on.

    Raises:
        InputError: the mesh is unusable as a garment, or has other openings than its type.
    """
    mesh: Mesh = load_user_garment(path, body)
    return _template(garment, mesh.vertices, mesh.triangles, path)


def _template(
    garment: str, vertices: np.ndarray, triangles: np.ndarray, source: object
) -> GarmentTemplate:
    names = LOOP_NAMES[garment]
    loops = boundary_loops(triangles)
    if len(loops) != len(names):
        raise InputError(
            f"{source}: {len(loops)} openings, expected {len(names)} ({', '.join(names)})"
        )
    loop = np.full(len(vertices), -1, dtype=np.int32)
    for name, ids in named_loops(vertices, loops, names).items():
        loop[ids] = names.index(name)
    return GarmentTemplate(
        vertices.astype(np.float32), np.ascontiguousarray(triangles, dtype=np.int32), loop, names
    )


def _middle_numbers(garment: str) -> dict[str, Any]:
    """Every number of a garment in the middle of its range; plain cloth without folds."""
    spans = {field.name: getattr(OutfitRanges(), field.name) for field in fields(OutfitRanges)}
    middle = {
        name: float(np.mean(span))
        for name, span in spans.items()
        if isinstance(span, tuple) and not isinstance(span[0], str)
    }
    garment_type = GARMENT_TYPES[garment]
    parts: dict[str, dict[str, Any]] = {}
    if "upper" in garment_type.parts:
        names: tuple[str, ...] = ("hem", "ease_m", "flare", "shaping", "neck_depth_back_m")
        numbers: dict[str, Any] = {name: middle[name] for name in names}
        numbers |= {"neckline": "crew", "neck_depth_m": middle["neck_depth_crew_m"]}
        numbers |= {"front": "open" if garment_type.outer else "closed"}
        if garment_type.sleeve_chance:
            names = ("drop_m", "sleeve_length", "sleeve_alpha1", "sleeve_alpha2")
            numbers |= {name: middle[name] for name in (*names, "sleeve_offset", "sleeve_w0")}
            numbers |= {"neck_width_m": middle["neck_width_crew_m"]}
        else:
            numbers |= {name: middle[name] for name in ("strap_m", "scye_m")}
            numbers |= {"neck_width_m": middle["strap_neck_m"], "drop_m": middle["top_drop_m"]}
        parts["upper"] = numbers
    if "trousers" in garment_type.parts:
        names = ("waist", "leg_length", "leg_alpha1", "leg_alpha2", "leg_offset", "leg_w0")
        parts["trousers"] = {name: middle[name] for name in (*names, "rise_m", "hip_ease_m")}
    if "skirt" in garment_type.parts:
        names = ("waist", "skirt_length", "skirt_alpha1", "skirt_flutes")
        numbers = {name: middle[name] for name in names}
        numbers |= {"skirt_fullness": 0.0, "skirt_phase": 0.0}
        numbers |= {f"skirt_wander{k}": 0.0 for k in range(4)}
        parts["skirt"] = numbers
    if garment_type.region == "whole":
        parts[garment_type.parts[-1]]["waist"] = middle["sewn_waist"]
    return {**parts, "fullness": 0.0, "fold_seed": 0}
