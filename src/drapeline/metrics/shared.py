"""Metrics and variants that are of no single model."""

from drapeline.metrics.metric import LARGER, Metric, Variant

# What models of rows are called that compare all systems.
REPRESENTATION, MOVED = "representation", "moved"
SCAN, CLEAN_SCAN, WORSE_SCAN = "scan", "clean_scan", "worse_scan"
# The surface error of garments that a model has learned from: it stands beside that of others.
TRAINING_ERROR = "training_error_mm"
METRICS = {
    "surface_error_mm": Metric("mm", "Surface error"),
    TRAINING_ERROR: Metric("mm", "On training garments", better=""),
    "normal_error_deg": Metric("deg", "Normals error"),
    "mask_iou": Metric("", "Mask IoU", 3, better=LARGER),
    "predicted_to_true_mm": Metric("mm", "Predicted to true"),
    "true_to_predicted_mm": Metric("mm", "True to predicted"),
    "inside_share": Metric("%", "Inside the body", 2, 100),
    "inside_1cm_share": Metric("%", "Deeper than 1 cm", 2, 100),
    "inside_depth_mm": Metric("mm", "Deepest"),
    "pieces": Metric("", "Pieces", 2, better=""),
    "surface_to_true_mm": Metric("mm", "To the true garment"),
    "true_to_surface_mm": Metric("mm", "From the true garment"),
    "openings_right": Metric("%", "Right openings", 0, 100, better=LARGER),
    "rest_to_true_mm": Metric("mm", "At rest, to the true garment"),
    "true_to_rest_mm": Metric("mm", "At rest, from the true garment"),
    "code_numbers": Metric("", "Numbers of the code", 0, better=""),
    "vertex_error_mm": Metric("mm", "Vertex error"),
    "segmentation_accuracy": Metric("%", "Right labels", 1, 100, better=LARGER),
}
VARIANTS = {
    "baseline": {
        "mean_garment": Variant("Mean garment of the type"),
        "nearest_cvar": Variant("Nearest training garment in shape, gender and tightness"),
        "pca": Variant("PCA of offsets"),
        "wrinkle_pca": Variant("PCA of wrinkles"),
        "wrinkle_ridge": Variant("Ridge regression of wrinkles on pose, motion and static code"),
        "skinned_mean": Variant("True garment at rest with the type's mean wrinkles, skinned"),
        "skinned_static": Variant("True garment at rest, skinned"),
        "skinned_mean_garment": Variant("Mean garment of the type with mean wrinkles, skinned"),
    },
    "truth": {
        "registered": Variant("Ground truth itself", competes=False),
        "moving": Variant("Ground truth itself", competes=False),
        "again_rest_shape": Variant(
            "The same garment, its rest shape changed by 1 mm, simulated again", competes=False
        ),
        "again_other_solver": Variant(
            "The same garment, simulated by the fast solver", competes=False
        ),
    },
    MOVED: {
        "again_rest_shape": Variant(
            "Simulated again by its own solver, its rest shape changed by 1 mm", competes=False
        ),
        "again_other_solver": Variant("Simulated by the fast solver", competes=False),
    },
    SCAN: {
        "scan_body_estimated": Variant("Body as estimated"),
        "scan_body_fitted": Variant("Body fitted to the scan"),
        "scan_body_joint": Variant("Body fitted again, jointly with SMPLicit's codes"),
    },
}
