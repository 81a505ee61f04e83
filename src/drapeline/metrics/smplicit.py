"""Metrics and variants of SMPLicit."""

from drapeline.metrics.metric import LARGER, Metric, Variant

MODEL = "smplicit"
METRICS = {
    "field_near_mm": Metric("mm", "Near the surface", 2),
    "field_space_mm": Metric("mm", "In the whole box", 2),
    "walls_to_true_mm": Metric("mm", "To the true garment"),
    "true_to_walls_mm": Metric("mm", "From the true garment"),
    "silhouette_iou": Metric("", "Silhouette IoU", 2, better=LARGER),
    "better_than_mean_share": Metric("%", "Better than the mean code", 0, 100, better=LARGER),
    "fit_s": Metric("s", "Time of the fit"),
}
# Part of the body -> title; each has a model of its own.
PARTS = {
    "upper": "Upper body: t-shirts and tops",
    "trousers": "Trousers",
    "skirt": "Skirts",
    "whole": "Whole body: dresses and jumpsuits (not in the paper)",
}
_HELD = {
    "fitted": Variant("SMPLicit, fitted code"),
    "nearest_cut": Variant("Nearest training garment in z_cut"),
    "nearest_style": Variant("Nearest training garment in z_style"),
    "mean_code": Variant("SMPLicit, mean code"),
    "untrained": Variant("Untrained network, fitted code"),
    "constant": Variant("Median distance"),
}
_PICTURED = {
    "hung": Variant("Hung: of three outfits the one most like the picture (ours)"),
    "nearest_hung": Variant("Training code with the least loss, hung as well"),
    "mean_code_hung": Variant("Mean code of the class, hung as well"),
    "fitted": Variant("Fitted code, skinned"),
    "fitted_in_pair": Variant("Fitted code, skinned; two people, one behind the other"),
    "nearest": Variant("Training code with the least loss, skinned"),
    "mean_code": Variant("Mean code of the class, skinned"),
}
VARIANTS = {
    MODEL: {
        f"{MODEL}_{part}_{name}": held._replace(group=title)
        for part, title in PARTS.items()
        for name, held in _HELD.items()
    }
    | {f"{MODEL}_images_{name}": pictured for name, pictured in _PICTURED.items()},
    "representation": {
        MODEL: Variant("SMPLicit, fitted code"),
        f"{MODEL}_*": Variant("SMPLicit, fitted code, {} numbers"),
    },
    "moved": {
        "moved_nearest": Variant("SMPLicit, skinned by the body's nearest vertex"),
        "moved_smoothed": Variant("Skinned by smoothed weights"),
    },
    "scan": {
        "smplicit_scan_start": Variant(
            "SMPLicit, mean code on the estimated body (the start)", short="SMPLicit:\nthe start"
        ),
        "smplicit_scan_nearest": Variant("SMPLicit, training code with the least loss"),
        "smplicit_scan_code": Variant("SMPLicit, fitted code"),
        "smplicit_scan_joint": Variant(
            "SMPLicit, code and body fitted jointly", short="SMPLicit:\ncode and body"
        ),
        "smplicit_scan_moved": Variant(
            "SMPLicit, skinned, then moved to the points", short="SMPLicit:\nskinned, moved"
        ),
        "smplicit_scan_nearest_hung": Variant("SMPLicit, training code with the least loss, hung"),
        "smplicit_scan_hung": Variant(
            "SMPLicit, code fitted again to cloth that hangs", short="SMPLicit:\nhung"
        ),
        "smplicit_scan_hung_moved": Variant(
            "SMPLicit, hung, then moved to the points", short="SMPLicit:\nhung, moved"
        ),
    },
}
