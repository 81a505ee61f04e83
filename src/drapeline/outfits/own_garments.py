"""Which garments of their own users name in the config, and how these are worn."""

from collections.abc import Mapping
from typing import Any

from drapeline.frames import GENDERS


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
