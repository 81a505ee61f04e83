"""Metrics and variants of Garment4D."""

from drapeline.metrics.metric import Metric, Variant

MODEL = "garment4d"
# Models that are also given worse inputs, and how these are worse.
COMPARED = {
    "lbs": "Interpolated skinning",
    "mgn": "MGN* (baseline)",
    "posed": "Garment4D, posed stage",
    "ours": "Ours",
}
DEGRADED = {
    "undegraded": "the same sequences as they are",
    "missing_*": "{} % of the points missing",
    "accuracy_*": "given labels of which {} % are right",
    "body_noise_*": "poses off by {} mrad",
    "point_noise_*": "points off by {} mm",
    "views_*": "number of cameras: {}",
    "frame_rate_*": "{} frames per second",
}
METRICS = {
    "canonical_error_mm": Metric("mm", "Canonical vertex error"),
    "canonical_to_original_mm": Metric("mm", "To the garment as simulated"),
    "off_surface_mm": Metric("mm", "Along the surface's normals"),
    "along_surface_mm": Metric("mm", "Along the surface"),
    "velocity_error_m_s": Metric("m/s", "Velocity error", 2),
    "acceleration_error_m_s2": Metric("m/s²", "Acceleration error", 2),
    "slow_motion": Metric("", "Below 2 Hz", 2, better=""),
    "quick_motion": Metric("", "2 to 5 Hz", 2, better=""),
    "fast_motion": Metric("", "Above 5 Hz", 2, better=""),
    # Rises with holes in the cloud, even for a perfect garment.
    "to_cloud_mm": Metric("mm", "To the cloud", 2, better=""),
    "inference_s_per_frame": Metric("ms", "Time per frame", 1, 1000),
}
VARIANTS = {
    MODEL: {
        "truth": Variant("Ground truth itself, as registered", competes=False),
        "pca": Variant("True coefficients: the best of the garment space", competes=False),
        "mean_garment": Variant("Mean garment of the type"),
        "one_label": Variant("Most common training label"),
        "label_by_vertex": Variant("Most common training label at the nearest vertex of the body"),
        "pointnet": Variant("PN++ (baseline)"),
        "canonical_untrained": Variant("Garment4D, canonical stage, untrained"),
        "canonical": Variant("Garment4D, canonical stage"),
        "still": Variant("A garment that never moves"),
        "lbs": Variant(COMPARED["lbs"]),
        "untrained": Variant("Garment4D, posed stage, untrained"),
        "mgn": Variant(COMPARED["mgn"]),
        "posed": Variant(COMPARED["posed"]),
        "regression": Variant("Ours, the first guess"),
        "ours_proposals": Variant("Ours, before it is laid on the points"),
        "ours": Variant(COMPARED["ours"]),
        "ours_true_labels": Variant("Ours, given the true labels", competes=False),
        "ours_true_rest": Variant("Ours, given the true garment at rest", competes=False),
        "again_rest_shape": Variant(
            "True garment, its rest shape changed by 1 mm, simulated again", competes=False
        ),
        "again_other_solver": Variant("True garment, simulated by the fast solver", competes=False),
        "no_body_encoder": Variant("Without body surface encoder"),
        "no_transformer": Variant("Without temporal transformer"),
        "released_loss": Variant("With the loss of the released code"),
        "pulled": Variant("Also drawn to the points, and averaged over frames"),
        "mgn_pulled": Variant("MGN*, also drawn to the points, and averaged over frames"),
        "nearest_weights": Variant("Trained with weights of the nearest body vertex"),
        "vertex_sampled": Variant("Given mesh vertices as points"),
        "neighbours_*": Variant("K = {}"),
        **{
            f"{name}_{degraded}": Variant(f"{title}, {how}")
            for name, title in COMPARED.items()
            for degraded, how in DEGRADED.items()
        },
    },
    "representation": {
        "garment4d_pca": Variant("PCA of Garment4D's templates"),
        "garment4d_pca_*": Variant("PCA of Garment4D's templates, {} numbers"),
        "template_registered": Variant("No code: registered to the template", competes=False),
    },
    "moved": {
        "moved_interpolated": Variant("Garment4D, interpolated skinning"),
    },
    "scan": {
        "garment4d_scan_pca": Variant(
            "PCA of Garment4D's templates, fitted components", short="Garment4D:\ncomponents"
        ),
        "garment4d_scan_moved": Variant(
            "PCA of Garment4D's templates, skinned, then moved to the points"
        ),
        "garment4d_scan_posed": Variant("Garment4D's networks", short="Garment4D:\nnetworks"),
        "garment4d_scan_ours": Variant("Our model of Garment4D's inputs", short="Ours:\nlaid"),
    },
}
