from drapeline.experiment.checks import (
    planned_sequences,
    require_sequences,
    require_simulated,
)
from drapeline.models.garment4d.settings import posed_variants
from drapeline.models.training.settings import override_settings

G4D = f"{RESULTS}/garment4d"
# Garment types that the networks learn, one network of each stage for each type.
G4D_GARMENTS = config["garment4d"]["garments"]
# In figures of a single type; skirts move most.
SHOWN_GARMENT = "Skirt" if "Skirt" in G4D_GARMENTS else G4D_GARMENTS[0]
# Shards of outfits at rest that the networks learn from besides simulated samples.
SKINNED = [(group.name, shard) for group in RESTING for shard in group.shards]
SKINNED = SKINNED[: config["garment4d"]["skinned"]["shards"]]
# Samples that wear one of these types.
TEMPLATE_WEARERS = [
    sample
    for sample, planned in MOVING_PLANS.items()
    if set(planned.outfit_type.split("+")) & set(G4D_GARMENTS)
]
TEMPLATES = {garment: f"{G4D}/{garment}/template.npz" for garment in G4D_GARMENTS}
FITS = f"{G4D}/fits/{{group}}/{{shard}}"
FITS_AT_REST = per_shard(FITS, RESTING)
TEMPLATE_FITS = [
    *[FITS.format(group=group, shard=shard) for group, shard in SKINNED],
    *shards_of(FITS, TEMPLATE_WEARERS),
]
PROTOCOL = config["garment4d"]["protocol"]
# Sequences of each type, sampled as the config says.
SEQUENCES = {garment: f"{G4D}/{garment}/data_{PROTOCOL}" for garment in G4D_GARMENTS}
# Whether networks ask where on the known body points are.
BODY_RELATIVE_POINTS = config["garment4d"]["canonical"]["network"][
    "body_relative_points"
]
POSED_VARIANTS = posed_variants(config["garment4d"]["posed"])
# Which trained models of the posed stage each evaluation holds.
POSED_MODELS = {"default": ["posed"], "ablations": list(POSED_VARIANTS)}
METRIC_TABLES["metrics"] += [f"garment4d_{garment}_default" for garment in G4D_GARMENTS]
METRIC_TABLES["representations"] += ["representations_garment4d"]
if SCAN_FILES:
    METRIC_TABLES["scans"] += ["scans_garment4d"]
METRIC_TABLES["metrics_garment4d_ablations"] = [
    f"garment4d_{garment}_ablations" for garment in G4D_GARMENTS
]
RECONSTRUCT = config["garment4d"]["reconstruct"]


wildcard_constraints:
    protocol="surface|vertices",
    garment="|".join(G4D_GARMENTS),
    canonical="canonical|pointnet",
    posed="|".join([*POSED_VARIANTS, "mgn"]),
    models="|".join(POSED_MODELS),


def own_template(wildcards):
    """The user's own OBJ that garments of this type are registered to."""
    own = config["garment4d"]["template"]["files"].get(wildcards.garment)
    return {"own": own} if own else {}


def cloud_settings(wildcards):
    """How point clouds are taken; static outfits in motion follow the config's protocol."""
    return {
        "protocol": wildcards.get("protocol", PROTOCOL),
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


def garment_sequences(wildcards):
    """Clouds of one protocol; those of outfits at rest follow the config's."""
    skinned = SKINNED if wildcards.protocol == PROTOCOL else []
    clouds = f"{G4D}/clouds_{wildcards.protocol}/{{group}}/{{shard}}"
    return {
        "samples": shards_of(SAMPLE, TEMPLATE_WEARERS),
        "clouds": shards_of(clouds, TEMPLATE_WEARERS),
        "skinned": [f"{G4D}/skinned/{group}/{shard}" for group, shard in skinned],
        "outfits": [
            OUTFITS.format(group=group, shard=shard) for group, shard in skinned
        ],
    }


def stage_sequences(stage=None):
    """Input function: sequences of a type, after a check that the plan has enough for a stage.

    Without a stage it is the one that the wildcard `posed` names.
    """

    def checked(wildcards):
        name = stage or posed_stage(wildcards)
        skinned = config["garment4d"]["skinned"]
        training = config["garment4d"][name]["training"]
        require_sequences(
            wildcards.garment,
            planned_sequences(
                wildcards.garment,
                MOVING_PLANS.values(),
                [
                    plan
                    for group, shard in SKINNED
                    for plan in GROUPS[group].shards[shard]
                ],
                frames=skinned["frames"],
                step=skinned["step"],
            ),
            stage=name,
            sources=training["sources"],
            window=training["frames"],
        )
        return SEQUENCES[wildcards.garment]

    return checked


def posed_stage(wildcards):
    """The stage that a posed model is a variant of: the posed one, or its baseline."""
    return "mgn" if wildcards.posed == "mgn" else "posed"


def stage_settings(stage):
    """Settings of a network of Garment4D, by group."""
    own, posed = config["garment4d"][stage], config["garment4d"]["posed"]
    settings = {
        "network": own["network"],
        "loss": own.get("loss", posed["loss"]),
        "training": {**own["training"], "seed": config["seed"]},
    }
    if stage == "posed":
        settings["skinning"] = config["garment4d"]["skinning"]
    if stage == "canonical":
        points = config["garment4d"]["clouds"]["points"]
        settings["network"] = {**own["network"], "points": points}
    return settings


def posed_settings(wildcards):
    changes = POSED_VARIANTS.get(wildcards.posed, {})
    return override_settings(stage_settings(posed_stage(wildcards)), changes)


def posed_variants_of(wildcards):
    """Variants of the posed stage that an evaluation holds."""
    return POSED_MODELS[wildcards.models]


def posed_models(wildcards):
    """Trained models of the posed stage that an evaluation holds."""
    return [
        f"{G4D}/{wildcards.garment}/{variant}"
        for variant in posed_variants_of(wildcards)
    ]


def evaluated_sequences(wildcards):
    """Sequences of a type; for the ablations with points as in the released code too.

    Those moved by skinning are not measured, so the plan must have others.
    """
    planned = MOVING_PLANS.values()
    wearers = [p for p in planned if wildcards.garment in p.outfit_type.split("+")]
    require_simulated(wildcards.garment, wearers, EVALUATED_SPLITS)
    sequences = {"data": SEQUENCES[wildcards.garment]}
    if wildcards.models == "ablations":
        sequences["vertex_sampled"] = f"{G4D}/{wildcards.garment}/data_vertices"
    return sequences


def evaluation_settings(wildcards):
    """Figures 8 to 10 and noisy bodies are part of the ablations alone."""
    settings = {**config["garment4d"]["evaluation"], "seed": config["seed"]}
    if wildcards.models == "default":
        settings |= dict.fromkeys(("neighbours", "missing", "accuracy"), [])
        settings |= {"noise_pose_rad": 0.0, "noise_shape": 0.0}
    return settings


def departures():
    """Settings by which the experiment's models depart from the paper's."""
    canonical, posed = config["garment4d"]["canonical"], config["garment4d"]["posed"]
    settings = {
        "body_relative_points": canonical["network"]["body_relative_points"],
        "balance": canonical["loss"]["balance"],
        "pull_neighbours": posed["network"]["pull_neighbours"],
        "smooth_passes": posed["network"]["smooth_passes"],
    }
    return [name for name, value in settings.items() if value]


def own_scans(wildcards):
    """The scans to reconstruct a garment from, and the body in them."""
    if RECONSTRUCT["garment"] not in G4D_GARMENTS:
        raise WorkflowError(
            f"garment4d.reconstruct.garment is '{RECONSTRUCT['garment']}', expected one of"
            f" garment4d.garments: {', '.join(G4D_GARMENTS)}"
        )
    missing = [key for key in ("points", "body") if RECONSTRUCT[key] is None]
    if missing:
        raise WorkflowError(
            f"garment4d.reconstruct.{missing[0]} is not set, expected the path of your"
            f" {'point clouds' if missing[0] == 'points' else 'body parameters'}"
        )
    return {key: RECONSTRUCT[key] for key in ("points", "body")}
