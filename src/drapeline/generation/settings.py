"""Settings of bodies and outfits that are drawn."""

from typing import Annotated

from drapeline.outfits.fabrics import FABRICS, MEASURED_FABRICS
from drapeline.outfits.garment_types import FITS
from drapeline.settings import EachOnce, Field, OneOf, Settings

_Bmi = Annotated[float, Field(ge=10, le=60)]
_Tightness = Annotated[float, Field(ge=-5, le=5)]


class BodySettings(Settings):
    """Bodies, which are drawn and freed of self-collisions."""

    shape_range: float = Field(
        3,
        ge=0,
        le=5,
        description=(
            "Shape coefficients are drawn uniformly within plus or minus this many standard "
            "deviations."
        ),
    )
    bmi_range: tuple[_Bmi, _Bmi] | None = Field(
        (16, 45),
        description=(
            "Lowest and highest body mass index in kg/m2, at 1010 kg/m3. Its logarithm is drawn "
            "uniformly, for both genders alike, and decides the second coefficient, corpulence; "
            "null draws that one as the others."
        ),
    )
    shape_draws: int = Field(
        5,
        ge=1,
        le=50,
        description="Shapes to try before a sample whose body intersects itself is rejected.",
    )
    segment_gap_m: float = Field(
        0.004,
        ge=0,
        le=0.05,
        description="Distance between body parts once a self-collision is resolved, in metres.",
    )
    fit_motion: bool = Field(
        True,
        description=(
            "Bend each body's legs, arms and back a little so that what supports it is on the "
            "floor and does not slide, and limbs keep clear of the trunk; else the motion's "
            "angles are kept."
        ),
    )


class OutfitSettings(Settings):
    """Outfits, as `drapeline.outfits.generate.sample_outfit` makes them."""

    edge_length_m: float = Field(
        0.02, ge=0.005, le=0.06, description="Mean edge length of the garments in metres."
    )
    vertices_min: int = Field(
        3000,
        ge=0,
        le=50_000,
        description="Garments that would have fewer vertices get shorter edges.",
    )
    tightness_range: tuple[_Tightness, _Tightness] = Field(
        (-1.5, 0.5),
        description=(
            "Both tightness values are drawn uniformly from this range; a fit has a third of it "
            "for the second one, which changes girths most."
        ),
    )
    fits: tuple[Annotated[str, OneOf(FITS)], ...] = Field(
        FITS,
        min_length=1,
        description=(
            "Fits to draw from: each has a third of the ranges of ease and width, and of the "
            "second tightness. One that is listed twice is drawn twice as often."
        ),
    )
    fabrics: Annotated[tuple[Annotated[str, OneOf(tuple(FABRICS))], ...], EachOnce()] = Field(
        MEASURED_FABRICS,
        min_length=1,
        description=(
            "Fabrics to draw from, each for the garments that are made of it; those with "
            "`blender_` are Blender's presets, of which CLOTH3D was made."
        ),
    )
    elastic_probability: float = Field(
        0.5,
        ge=0,
        le=1,
        description=(
            "Probability of elastic cuffs, of elastic hems of trouser legs, and of an elastic "
            "waist in full-body garments. Legs that are fitted have none unless the fabric "
            "stretches."
        ),
    )
