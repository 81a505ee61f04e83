from drapeline.experiment.cloth_solvers import OUR_SOLVER
from drapeline.models.garment4d.plan import PROTOCOLS, Garment4dFiles
from drapeline.outfits.garment_types import GARMENTS

GARMENT4D = Garment4dFiles(FILES.learned_by("garment4d"))
RECONSTRUCT = config["garment4d"]["reconstruct"]


wildcard_constraints:
    protocol="|".join(PROTOCOLS),
    garment="|".join(GARMENTS),


def own_template(wildcards):
    """The user's own OBJ that garments of this type are registered to."""
    own = config["garment4d"]["template"]["files"].get(wildcards.garment)
    return {"own": own} if own else {}


def cloud_settings(wildcards):
    """How point clouds are taken; static outfits in motion follow the config's protocol."""
    return {
        "protocol": wildcards.get("protocol", config["garment4d"]["protocol"]),
        **config["garment4d"]["clouds"],
        "seed": config["seed"],
    }


def shard_garments(wildcards):
    """Input function: where the garments of a shard are at rest."""
    at_rest = GROUPS[wildcards.group].at_rest
    return (OUTFITS if at_rest else SAMPLE).format(**wildcards)


def is_simulated(wildcards):
    """Params function: whether a shard has simulated samples."""
    return not GROUPS[wildcards.group].at_rest


def own_scans(wildcards):
    """The scans to reconstruct a garment from, and the body in them."""
    missing = [key for key in ("points", "body") if RECONSTRUCT[key] is None]
    if missing:
        raise WorkflowError(
            f"garment4d.reconstruct.{missing[0]} is not set, expected the path of your"
            f" {'point clouds' if missing[0] == 'points' else 'body parameters'}"
        )
    return {key: RECONSTRUCT[key] for key in ("points", "body")}
