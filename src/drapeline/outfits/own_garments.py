"""Which garments of their own users name in the config, and how these are worn."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drapeline.frames import GENDERS

# Openings of a garment by where they are; see `user_garment.openings`.
OPENINGS = ("top", "bottom", "sleeves", "legs")


@dataclass(frozen=True)
class OwnGarment:
    """A user's garment in place of a template.

    Attributes:
        path: of the OBJ file.
        fabric: one of `FABRICS`; None to draw one as for other garments.
        elastic: of `OPENINGS`, those that an elastic gathers.
        held: of `OPENINGS`, those that the body carries; None for the waistbands of lower garments.
    """

    path: str
    fabric: str | None = None
    elastic: tuple[str, ...] = ()
    held: tuple[str, ...] | None = None


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
