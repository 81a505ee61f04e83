"""Garments of a user's own in place of templates."""

from collections.abc import Mapping
from typing import Annotated, Any

from drapeline.frames import GENDERS
from drapeline.outfits.fabrics import FABRICS
from drapeline.settings import EachOnce, Field, OneOf, Settings

# Openings of a garment by where they are; see `user_garment.openings`.
OPENINGS = ("top", "bottom", "sleeves", "legs")
_Opening = Annotated[str, OneOf(OPENINGS)]
_Path = Annotated[str, Field(min_length=1)]


class _Worn(Settings):
    fabric: Annotated[str, OneOf(tuple(FABRICS))] | None = Field(
        None, description="What it is made of; null draws a fabric as for other garments."
    )
    elastic: Annotated[tuple[_Opening, ...], EachOnce()] = Field(
        (), description="Openings that are gathered by an elastic."
    )
    held: Annotated[tuple[_Opening, ...], EachOnce()] | None = Field(
        None,
        description=(
            "Openings whose rims are held where the body carries them; null holds the top of "
            "trousers and skirts."
        ),
    )
    mend: bool = Field(
        False,
        description=(
            "Whether to turn, move or scale the garment where the body could not have it on but "
            "for that; the log says what was done. Else it is refused."
        ),
    )


class OwnGarment(_Worn):
    """A user's garment in place of a template."""

    path: str = Field(description="the OBJ file")


class OwnGarmentFiles(_Worn):
    """The file for both genders, or a mapping with files and how the garment is worn."""

    file: _Path | None = Field(None, description="The OBJ file for both genders.")
    female: _Path | None = Field(
        None, description="The OBJ file for women, modelled on the female rest body."
    )
    male: _Path | None = Field(
        None, description="The OBJ file for men, modelled on the male rest body."
    )


def own_garments(settings: Mapping[str, str | Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Gender -> garment type -> arguments of `OwnGarment`.

    Args:
        settings: garment type -> a path; or a mapping with `file` for both genders, `female` or
            `male`, and the other arguments. A gender without a file wears generated garments.
    """
    found: dict[str, dict[str, Any]] = {gender: {} for gender in GENDERS}
    for name, value in settings.items():
        one = {"file": value} if isinstance(value, str) else dict(value)
        files = {gender: one.pop(gender, None) for gender in GENDERS}
        both = one.pop("file", None)
        for gender in GENDERS:
            if path := files[gender] or both:
                found[gender][name] = {"path": path, **one}
    return found
