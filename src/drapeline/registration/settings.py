"""Settings of registrations: of garments to templates, and to points."""

from typing import Annotated

from drapeline.settings import Field, Settings

_Weight = Annotated[float, Field(ge=0, le=1_000_000)]


class TemplateFitSettings(Settings):
    """Fit of garments to a template (Garment4D, equation 3, for lengths in metres)."""

    chamfer: float = Field(
        1, ge=0, le=1_000_000, description="Weight of the distance between surfaces (equation 3)."
    )
    edge: float = Field(1, ge=0, le=1_000_000, description="Weight of the edge lengths.")
    normal: float = Field(
        0.01, ge=0, le=1_000_000, description="Weight of the consistency of normals."
    )
    boundary: float = Field(
        1, ge=0, le=1_000_000, description="Weight of the distance between openings."
    )
    iterations: int = Field(
        8, ge=0, le=10_000, description="Largest number of steps on equation 3."
    )


class RefineSettings(Settings):
    """Weights of the terms, per vertex, relative to the pull of the points."""

    rounds: int = Field(
        15,
        ge=0,
        le=1000,
        description="Rounds, each of which assigns points to places on the garment anew.",
    )
    stretch: float = Field(2, ge=0, le=1_000_000, description="Weight of the edge lengths.")
    bend: float = Field(
        0.2,
        ge=0,
        le=1_000_000,
        description="Weight of the distances across edges, which resist bending.",
    )
    smooth: float = Field(0.5, ge=0, le=1_000_000, description="Weight of accelerations.")
    keep_m: float = Field(
        0.008,
        gt=0,
        le=10,
        description=(
            "Expected error of a starting vertex, in metres, at which it is held back as strongly "
            "as points pull it."
        ),
    )
    gap_m: float = Field(
        0.003, ge=-1, le=0.1, description="Smallest distance from the body, in metres."
    )
