"""Metrics and variants by name: all that tables, figures and texts need to show them.

A model declares its own in a module beside this one, or in a package of its own, which names the
module as an entry point of the group `drapeline.metrics`: `METRICS` (name -> `Metric`) and
`VARIANTS` (the rows' column "model" -> variant -> `Variant`). The order of variants is that of
rows in tables.
"""

from collections import ChainMap
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from types import ModuleType

from drapeline.metrics import garment4d, gcvae, shared, smplicit
from drapeline.metrics.metric import Metric, Variant

ENTRY_POINTS = "drapeline.metrics"


def metric(name: str) -> Metric:
    """The metric of a name, which is its title if nobody declared it."""
    known = ChainMap(*(module.METRICS for module in _modules()))
    return known.get(name, Metric("", name, 3, better=""))


def variant(model: str, name: str) -> Variant:
    """The variant of a model; its name is its title if nobody declared it.

    A declared name may end in `*`, which stands for what differs and takes the place of `{}` in
    the title.
    """
    known = variants(model)
    if name in known:
        return known[name]
    for pattern, one in known.items():
        start = pattern.removesuffix("*")
        if start != pattern and name.startswith(start):
            return one._replace(title=one.title.format(name.removeprefix(start)))
    return Variant(name)


# What the rows of cleaner and of worse scans are of as well.
_SAME = dict.fromkeys((shared.CLEAN_SCAN, shared.WORSE_SCAN), shared.SCAN)


def variants(model: str) -> Mapping[str, Variant]:
    """All declared variants of a model, in order."""
    found: dict[str, Variant] = {}
    for module in _modules():
        found |= module.VARIANTS.get(_SAME.get(model, model), {})
    return found


@cache
def _modules() -> tuple[ModuleType, ...]:
    others = (point.load() for point in entry_points(group=ENTRY_POINTS))
    return (shared, gcvae, garment4d, smplicit, *others)
