"""Metrics and variants as tables, figures and texts show them, and measures of garments."""

from collections.abc import Mapping
from typing import NamedTuple

SMALLER, LARGER = "smaller", "larger"


class Metric(NamedTuple):
    """A metric."""

    unit: str  # shown, such as "%"; nothing for shares and counts as they are stored
    title: str  # without the unit
    digits: int = 1  # shown after the point
    scale: float = 1.0  # from the stored to the shown number, such as 100 for per cent
    better: str = SMALLER  # `SMALLER` or `LARGER`, or nothing where neither is

    @property
    def heading(self) -> str:
        """Title with the unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    def text(self, *values: float) -> str:
        """A stored value, with the interval behind it if its two ends are given as well."""
        numbers = [f"{self.scale * value:.{self.digits}f}" for value in values]
        return numbers[0] if len(numbers) == 1 else "{} [{}, {}]".format(*numbers)


class Variant(NamedTuple):
    """A row of tables: a model, one of its settings, a baseline or the truth."""

    title: str
    group: str = ""  # title of what it is compared within, where a model has several such groups
    competes: bool = True  # whether it may be the best; bounds and the truth itself do not
    # Title above a column of pictures, in lines; those without one are in no picture.
    short: str = ""


class Measured(NamedTuple):
    """Measures of a garment: at rest, in one frame, or over a whole sequence."""

    group: str  # name of what makes values dependent, such as the outfit or the clip
    garment: str  # its type, or its class
    measures: Mapping[str, float]  # metric -> value; NaN where a metric is not defined
    source: str = ""  # cloth solver that moved the garment, if one did
