"""Generation of outfits (CLOTH3D 3.2): numbers are drawn, garments made of them for a body."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body, signed_tightness, tightness_shape
from drapeline.geometry.mesh import Mesh, mean_edge_length, triangulate
from drapeline.geometry.signed_distance import SignedDistance
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.outfits.distributions import (
    OutfitRanges,
    sample_skirt,
    sample_trousers,
    sample_upper,
    uniform,
)
from drapeline.outfits.dress_form import DressForm
from drapeline.outfits.fabrics import FABRICS, MEASURED_FABRICS, fabrics_of
from drapeline.outfits.fit import (
    RESIZE_EDGE_M,
    RESIZE_PASSES,
    drape_on_form,
    lay_on,
    lay_over,
    leave_body,
    resize,
)
from drapeline.outfits.garment_types import GARMENT_TYPES, layered
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.patterns.cutting import cut_garment
from drapeline.outfits.patterns.panels import Pattern, separator
from drapeline.outfits.prints import draw_texture
from drapeline.outfits.settings import OwnGarment
from drapeline.outfits.templates import Templates
from drapeline.outfits.user_garment import load_user_garment, rims
from drapeline.outfits.worn import push_over
from drapeline.seeding import rng_for

BODY_GAP_M = 0.004
_BEYOND_EDGES = 1.5  # by which jackets keep off what the open edges of other garments go on to
_LAYER_SHARE = 0.3  # likewise, between jackets and what is worn beneath
_GAP_SHARE = 0.2  # of an edge, where that is more: edges are chords of what they lie on
LAYER_GAP_M = 0.006
_HEM_OVER_SKIRT = 0.5
_TIGHT_LEGS_M = 0.0015
_WOVEN_N_PER_M = 1000.0  # that what is knitted does not reach
_END_M = 0.02  # height of the band that is held at a waist or gathered by an elastic


def sample_numbers(
    rng: np.random.Generator,
    outfit_type: str,
    ranges: OutfitRanges,
    fabrics: Sequence[str] = MEASURED_FABRICS,
) -> list[tuple[str, dict[str, Any]]]:
    """Draw an outfit's random numbers: (name, `Garment.attributes`) from inner to outer.

    Args:
        outfit_type: garments joined by "+".
        ranges: of one fit, see `OutfitRanges.of_fit`; the first of several is noted.
        fabrics: names to draw from; some may be for other garments only, but what none of them
            suits is made of any.
    """
    names, fit = outfit_type.split("+"), ranges.fits[0]
    if any(GARMENT_TYPES[name].outer for name in names):
        below = replace(ranges, collar_chance=0.0)  # its own collar lies there
    else:
        below = ranges
    out = []
    for name in names:
        garment_type = GARMENT_TYPES[name]
        whole = garment_type.region == "whole"
        parts: dict[str, Any] = {}
        if "upper" in garment_type.parts:
            sleeves = _has_sleeves(rng, garment_type.sleeve_chance)
            parts["upper"] = sample_upper(
                rng,
                ranges if garment_type.outer else below,
                sleeves=sleeves,
                opens=not whole,
                outer=garment_type.outer,
            )
        if "trousers" in garment_type.parts:
            parts["trousers"] = sample_trousers(rng, ranges)
        if "skirt" in garment_type.parts:
            parts["skirt"] = sample_skirt(rng, ranges)
        if garment_type.region == "upper" and any(GARMENT_TYPES[worn].skirt for worn in names):
            parts["upper"]["hem"] *= _HEM_OVER_SKIRT  # the skirt would carry a long hem
        if whole:
            parts[garment_type.parts[-1]]["waist"] = uniform(rng, ranges.sewn_waist)
        has_end = {
            "sleeves": "sleeve_length" in parts.get("upper", {}),
            "legs": "trousers" in parts,
            "waist": whole,
        }
        elastic = {
            end: bool(rng.random() < ranges.elastic_chance)
            for end, present in has_end.items()
            if present
        }
        parts["fullness"] = uniform(rng, ranges.fullness)
        parts["fold_seed"] = int(rng.integers(2**31))
        parts["fit"] = fit
        # One random number, however many there are, so that another fabric leaves the cut alone.
        suited = fabrics_of(name, fabrics) or list(fabrics)
        fabric = suited[int(rng.random() * len(suited))]
        if fit == "fitted" and FABRICS[fabric].stretch_n_per_m > _WOVEN_N_PER_M:
            # Legs that neither stretch nor slide would hold back whoever crouches.
            elastic |= {end: False for end in elastic if end == "legs"}
        texture = draw_texture(parts["fold_seed"], fabric, _colour(rng))
        attributes = {
            "fabric": fabric,
            "elastic": elastic,
            "texture": texture,
            "parameters": parts,
        }
        out.append((name, attributes))
    # Lower garments are worn under upper ones.
    order = layered(names)
    return sorted(out, key=lambda item: order.index(item[0]))


def _has_sleeves(rng: np.random.Generator, chance: float) -> bool:
    """Nothing is drawn where it is certain."""
    return chance == 1 or (chance > 0 and rng.random() < chance)


def _colour(rng: np.random.Generator) -> list[float]:
    """A cloth-like colour: any hue, mostly muted."""
    hue, saturation, value = rng.random(), rng.random() ** 1.3 * 0.75, rng.uniform(0.25, 0.9)
    k = (np.array([5, 3, 1]) + hue * 6) % 6
    rgb = value - value * saturation * np.clip(np.minimum(k, 4 - k), 0, 1)
    return [float(c) for c in rgb]


def sample_outfit(
    rng: np.random.Generator,
    templates: Templates,
    body: BodyModel,
    *,
    gender: str,
    shape: np.ndarray,
    outfit_type: str,
    edge_length_m: float,
    vertices_min: int = 0,
    ranges: OutfitRanges | None = None,
    fabrics: Sequence[str] = MEASURED_FABRICS,
    own: Mapping[str, OwnGarment] | None = None,
) -> Outfit:
    """Draw an outfit and make it for a body (CLOTH3D 3.2: shape, cut, resize, sew).

    Args:
        templates: of the body's gender.
        gender: "female" or "male".
        shape: (10,) the wearer's shape coefficients.
        outfit_type: garments joined by "+", such as "Tshirt+Trousers" or "Dress".
        vertices_min: a garment that would have fewer vertices gets shorter edges.
        ranges: what is drawn from; the defaults if None.
        fabrics: names to draw from; some may be for other garments only.
        own: garment name -> the user's own, in place of the template.

    Returns:
        Garments in rest pose, outside the body of the wearer's shape plus tightness.

    Raises:
        InputError: a user's garment is unusable.
    """
    ranges = ranges or OutfitRanges()
    whole, ranges = ranges, ranges.of_fit(str(rng.choice(ranges.fits)))
    numbers = sample_numbers(rng, outfit_type, ranges, fabrics)
    # The second term is the one of girth.
    tightness = np.array([uniform(rng, whole.tightness), uniform(rng, ranges.tightness)])
    return make_outfit(
        numbers,
        templates,
        body,
        gender=gender,
        shape=shape,
        tightness=tightness,
        edge_length_m=edge_length_m,
        vertices_min=vertices_min,
        own=own,
    )


def make_outfit(
    numbers: list[tuple[str, dict[str, Any]]],
    templates: Templates,
    body: BodyModel,
    *,
    gender: str,
    shape: np.ndarray,
    tightness: np.ndarray,
    edge_length_m: float,
    vertices_min: int = 0,
    own: Mapping[str, OwnGarment] | None = None,
) -> Outfit:
    """Make an outfit of given numbers.

    Args:
        numbers: as `sample_numbers` returns them.
        tightness: (2,) gamma.
        templates, body, gender, shape, edge_length_m, vertices_min, own: as for `sample_outfit`.

    Raises:
        InputError: a user's garment is unusable.
    """
    mean_body = rest_body(body, np.zeros(10))
    target = rest_body(body, tightness_shape(shape, tightness, gender))
    solid = SignedDistance(target, body.faces)
    axis_y = float(templates.form.torso.centre[0, 1])
    garments: list[Garment] = []
    for name, attributes in numbers:
        if own and name in own:
            garment, pattern = _from_file(own[name], name, attributes, body), None
        else:
            garment, pattern = _from_template(
                name, attributes, templates.form, edge_length_m, vertices_min
            )
        separate = separator(pattern, _TIGHT_LEGS_M) if pattern else None
        collar = pattern.marks.get("collar") if pattern else None
        points = garment.vertices
        average = averaging_matrix(garment.faces, len(points))
        edge_m = mean_edge_length(points, garment.faces)
        passes = 4 + round(RESIZE_PASSES * (RESIZE_EDGE_M / edge_m) ** 2)
        points = resize(points, average, mean_body, target, passes)
        gap_m = max(BODY_GAP_M, _GAP_SHARE * edge_m)
        outer = GARMENT_TYPES[name].outer
        layer_m = max(LAYER_GAP_M, _LAYER_SHARE * edge_m) if outer else LAYER_GAP_M
        if pattern is not None:
            held_m = gap_m + layer_m * outer
            points = lay_on(points, solid, garment.pin > 0, held_m, collar)
        points = leave_body(points, average, solid, gap_m, separate)
        for inner in garments:
            worn = inner.vertices.astype(float)
            if not outer:
                points = lay_over(points, average, worn, axis_y, layer_m)
                continue
            sheet, beyond_m = Mesh(worn, triangulate(inner.faces)), _BEYOND_EDGES * edge_m
            over = push_over(points, average, sheet, gap_m=layer_m, beyond_m=beyond_m)
            if collar is not None:
                over[collar[1:]] = points[collar[1:]] + (over - points)[collar[0]]
            points = leave_body(over, average, solid, gap_m)
        garments.append(replace(garment, vertices=points.astype(np.float32)))
    return Outfit(
        tuple(garments),
        np.asarray(shape, dtype=np.float64),
        np.asarray(tightness, dtype=np.float64),
        signed_tightness(tightness, gender),
        gender,
    )


def _from_template(
    name: str, attributes: dict[str, Any], form: DressForm, edge_length_m: float, vertices_min: int
) -> tuple[Garment, Pattern]:
    """A garment on the dress form, with float64 vertices, and its pattern."""
    numbers = attributes["parameters"]
    parts = {part: numbers[part] for part in GARMENT_TYPES[name].parts}
    pattern = cut_garment(form, edge_length_m, **parts)
    while pattern.count < vertices_min:
        edge_length_m *= 0.98 * (pattern.count / vertices_min) ** 0.5
        pattern = cut_garment(form, edge_length_m, **parts)
    faces = pattern.faces()
    folds = rng_for(numbers["fold_seed"], "folds")
    points = drape_on_form(folds, form, pattern, edge_length_m, numbers["fullness"])
    uv, uv_faces = pattern.texture()
    pin, elastic = _masks(pattern, name, attributes)
    band = _bands(pattern, pin > 0, elastic > 0)
    return Garment(name, points, faces, uv, uv_faces, pin, elastic, band, attributes), pattern


def _from_file(own: OwnGarment, name: str, attributes: dict[str, Any], body: BodyModel) -> Garment:
    """A user's garment, with float64 vertices."""
    mesh = load_user_garment(own.path, body, mend=own.mend)
    held = own.held
    if held is None:
        held = ("top",) if GARMENT_TYPES[name].region == "lower" else ()
    pin, elastic = (rims(own.path, mesh, names, _END_M) for names in (held, own.elastic))
    attributes = {
        **attributes,
        "fabric": own.fabric or attributes["fabric"],
        "elastic": dict.fromkeys(own.elastic, True),
        # Prints are drawn for the texture maps of patterns.
        "texture": {"type": "color", "data": attributes["texture"]["data"]},
        "parameters": {"own_garment": own.path, "held": list(held)},
    }
    # Loading made some where there were none.
    assert mesh.uv is not None
    assert mesh.uv_faces is not None
    points = mesh.vertices.astype(np.float64)
    band = np.zeros(len(points), np.float32)
    return Garment(name, points, mesh.faces, mesh.uv, mesh.uv_faces, pin, elastic, band, attributes)


def _masks(
    pattern: Pattern, name: str, attributes: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Held vertices and gathered ends, by distance from their ring at the mean shape."""
    points = pattern.vertices
    pin, gathered = np.zeros(len(points), np.float32), np.zeros(len(points), np.float32)
    if "upper" in attributes["parameters"]:
        # A wide neck or an open front slides off shoulders that friction alone would have to hold.
        pin[pattern.marks["shoulders"]] = 1
    if GARMENT_TYPES[name].region == "lower":
        waist = points[pattern.marks["waist"], 2].mean()
        pin[points[:, 2] > waist - _END_M] = 1
    ends = {
        "sleeves": ("left_cuff", "right_cuff"),
        "legs": ("left_leg_cuff", "right_leg_cuff"),
        "waist": ("waist",),
    }
    for end, on in attributes["elastic"].items():
        for mark in ends[end] if on else ():
            ring = points[pattern.marks[mark]]
            low, high = ring.min(axis=0) - _END_M, ring.max(axis=0) + _END_M
            gathered[((points > low) & (points < high)).all(axis=1)] = 1
    return pin, gathered


# Height of bands, and how much of one they are.
_BANDS = {
    "collar": (0.0, 1.0),
    **dict.fromkeys(("left_cuff", "right_cuff", "waistband"), (0.045, 1.0)),
    **dict.fromkeys(("hem", "skirt_hem", "left_leg_cuff", "right_leg_cuff"), (0.025, 0.3)),
}


def _bands(pattern: Pattern, held: np.ndarray, gathered: np.ndarray) -> np.ndarray:
    """(V,) float32 of `Garment.band`: what is folded or lined, but for what an elastic gathers.

    Sewn waists are no bands.
    """
    marks = dict(pattern.marks)
    waist = marks.pop("waist", np.zeros(0, dtype=int))
    marks["waistband"] = waist[held[waist]]
    band = np.zeros(pattern.count, np.float32)
    for name, (height, share) in _BANDS.items():
        ends = np.ravel(marks.get(name, ())).astype(int)
        if name == "collar":
            band[ends] = share
        elif len(ends):
            away, _ = KDTree(pattern.vertices[ends]).query(pattern.vertices)
            band[away < height] = np.maximum(band[away < height], share)
    band[gathered] = 0
    return band
