"""Every range and chance that an outfit is drawn from, in one place."""

from dataclasses import dataclass

import numpy as np

Range = tuple[float, float]


@dataclass(frozen=True)
class OutfitRanges:
    """Uniform ranges; CLOTH3D 3.2 leaves most of them to the maker ("empirically set").

    Shares run along a body part from 0 to 1, so both genders use the same ones; distances are for
    a torso of 0.53 m from crotch to shoulder and grow with it. Widths at x = 0 are in diameters of
    the bare limb there.
    """

    sleeve_length: Range = (0.2, 1.0)  # shoulder (0) to wrist (1)
    sleeve_alpha1: Range = (-0.22, -0.02)  # this and the next three: equation 1 along the arm
    sleeve_alpha2: Range = (0.05, 0.5)
    sleeve_offset: Range = (0.3, 1.0)  # a share of the sleeve
    sleeve_w0: Range = (1.35, 1.8)
    hem: Range = (0.1, 1.0)  # waist (0) to crotch (1), of t-shirts and tops
    ease_m: Range = (0.004, 0.022)  # room around the chest
    flare: Range = (0.0, 0.08)  # what the hem adds to it per metre
    shaping: Range = (0.04, 0.22)  # how fast it comes back to the body below the chest, m per m
    drop_m: Range = (0.02, 0.045)  # underarm below the body's armpit, garments with sleeves
    neck_width_m: Range = (0.078, 0.098)  # half of it
    neck_depth_crew_m: Range = (0.06, 0.085)
    neck_depth_v_m: Range = (0.11, 0.19)
    neck_depth_scoop_m: Range = (0.1, 0.17)
    neck_depth_back_m: Range = (0.015, 0.035)
    open_chance: float = 0.18  # of t-shirts that open all the way
    polo_chance: float = 0.2  # of t-shirts that open for a part of it
    placket_m: Range = (0.08, 0.16)  # length of a polo's opening
    strap_m: Range = (0.025, 0.055)  # width of a top's straps
    strap_neck_m: Range = (0.085, 0.105)  # half the distance between them
    top_drop_m: Range = (0.0, 0.035)  # depth of a top's armholes
    scye_m: Range = (0.005, 0.03)  # how far they curve inwards
    waist: Range = (0.45, 1.0)  # hip joint (0) to waist (1), upper end of trousers and skirts
    sewn_waist: Range = (0.8, 1.0)  # likewise, where full-body garments are sewn together
    leg_length: Range = (0.12, 1.0)  # crotch (0) to ankle (1)
    leg_alpha1: Range = (-0.16, -0.03)  # this and the next three: equation 1 along the leg
    leg_alpha2: Range = (0.05, 0.45)
    leg_offset: Range = (0.35, 1.0)
    leg_w0: Range = (1.1, 1.4)
    rise_m: Range = (0.015, 0.05)  # crotch below the body's
    hip_ease_m: Range = (0.0, 0.015)  # room around the hips
    skirt_length: Range = (0.3, 0.95)  # hip (0) to ankle (1)
    skirt_alpha1: Range = (0.15, 0.75)  # equation 1 along the body's axis; alpha2 is 0
    skirt_flutes: Range = (5.0, 11.0)  # folds per metre of hem
    skirt_fullness: Range = (0.02, 0.06)  # their depth
    fullness: Range = (0.0, 0.012)  # excess of cloth around the body, as a share, in soft folds
    tightness: Range = (-1.5, 0.5)  # both terms of gamma
    elastic_chance: float = 0.5  # for sleeves, for legs, and for the waist of full-body garments


def uniform(rng: np.random.Generator, span: Range) -> float:
    """Draw a number of a range."""
    return float(rng.uniform(*span))


def sample_upper(
    rng: np.random.Generator, ranges: OutfitRanges, *, sleeves: bool, opens: bool
) -> dict[str, float | str]:
    """Draw the numbers of an upper-body garment: name -> value, as stored with the sample.

    Args:
        sleeves: a t-shirt, else a top.
        opens: whether it may open in front (not when it is part of a full-body garment).
    """
    r = ranges
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
    front = "closed"
    if sleeves:
        draw = rng.random()
        if opens and draw < r.open_chance:
            front = "open"
        elif draw > 1 - r.polo_chance:
            front = "polo"
        values |= {
            "neck_width_m": uniform(rng, r.neck_width_m),
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
    return values


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
