from drapeline.models.smplicit.variants import FIELD_MODELS, MODEL_OF_GARMENT

SMPLICIT = f"{RESULTS}/smplicit"
SMPLICIT_MODELS = config["smplicit"]["models"]
GALLERY = config["smplicit"]["gallery"]
METRIC_TABLES["metrics"] += [f"smplicit_{model}" for model in SMPLICIT_MODELS]
# Types on which all models are compared, as far as a model here has learned them.
SMPLICIT_COMPARED = [
    garment
    for garment in COMPARED_GARMENTS
    if MODEL_OF_GARMENT[garment] in SMPLICIT_MODELS
]
if SMPLICIT_COMPARED:
    METRIC_TABLES["representations"] += ["representations_smplicit"]


# Where the fields of each garment type are defined.
FIELD_BOXES = {
    garment: FIELD_MODELS[model].box for garment, model in MODEL_OF_GARMENT.items()
}


wildcard_constraints:
    field="|".join(FIELD_MODELS),


def field_garments(wildcards):
    """Params function: the garment types of a model."""
    return FIELD_MODELS[wildcards.field].garments


def field_shards(wildcards):
    """Input function: fields of all outfits, once the plan is known to fill the splits."""
    static_data("train", "val")(wildcards)
    return expand(f"{RESULTS}/static/fields/{{shard}}.npz", shard=STATIC)


def field_settings(wildcards):
    """Params function: settings of a training, by group."""
    chosen = {key: config["smplicit"][key] for key in ("network", "loss", "training")}
    space = chosen["training"]["space"] * FIELD_MODELS[wildcards.field].space_share
    chosen["training"] = {**chosen["training"], "space": space, "seed": config["seed"]}
    return chosen


def encoder_weights(wildcards):
    """Input function: the file that the image encoder starts from, if there is one."""
    return config["smplicit"]["network"]["encoder_weights"] or []


def gallery_body(wildcards):
    """Input function: the body in motion that garments are put on."""
    sample = GALLERY["sample"] or next(iter(SAMPLES))
    if sample not in SAMPLES:
        raise WorkflowError(
            f"smplicit.gallery.sample: '{sample}', expected one of the samples,"
            f" {next(iter(SAMPLES))} to {list(SAMPLES)[-1]}"
        )
    return f"{RESULTS}/bodies/{sample}.npz"
