from drapeline.models.smplicit.garments import FIELD_MODELS, MODEL_OF_GARMENT
from drapeline.models.pictures.files import files_of_picture, picture_files
from drapeline.models.smplicit.plan import SmplicitFiles

SMPLICIT = SmplicitFiles(FILES)
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
    picture="|".join(map(re.escape, PICTURES)) or "no picture",


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
    images = f"{SMPLICIT.folder}/images"
    return expand(
        [f"{images}/{{picture}}", f"{images}/{{picture}}.png"], picture=PICTURES
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
    missing = sorted(wanted - set(SMPLICIT.names))
    if missing or not wanted:
        raise WorkflowError(
            f"smplicit.scans.garments is {SEGMENTED['garments']}, expected garments of the models"
            f" in smplicit.models: {', '.join(SMPLICIT.names)}"
        )
    return [f"{SMPLICIT.folder}/{name}" for name in sorted(wanted)]
