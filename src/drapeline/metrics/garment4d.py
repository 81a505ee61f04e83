"""Metrics and variants of Garment4D."""

from drapeline.metrics.metric import Metric, Variant

MODEL = "garment4d"
METRICS = {
    "canonical_error_mm": Metric("mm", "Canonical vertex error"),
    "canonical_to_original_mm": Metric("mm", "To the garment as simulated"),
    "off_surface_mm": Metric("mm", "Along the surface's normals"),
    "along_surface_mm": Metric("mm", "Along the surface"),
    "velocity_error_m_s": Metric("m/s", "Velocity error", 2),
    "acceleration_error_m_s2": Metric("m/s²", "Acceleration error", 2),
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
        "regression": Variant("Regression alone, which Garment4D's network starts from here"),
        "pointnet": Variant("PN++ (baseline)"),
        "canonical": Variant("Garment4D, canonical stage"),
        "still": Variant("A garment that never moves"),
        "lbs": Variant("Interpolated skinning"),
        "untrained": Variant("Garment4D, posed stage, untrained"),
        "mgn": Variant("MGN* (baseline)"),
        "posed": Variant("Garment4D, posed stage"),
        "ours": Variant("Our final step"),
        "ours_true_labels": Variant("Our final step, given the true labels", competes=False),
        "ours_true_rest": Variant("Our final step, given the true garment at rest", competes=False),
        "no_body_encoder": Variant("Without body surface encoder"),
        "no_transformer": Variant("Without temporal transformer"),
        "as_printed": Variant("With displacements as in the paper"),
        "nearest_weights": Variant("Trained with weights of the nearest body vertex"),
        "vertex_sampled": Variant("Given mesh vertices as points"),
        "pointnet_noisy_body": Variant("PN++ (baseline)"),
        "canonical_noisy_body": Variant("Garment4D, canonical stage"),
        "lbs_noisy_body": Variant("Interpolated skinning"),
        "mgn_noisy_body": Variant("MGN* (baseline)"),
        "noisy_body": Variant("Garment4D, posed stage"),
        "ours_noisy_body": Variant("Our final step"),
        "neighbours_*": Variant("K = {}"),
        "missing_*": Variant("{} % of the points missing"),
        "accuracy_*": Variant("{} % of the labels right"),
    },
    "representation": {
        "garment4d_pca": Variant("PCA of Garment4D's templates"),
        "template_registered": Variant("No code: registered to the template", competes=False),
    },
    "scan": {
        "garment4d_scan_pca": Variant(
            "PCA of Garment4D's templates, fitted components", short="Garment4D:\ncomponents"
        ),
        "garment4d_scan_moved": Variant(
            "PCA of Garment4D's templates, skinned, then moved to the points"
        ),
        "garment4d_scan_posed": Variant("Garment4D's networks", short="Garment4D:\nnetworks"),
        "garment4d_scan_ours": Variant(
            "Garment4D's networks, then moved to the points", short="Garment4D:\nmoved"
        ),
    },
}
