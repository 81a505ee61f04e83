"""The models of the ablation tables: what each changes in the paper's full model."""

from typing import Any

# Variant -> group -> setting -> value, which replace the experiment's settings of the full model.
SVAE_VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "svae": {},
    "svae_no_normals": {"loss": {"normals": 0.0}},
    # Without a mask the network must learn every vertex, garment or not.
    "svae_no_mask": {"loss": {"offsets_within": "all"}, "training": {"mask": False}},
    "svae_no_cvar": {"loss": {"condition": 0.0}},
    "svae_uniform_pooling": {},
}
DVAE_VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    f"dvae_{version}_{frames}": {
        "training": {"version": version, "mask": False},
        "network": {"scale": 2},
    }
    for version in ("posed", "unposed")
    for frames in (1, 4)
}
# Masked probabilistic PCA, which the networks are compared with.
STATIC_PPCA, DYNAMIC_PPCA = "static_ppca", "dynamic_ppca"


def dynamic_conditions(variant: str) -> tuple[str, int]:
    """A dynamic variant's version of the offsets, and the number of poses it is conditioned on."""
    if variant == DYNAMIC_PPCA:
        return "unposed", 4
    _, version, frames = variant.split("_")
    return version, int(frames)


def pooling_of(variant: str) -> str:
    """Which mesh hierarchy a variant uses."""
    return "uniform" if variant == "svae_uniform_pooling" else "segments"
