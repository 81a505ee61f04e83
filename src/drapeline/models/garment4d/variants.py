"""The trained models of Garment4D's ablations: what each changes in the full posed stage."""

from collections.abc import Mapping
from typing import Any

# Variant -> group -> setting -> value, laid over the experiment's settings of the posed stage.
POSED_VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "posed": {},
    "no_body_encoder": {"network": {"body_encoder": False}},
    "no_transformer": {"network": {"transformer": "none"}},
    # Without what the default adds to the paper's posed stage, and with the released code's loss.
    "as_printed": {
        "network": {"pull_neighbours": 0, "smooth_passes": 0},
        "loss": {"interpenetration": 100},
    },
    # Weights of the nearest body vertex, as in SMPL+D.
    "nearest_weights": {"skinning": {"neighbours": 1, "passes": 0}},
}


def posed_variants(
    settings: Mapping[str, Mapping[str, Any]],
) -> dict[str, dict[str, dict[str, Any]]]:
    """Variant -> group -> setting -> value: the full model, and what differs from these settings.

    Args:
        settings: of the experiment's posed stage, by group; a setting that they lack differs.
    """
    return {
        name: changes
        for name, changes in POSED_VARIANTS.items()
        if not changes
        or any(
            settings.get(group, {}).get(key) != value
            for group, values in changes.items()
            for key, value in values.items()
        )
    }
