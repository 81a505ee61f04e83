from drapeline.models.smplicit.garments import FIELD_MODELS, MODEL_OF_GARMENT
from drapeline.models.smplicit.pictures.files import files_of_picture, picture_files

SMPLICIT = f"{RESULTS}/smplicit"
SMPLICIT_MODELS = config["smplicit"]["models"]
FIELDS = f"{SMPLICIT}/fields/{{group}}/{{shard}}.npz"
GALLERY = config["smplicit"]["gallery"]
# How the cloth solver lets decoded garments hang on people.
HANGING = {
    "edge_length_m": config["outfits"]["edge_length_m"],
    "simulation": config["simulation"]["settings"],
}
METRIC_TABLES["metrics"] += [f"smplicit_{model}" for model in SMPLICIT_MODELS]
# Types on which all models are compared, as far as a model here has learned them.
SMPLICIT_COMPARED = [
    garment
    for garment in COMPARED_GARMENTS
    if MODEL_OF_GARMENT[garment] in SMPLICIT_MODELS
]
if SMPLICIT_COMPARED:
    METRIC_TABLES["representations"] += ["representations_smplicit"]


def wears_known_garment(planned):
    """Whether a planned sample wears a garment that a model here learns."""
    garments = planned.outfit_type.split("+")
    return any(MODEL_OF_GARMENT[garment] in SMPLICIT_MODELS for garment in garments)


# Held-out samples whose garments are looked for in pictures of them: some of each group, but of
# those that are published any.
PICTURED = [
    plan.sample
    for group in PUBLISHED
    for plan in group.plans
    if plan.split == EVALUATED_SPLITS[0] and wears_known_garment(plan)
]
PICTURED_OTHERS = [
    sample
    for sample in first_of_split(
        config["smplicit"]["evaluate_images"]["others"],
        EVALUATED_SPLITS[0],
        wears_known_garment,
    )
    if not GROUPS[PLACES[sample]["group"]].published
]
if PICTURED or PICTURED_OTHERS:
    METRIC_TABLES["metrics"] += ["smplicit_images"]
if SCAN_FILES:
    METRIC_TABLES["scans"] += ["scans_smplicit"]
SEGMENTED = config["smplicit"]["scans"]
try:
    # The user's own, by name.
    PICTURES = {
        file.stem: str(file) for file in picture_files(config["smplicit"]["images"])
    }
except InputError as error:
    raise WorkflowError(str(error)) from None


# Where the fields of each garment type are defined.
FIELD_BOXES = {
    garment: FIELD_MODELS[model].box for garment, model in MODEL_OF_GARMENT.items()
}


wildcard_constraints:
    field="|".join(FIELD_MODELS),
    picture="|".join(map(re.escape, PICTURES)) or "no picture",


def field_garments(wildcards):
    """Params function: the garment types of a model."""
    return FIELD_MODELS[wildcards.field].garments


def field_shards(wildcards):
    """Input function: fields of all outfits, once the plan is known to fill the splits."""
    static_data("train", "val")(wildcards)
    return per_shard(FIELDS, RESTING)


def field_settings(wildcards):
    """Params function: settings of a training, by group."""
    chosen = {key: config["smplicit"][key] for key in ("network", "loss", "training")}
    space = chosen["training"]["space"] * FIELD_MODELS[wildcards.field].space_share
    chosen["training"] = {**chosen["training"], "space": space, "seed": config["seed"]}
    return chosen


def encoder_weights(wildcards):
    """Input function: the file that the image encoder starts from, if there is one."""
    return config["smplicit"]["network"]["encoder_weights"] or []


def gallery_sample(wildcards):
    """Params function: the sample whose motion garments are put on."""
    sample = GALLERY["sample"] or next(iter(MOVING_PLANS), None)
    if sample not in MOVING_PLANS:
        raise WorkflowError(
            f"smplicit.gallery.sample: '{sample}', expected one of the samples, such as"
            f" {next(iter(MOVING_PLANS), None)}"
        )
    return sample


def gallery_body(wildcards):
    """Input function: the shard with its body in motion."""
    place = PLACES[gallery_sample(wildcards)]
    return f"{RESULTS}/bodies/{{group}}/{{shard}}".format(**place)


def own_picture(wildcards):
    """Input function: a picture's JSON, first of all, and the images that it names."""
    try:
        files = [*map(str, files_of_picture(PICTURES[wildcards.picture]))]
    except InputError as error:
        raise WorkflowError(str(error)) from None
    return {"picture": files[0], "images": files[1:]}


def own_pictures(wildcards):
    """Input function: what is made of all of the user's pictures."""
    if not PICTURES:
        raise WorkflowError(
            "smplicit.images is empty, expected a .json for each of your pictures, or folders of"
            " them"
        )
    return expand(
        [f"{SMPLICIT}/images/{{picture}}", f"{SMPLICIT}/images/{{picture}}.png"],
        picture=PICTURES,
    )


def segmented_scans(wildcards):
    """Input function: the user's segmented scans and the body in them."""
    missing = [key for key in ("points", "body") if SEGMENTED[key] is None]
    if missing:
        raise WorkflowError(
            f"smplicit.scans.{missing[0]} is not set, expected a path; docs/how-to/own-scans.md"
            " says what belongs there"
        )
    return {key: SEGMENTED[key] for key in ("points", "body")}


def scan_models(wildcards):
    """Input function: the models of the garments in the user's scans."""
    wanted = {MODEL_OF_GARMENT[garment] for garment in SEGMENTED["garments"]}
    missing = sorted(wanted - set(SMPLICIT_MODELS))
    if missing or not wanted:
        raise WorkflowError(
            f"smplicit.scans.garments is {SEGMENTED['garments']}, expected garments of the models"
            f" in smplicit.models: {', '.join(SMPLICIT_MODELS)}"
        )
    return expand(f"{SMPLICIT}/{{field}}", field=sorted(wanted))
