"""workflow/config/paper.yaml takes what the papers and the released code print."""

from functools import reduce

import pytest
import yaml

from drapeline.experiment.config import fill_settings
from toys.paper import PAPER
from toys.schema import SCHEMA

_NETWORK = {
    **{"widths": [16, 32, 64, 64, 128, 128], "latent": 128, "order": 1},
    **dict.fromkeys(("linear_path", "topology_moments", "masked_input", "vertex_output"), False),
}
_TRAINING = {"learning_rate": 0.001, "schedule": "constant"}
_WINDOWS = {**_TRAINING, "epochs": 100, "frames": 10, "stride": 10}
PRINTED = {
    "simulation.settings": {"steps_min": 14, "steps_max": 20},
    "groups.static": {"count": 30_000},
    "gcvae.loss": {
        **{"normals": 70, "mask": 0.1, "condition": 1},
        **{"kl_start": 1e-4, "kl_flat_share": 0.5, "kl_rise": 0.005, "kl_max": 0.25},
        "kl_selection": 0.1,
        **{"mask_form": "l1", "offsets_form": "l1", "offsets_within": "mask"},
    },
    "gcvae.svae.network": _NETWORK,
    "gcvae.dvae.network": _NETWORK,
    "gcvae.svae.training": {**_TRAINING, "batch": 32, "steps": 75_000},
    "gcvae.dvae.training": {**_TRAINING, "batch": 32},
    "gcvae.dvae": {"static_model": "svae"},
    "gcvae.sampling": {"settle": False},
    "garment4d.clouds": {"points": 6890},
    "garment4d.skinning": {"neighbours": 256, "passes": 100, "power": 1},
    "garment4d.canonical.network": {"width": 1},
    "garment4d.canonical.loss": {
        **{"segmentation": 0.05, "coefficients": 0.001, "vertices": 40, "interpenetration": 50},
        **{"laplacian": 1, "laplacian_form": "paper", "balance": 0},
    },
    "garment4d.canonical.training": {**_WINDOWS, "batch": 20},
    "garment4d.posed.network": {
        **{"iterations": 3, "hidden": 128, "layers": 4, "features": 32, "ball_layers": 2},
        **{"pull_neighbours": 0, "smooth_passes": 0, "transformer": "paper"},
        **{"garment_radii_m": [0.1, 0.2, 0.4], "garment_counts": [32, 16, 8]},
        **{"body_radii_m": [0.1, 0.2, 0.4], "body_counts": [8, 16, 32]},
    },
    "garment4d.posed.loss": {
        **{"vertices": 20, "interpenetration": 100, "laplacian": 10, "temporal": 5},
        **{"laplacian_form": "paper", "temporal_form": "paper"},
    },
    "garment4d.posed.training": {**_WINDOWS, "batch": 4},
    "garment4d.mgn.network": {"widths": [512, 1024, 2048], "scale_m": 0.05},
    "garment4d.mgn.training": {**_WINDOWS, "batch": 4},
    "smplicit.loss": {"d_max_m": 0.01},
    "smplicit.gallery": {"simulate": False, "skinning": "nearest", "push_out": False},
    "smplicit.fit_images": {
        **{"neighbours": 1, "smoothing": 0, "hang_frames": 0, "clearance": False},
    },
    "smplicit.fit_scans": {"neighbours": 1, "uncovered_weight": 1, "hang_frames": 0},
}


@pytest.fixture(scope="module")
def paper():
    return fill_settings(yaml.safe_load(PAPER.read_text()), SCHEMA, PAPER.name)


@pytest.mark.parametrize("path", PRINTED)
def test_printed_values_are_taken(paper, path):
    taken = reduce(lambda part, key: part[key], path.split("."), paper)
    assert {key: taken[key] for key in PRINTED[path]} == PRINTED[path]
