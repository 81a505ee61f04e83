"""The models of the ablation tables: what each changes in the full model."""

from collections.abc import Mapping
from typing import Any

# Variant -> group -> setting -> value, laid over the experiment's settings of the full model.
SVAE_VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "svae": {},
    "svae_no_normals": {"loss": {"normals": 0.0}},
    # Without a mask the network must learn every vertex, garment or not.
    "svae_no_mask": {"loss": {"offsets_within": "all"}, "training": {"mask": False}},
    "svae_no_cvar": {"loss": {"condition": 0.0}},
    "svae_uniform_pooling": {},
    "svae_ours": {
        "loss": {"mask_form": "bce", "offsets_form": "distance"},
        "training": {"model": "linear"},
    },
}
DVAE_VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    f"dvae_{version}_{frames}": {
        "training": {"model": "dynamic", "version": version, "mask": False},
        "network": {"scale": 2},
    }
    for version in ("posed", "unposed")
    for frames in (1, 4)
} | {
    "dvae_ours": {
        "loss": {"offsets_form": "distance"},
        "training": {"model": "linear_dynamic", "version": "unposed", "mask": False},
    },
}


def dynamic_conditions(variant: str) -> tuple[str, int]:
    """A dynamic variant's version of the offsets, and the number of poses it is conditioned on."""
    if variant == "dvae_ours":
        return "unposed", 4
    _, version, frames = variant.split("_")
    return version, int(frames)


def pooling_of(variant: str) -> str:
    """Which mesh hierarchy a variant uses."""
    return "uniform" if variant == "svae_uniform_pooling" else "segments"


def laid_over(
    settings: Mapping[str, Mapping[str, Any]], changes: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Settings by group with some of them changed."""
    return {group: {**values, **changes.get(group, {})} for group, values in settings.items()}
