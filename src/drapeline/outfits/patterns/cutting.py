"""From sampled numbers to garments on the dress form: measures, panels, sewing."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drapeline.outfits.dress_form import ANGLES, DressForm, Tube
from drapeline.outfits.patterns.collar import Collar
from drapeline.outfits.patterns.lower import (
    SkirtCut,
    TrousersCut,
    build_skirt,
    build_trousers,
    skirt_half_ring,
    trousers_half_ring,
)
from drapeline.outfits.patterns.panels import Pattern
from drapeline.outfits.patterns.upper import UpperCut, build_upper, chest_half_ring
from drapeline.outfits.patterns.width_profile import WidthLine

Numbers = Mapping[str, Any]
_TORSO_M = 0.53  # the torso that distances in the ranges are meant for


def size_of(form: DressForm) -> float:
    """Torso length in units of the ranges' torso."""
    return (form.landmarks["shoulder"] - form.landmarks["crotch"]) / _TORSO_M


def _mean_diameter(tube: Tube, along_m: float) -> float:
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES
    return 2 * float(tube.radius_at(np.full(ANGLES, along_m), angle).mean())


def _mix(a: float, b: float, share: float) -> float:
    return a + (b - a) * share


def waist_height(form: DressForm, values: Numbers) -> float:
    """Upper end of a lower garment."""
    return _mix(form.landmarks["hip"] + 0.03, form.landmarks["waist"], values["waist"])


def upper_cut(form: DressForm, values: Numbers, hem_m: float | None = None) -> UpperCut:
    """Measures of an upper garment; `hem_m` overrides its hem where it is sewn to another."""
    marks, size = form.landmarks, size_of(form)
    sleeve_x, sleeve = None, None
    if "sleeve_length" in values:
        shoulder_x = marks["shoulder_x"] + 0.012 * size
        length = marks["wrist_x"] - marks["shoulder_x"]
        upper_arm = marks["shoulder_x"], marks["elbow_x"]
        sleeve_x = marks["shoulder_x"] + 0.05 + (length - 0.05) * values["sleeve_length"]
        sleeve = WidthLine(
            values["sleeve_alpha1"],
            values["sleeve_alpha2"],
            values["sleeve_offset"] * (sleeve_x - marks["shoulder_x"]),
            values["sleeve_w0"] * _mean_diameter(form.arm, _mix(*upper_arm, 0.4)),
        )
    else:
        shoulder_x = (values["neck_width_m"] + values["strap_m"]) * size
    hem = _mix(marks["waist"], marks["crotch"], values["hem"]) if hem_m is None else hem_m
    collar = None
    if "collar_stand_m" in values:
        parts = (values[f"collar_{part}_m"] * size for part in ("stand", "fall", "point"))
        collar = Collar(*parts)
    return UpperCut(
        hem=hem,
        ease=values["ease_m"],
        flare=values["flare"] if hem_m is None else 0.0,
        shaping=values["shaping"],
        drop=values["drop_m"] * size,
        shoulder_x=shoulder_x,
        neck_x=values["neck_width_m"] * size,
        neck_depth=values["neck_depth_m"] * size,
        neck_depth_back=values["neck_depth_back_m"] * size,
        neckline=values["neckline"],
        scye=values.get("scye_m", 0.008) * size,
        sleeve_x=sleeve_x,
        sleeve=sleeve,
        front=values["front"],
        placket=values.get("placket_m", 0.0) * size,
        below=_mix(hem, marks["armpit"], values.get("open_below", 0.0)),
        collar=collar,
    )


def trousers_cut(form: DressForm, values: Numbers) -> TrousersCut:
    """Measures of trousers."""
    marks = form.landmarks
    cuff = _mix(marks["crotch"] - 0.07, marks["ankle"], values["leg_length"])
    leg = WidthLine(
        values["leg_alpha1"],
        values["leg_alpha2"],
        values["leg_offset"] * (marks["hip"] - cuff),
        values["leg_w0"] * _mean_diameter(form.leg, form.leg.stop_m - 0.03),
    )
    return TrousersCut(
        waist_height(form, values), cuff, values["rise_m"], values["hip_ease_m"], leg
    )


def skirt_cut(form: DressForm, values: Numbers) -> SkirtCut:
    """Measures of a skirt."""
    marks = form.landmarks
    waist = waist_height(form, values)
    hem = _mix(marks["hip"], marks["ankle"], values["skirt_length"])
    width = WidthLine(values["skirt_alpha1"], 0.0, 0.0, _mean_diameter(form.skirt, waist))
    around = np.pi * float(width(waist - hem))
    return SkirtCut(
        waist,
        hem,
        width,
        max(6, round(values["skirt_flutes"] * around)),
        values["skirt_fullness"],
        values["skirt_phase"],
        tuple(values[f"skirt_wander{k}"] for k in range(4)),
    )


def cut_garment(
    form: DressForm,
    edge_length_m: float,
    *,
    upper: Numbers | None = None,
    trousers: Numbers | None = None,
    skirt: Numbers | None = None,
) -> Pattern:
    """Build a garment from the sampled numbers of its parts, which are sewn at the waist."""
    pattern = Pattern()
    below = trousers_cut(form, trousers) if trousers else skirt_cut(form, skirt) if skirt else None
    half: int | None = None
    waist_ids: np.ndarray | None = None
    if isinstance(below, TrousersCut):
        half = trousers_half_ring(form, below, edge_length_m)
    elif below is not None:
        half = skirt_half_ring(form, below, edge_length_m)
    if upper is not None:
        cut = upper_cut(form, upper, None if below is None else below.waist)
        if half is not None:
            # A wide skirt may have no more columns than the chest can take.
            half = min(half, 2 * round(0.8 * chest_half_ring(form, cut, edge_length_m)))
        build_upper(pattern, form, cut, edge_length_m, half)
        waist_ids = pattern.marks["hem"]
    if below is None or half is None:
        return pattern
    if isinstance(below, TrousersCut):
        build_trousers(pattern, form, below, edge_length_m, half, waist_ids)
    else:
        build_skirt(pattern, form, below, edge_length_m, half, waist_ids)
    if upper is not None:
        del pattern.marks["hem"]
    return pattern
