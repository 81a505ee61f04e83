"""Every range and chance that an outfit is drawn from, in one place."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from drapeline.outfits.garment_types import FITS

Range = tuple[float, float]
# Ranges that a fit takes a third of: the lowest, or the highest, is fitted.
_LOOSER = ("ease_m", "drop_m", "sleeve_w0", "hip_ease_m", "leg_w0", "skirt_alpha1")
_TIGHTER = ("shaping", "tightness")


@dataclass(frozen=True)
class OutfitRanges:
    """Uniform ranges; CLOTH3D 3.2 leaves most of them to the maker ("empirically set").

    Shares run along a body part from 0 to 1, so both genders use the same ones; distances are for
    a torso of 0.53 m from crotch to shoulder and grow with it. Widths at x = 0 are in diameters of
    the bare upper arm and thigh. Each fit has a third of the ranges of ease and width, see
    `of_fit`; with the tightness they give the eases of pattern blocks (FreeSewing, MIT licence):
    t-shirts 5 to 25 % around the chest and 8 to 30 % around the hips, upper arms 0 to 50 %,
    trousers 0 to 20 % around the seat and the knee.
    """

    sleeve_length: Range = (0.2, 1.0)  # shoulder (0) to wrist (1)
    # This and the next three: equation 1 along the arm, whose own width falls by 0.1 m per metre.
    sleeve_alpha1: Range = (-0.12, -0.06)
    sleeve_alpha2: Range = (0.0, 0.1)
    sleeve_offset: Range = (0.3, 1.0)  # a share of the sleeve
    sleeve_w0: Range = (1.08, 1.4)
    hem: Range = (0.1, 1.0)  # waist (0) to crotch (1), of t-shirts and tops
    ease_m: Range = (0.005, 0.028)  # room around the chest
    flare: Range = (0.0, 0.08)  # what the hem adds to it per metre
    shaping: Range = (0.04, 0.22)  # how fast it comes back to the body below the chest, m per m
    drop_m: Range = (0.012, 0.042)  # underarm below the body's armpit, garments with sleeves
    neck_width_crew_m: Range = (0.07, 0.08)  # half of it, of garments with sleeves
    neck_width_m: Range = (0.075, 0.095)  # likewise, of other necklines
    neck_depth_crew_m: Range = (0.045, 0.065)
    neck_depth_v_m: Range = (0.11, 0.19)
    neck_depth_scoop_m: Range = (0.1, 0.17)
    neck_depth_back_m: Range = (0.01, 0.025)
    buttoned_chance: float = 0.25  # of t-shirts that are shirts with buttons
    polo_chance: float = 0.15  # of t-shirts that open for a part of it
    placket_m: Range = (0.08, 0.16)  # length of a polo's opening
    unbuttoned_m: Range = (0.03, 0.14)  # likewise, of a shirt with buttons
    open_below: Range = (-0.6, 0.6)  # hem (0) to underarm (1), where a shirt is open again
    collar_chance: float = 0.85  # of polos and shirts with buttons
    collar_stand_m: Range = (0.022, 0.034)  # height along the neck
    collar_fall_m: Range = (0.04, 0.055)  # what is turned down behind
    collar_point_m: Range = (0.008, 0.025)  # what that is longer in front
    strap_m: Range = (0.025, 0.055)  # width of a top's straps
    strap_neck_m: Range = (0.085, 0.105)  # half the distance between them
    top_drop_m: Range = (0.0, 0.035)  # depth of a top's armholes
    scye_m: Range = (0.005, 0.03)  # how far they curve inwards
    waist: Range = (0.45, 1.0)  # hip joint (0) to waist (1), upper end of trousers and skirts
    sewn_waist: Range = (0.8, 1.0)  # likewise, where full-body garments are sewn together
    leg_length: Range = (0.12, 1.0)  # crotch (0) to ankle (1)
    # This and the next three: equation 1 along the leg, whose own width falls by 0.13 m per metre.
    leg_alpha1: Range = (-0.14, -0.07)
    leg_alpha2: Range = (0.0, 0.25)
    leg_offset: Range = (0.35, 1.0)
    leg_w0: Range = (1.12, 1.28)
    rise_m: Range = (0.025, 0.055)  # crotch below the body's
    hip_ease_m: Range = (0.006, 0.021)  # room around the hips
    skirt_length: Range = (0.3, 0.95)  # hip (0) to ankle (1)
    skirt_alpha1: Range = (0.15, 0.75)  # equation 1 along the body's axis; alpha2 is 0
    skirt_flutes: Range = (5.0, 11.0)  # folds per metre of hem
    skirt_fullness: Range = (0.02, 0.06)  # their depth
    fullness: Range = (0.0, 0.012)  # excess of cloth around the body, as a share, in soft folds
    tightness: Range = (-1.5, 0.5)  # both terms of gamma; a fit has a third for the second
    elastic_chance: float = 0.5  # for sleeves, for legs, and for the waist of full-body garments
    fits: tuple[str, ...] = FITS  # to draw from
    # What jackets have instead: room for what is worn beneath.
    jacket: Mapping[str, Range] = field(
        default_factory=lambda: {
            "ease_m": (0.02, 0.035),
            "sleeve_length": (0.88, 1.0),
            "sleeve_w0": (1.5, 1.75),
            "hem": (0.55, 1.3),
            "drop_m": (0.04, 0.055),
            "shaping": (0.02, 0.08),
            "neck_width_m": (0.085, 0.095),
            "neck_depth_v_m": (0.13, 0.18),
        }
    )

    def of_fit(self, fit: str) -> "OutfitRanges":
        """The ranges of one of `FITS`."""
        third = FITS.index(fit)
        narrowed: dict[str, Any] = {
            name: _third(getattr(self, name), third) for name in _LOOSER
        } | {name: _third(getattr(self, name), 2 - third) for name in _TIGHTER}
        return replace(self, fits=(fit,), **narrowed)


def _third(span: Range, number: int) -> Range:
    """The lowest (0), middle or highest (2) third of a range."""
    low, high = span
    step = (high - low) / 3
    return low + number * step, low + (number + 1) * step


def uniform(rng: np.random.Generator, span: Range) -> float:
    """Draw a number of a range."""
    return float(rng.uniform(*span))


def sample_upper(
    rng: np.random.Generator,
    ranges: OutfitRanges,
    *,
    sleeves: bool,
    opens: bool,
    outer: bool = False,
) -> dict[str, float | str]:
    """Draw the numbers of an upper-body garment: name -> value, as stored with the sample.

    Args:
        sleeves: a t-shirt, else a top.
        opens: whether it may open in front (not when it is part of a full-body garment).
        outer: whether it is a jacket.
    """
    own: Mapping[str, Any] = ranges.jacket if outer else {}
    r = replace(ranges, **own).of_fit(ranges.fits[0]) if outer else ranges
    front = "open" if outer else _sample_front(rng, r, opens=opens) if sleeves else "closed"
    neckline = "v" if outer else "crew"
    if front == "closed":
        neckline = str(rng.choice(["crew", "v", "scoop"]))
    values: dict[str, float | str] = {
        "hem": uniform(rng, r.hem),
        "ease_m": uniform(rng, r.ease_m),
        "flare": uniform(rng, r.flare),
        "shaping": uniform(rng, r.shaping),
        "neckline": neckline,
        "neck_depth_m": uniform(rng, getattr(r, f"neck_depth_{neckline}_m")),
        "neck_depth_back_m": uniform(rng, r.neck_depth_back_m),
    }
    if sleeves:
        values |= {
            "neck_width_m": uniform(
                rng, r.neck_width_crew_m if neckline == "crew" else r.neck_width_m
            ),
            "drop_m": uniform(rng, r.drop_m),
            "sleeve_length": uniform(rng, r.sleeve_length),
            "sleeve_alpha1": uniform(rng, r.sleeve_alpha1),
            "sleeve_alpha2": uniform(rng, r.sleeve_alpha2),
            "sleeve_offset": uniform(rng, r.sleeve_offset),
            "sleeve_w0": uniform(rng, r.sleeve_w0),
        }
    else:
        values |= {
            "neck_width_m": uniform(rng, r.strap_neck_m),
            "drop_m": uniform(rng, r.top_drop_m),
            "strap_m": uniform(rng, r.strap_m),
            "scye_m": uniform(rng, r.scye_m),
        }
    values["front"] = front
    if front == "polo":
        values["placket_m"] = uniform(rng, r.placket_m)
    if front == "buttoned":
        values["placket_m"] = uniform(rng, r.unbuttoned_m)
        values["open_below"] = uniform(rng, r.open_below)
    if front != "closed" and rng.random() < r.collar_chance:
        names = ("collar_stand_m", "collar_fall_m", "collar_point_m")
        values |= {name: uniform(rng, getattr(r, name)) for name in names}
    return values


def _sample_front(rng: np.random.Generator, ranges: OutfitRanges, *, opens: bool) -> str:
    draw = rng.random()
    if opens and draw < ranges.buttoned_chance:
        return "buttoned"
    return "polo" if draw > 1 - ranges.polo_chance else "closed"


def sample_trousers(rng: np.random.Generator, ranges: OutfitRanges) -> dict[str, float]:
    """Draw the numbers of trousers: name -> value."""
    names = ("waist", "leg_length", "leg_alpha1", "leg_alpha2", "leg_offset", "leg_w0")
    return {name: uniform(rng, getattr(ranges, name)) for name in (*names, "rise_m", "hip_ease_m")}


def sample_skirt(rng: np.random.Generator, ranges: OutfitRanges) -> dict[str, float]:
    """Draw the numbers of a skirt: name -> value."""
    names = ("waist", "skirt_length", "skirt_alpha1", "skirt_flutes", "skirt_fullness")
    values = {name: uniform(rng, getattr(ranges, name)) for name in names}
    values["skirt_phase"] = float(rng.uniform(0, 2 * np.pi))
    values |= {f"skirt_wander{k}": float(rng.random()) for k in range(4)}
    return values
