"""Metrics and variants of the garment VAEs and of masked PPCA."""

from drapeline.metrics.metric import Metric, Variant

# Of a number of the code that is in use, over garments: Burda et al., "Importance weighted
# autoencoders", 2016, section 5.2.
ACTIVE_VARIANCE = 0.01
METRICS = {
    "kl_nat": Metric("nat", "KL", 2, better=""),
    "active_units": Metric("", "Active units", 0, better=""),
    # As CLOTH3D prints them: its angles are in radians, and its KL loss has no unit.
    "normal_error_rad": Metric("rad", "Normals error", 2),
    "kl_loss": Metric("", "KL loss", 4, better=""),
}
_PPCA = "Masked PPCA (ours)"
_UNSEEN = ", z = 0"
VARIANTS = {
    "svae": {
        "svae": Variant("Garment VAE"),
        "svae_no_normals": Variant("Garment VAE without normals"),
        "svae_no_mask": Variant("Garment VAE without mask"),
        "svae_no_cvar": Variant("Garment VAE without regressing conditional variables"),
        "svae_uniform_pooling": Variant("Garment VAE with default pooling"),
        "svae_no_linear_path": Variant("Garment VAE of graph convolutions alone"),
        "svae_shared_moments": Variant("Garment VAE with one mean and deviation for all garments"),
        "svae_unmasked_input": Variant("Garment VAE whose encoder is not shown the mask"),
        "svae_shared_output": Variant("Garment VAE with a graph convolution as its last layer"),
        "svae_as_printed": Variant(
            "Garment VAE as printed, without any of these and with its loss"
        ),
        "svae_*": Variant("Garment VAE, {} numbers"),
    },
    "dvae": {
        f"dvae_{version}_{frames}{end}": Variant(
            f"Garment VAE, {offsets}, {frames} frame{'s' * (frames > 1)}{known}"
        )
        for end, known in (("", ""), ("_prior", _UNSEEN))
        for version, offsets in (("posed", "X = C - T"), ("unposed", "X_new"))
        for frames in (1, 4)
    },
    "ppca": {
        "static_ppca": Variant(_PPCA),
        "static_ppca_*": Variant(f"{_PPCA}, {{}} numbers"),
        "dynamic_ppca": Variant(_PPCA),
        "dynamic_ppca_settled": Variant(f"{_PPCA}, smoothed and pushed out of the body"),
        "dynamic_ppca_prior": Variant(f"{_PPCA}{_UNSEEN}"),
    },
    "mlp": {"wrinkle_mlp": Variant("Network from motion to wrinkles (ours)")},
    "picture": {
        "picture_network": Variant("Garment VAE's code from the picture"),
        "picture_nearest": Variant("Code of the training garment in the nearest picture"),
        "picture_untrained": Variant("The same network, untrained"),
        "picture_mean_code": Variant("Mean code of the class"),
        "picture_mean_garment": Variant("Mean garment of the class"),
        "picture_registered": Variant("Code of the true garment, registered", competes=False),
    },
    "representation": {
        "static_ppca": Variant(_PPCA),
        "svae": Variant("Garment VAE"),
        "svae_*": Variant("Garment VAE, {} numbers"),
        "body_pca": Variant("PCA of offsets"),
        "static_ppca_*": Variant(f"{_PPCA}, {{}} numbers"),
        "body_pca_*": Variant("PCA of offsets, {} numbers"),
        "mean_garment": Variant("Mean garment of the type"),
        "nearest_cvar": Variant("Nearest training garment in shape, gender and tightness"),
        "body_registered": Variant("No code: registered to the body", competes=False),
    },
    "moved": {
        "moved_wrinkle_mlp": Variant("Network from motion to wrinkles (ours)"),
        "moved_dynamic_ppca": Variant(_PPCA),
        "moved_dvae_unposed_4": Variant("Garment VAE, X_new, 4 frames"),
    },
    "scan": {
        "static_ppca_scan": Variant(f"{_PPCA}, fitted code", short="Masked PPCA:\ncode"),
        "static_ppca_scan_moved": Variant(f"{_PPCA}, skinned, then moved to the points"),
        "svae_scan": Variant("Garment VAE, fitted code", short="Garment VAE:\ncode"),
        "svae_scan_moved": Variant("Garment VAE, skinned, then moved to the points"),
    },
}
