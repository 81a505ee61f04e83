from drapeline.models.smplicit.variants import MODEL_OF_GARMENT

SMPLICIT = f"{RESULTS}/smplicit"
SMPLICIT_MODELS = config["smplicit"]["models"]
METRIC_TABLES["metrics"] += [f"smplicit_{model}" for model in SMPLICIT_MODELS]
# Types on which all models are compared, as far as a model here has learned them.
SMPLICIT_COMPARED = [
    garment
    for garment in COMPARED_GARMENTS
    if MODEL_OF_GARMENT[garment] in SMPLICIT_MODELS
]
if SMPLICIT_COMPARED:
    METRIC_TABLES["representations"] += ["representations_smplicit"]


def field_settings(wildcards):
    """Params function: settings of a training, by group."""
    chosen = {key: config["smplicit"][key] for key in ("network", "loss", "training")}
    chosen["training"] = {**chosen["training"], "seed": config["seed"]}
    return chosen


def encoder_weights(wildcards):
    """Input function: the file that the image encoder starts from, if there is one."""
    return config["smplicit"]["network"]["encoder_weights"] or []
