"""The trained models of Garment4D's ablations: what each changes in the full posed stage."""

from typing import Any

# Variant -> group -> setting -> value, laid over the experiment's settings of the posed stage.
POSED_VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "posed": {},
    "no_body_encoder": {"network": {"body_encoder": False}},
    "no_transformer": {"network": {"transformer": "none"}},
    # What the default adds to the paper's posed stage; no change where the experiment adds nothing.
    "as_printed": {"network": {"pull_neighbours": 0, "smooth_passes": 0}},
    # Weights of the nearest body vertex, as in SMPL+D.
    "nearest_weights": {"skinning": {"neighbours": 1, "passes": 0}},
}
