"""Classes of garments that fits to scans are compared by, as in table 2 of SMPLicit."""

from collections.abc import Mapping

# The paper has no class of garments for the whole body.
CLASSES = ("short upper", "long upper", "short lower", "long lower", "whole body")
_LONG = 0.5  # share of the limb


def scan_class(region: str, properties: Mapping[str, float]) -> str:
    """The class of a garment.

    Args:
        region: of its type, as in `GARMENT_TYPES`.
        properties: of it, see `drapeline.metrics.properties`.
    """
    if region == "whole":
        return CLASSES[-1]
    reach = properties["sleeve" if region == "upper" else "leg"]
    return f"{'long' if reach >= _LONG else 'short'} {region}"
