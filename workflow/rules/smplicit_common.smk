from drapeline.models.smplicit.garments import FIELD_MODELS, MODEL_OF_GARMENT
from drapeline.models.smplicit.plan import SmplicitFiles

SMPLICIT = SmplicitFiles(FILES.learned_by("smplicit"))
SEGMENTED = config["smplicit"]["scans"]
# Where the fields of each garment type are defined.
FIELD_BOXES = {
    garment: FIELD_MODELS[model].box for garment, model in MODEL_OF_GARMENT.items()
}


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
