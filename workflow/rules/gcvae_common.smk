from drapeline.models.gcvae.settings import (
    DVAE_VARIANTS,
    DYNAMIC_PPCA,
    STATIC_PPCA,
    SVAE_VARIANTS,
    dynamic_conditions,
    pooling_of,
)
from drapeline.models.training.settings import override_settings

GCVAE_BASELINES = ["baselines", "dynamic_baselines"]
METRIC_TABLES["metrics"] += [
    *[*GCVAE_BASELINES, "svae", STATIC_PPCA],
    *["dvae_unposed_4", DYNAMIC_PPCA],
]
METRIC_TABLES["representations"] += ["representations_gcvae"]
if SCAN_FILES:
    METRIC_TABLES["scans"] += ["scans_gcvae"]
METRIC_TABLES["metrics_gcvae_ablations"] = [
    *[*GCVAE_BASELINES, *SVAE_VARIANTS, STATIC_PPCA],
    *[*DVAE_VARIANTS, DYNAMIC_PPCA],
]


wildcard_constraints:
    static="|".join([*SVAE_VARIANTS, STATIC_PPCA]),
    dynamic="|".join([*DVAE_VARIANTS, DYNAMIC_PPCA]),


def static_model():
    """The static model whose codes the dynamic ones are conditioned on."""
    return f"{RESULTS}/gcvae/{config['gcvae']['dvae']['static_model']}"


def training_frames(version):
    """Garments in motion, some of which are planned for training and for validation."""
    planned = [plan.split for plan in MOVING_PLANS.values()]
    require_splits(planned, ["train", "val"], groups=splits_of_groups(MOVING))
    return f"{RESULTS}/dynamic/{version}"


def conditioning_frames(wildcards):
    """Input function: `training_frames` of one version of the offsets."""
    return training_frames(wildcards.version)


def dvae_frames(wildcards):
    """Input function: `training_frames` of a variant's version of the offsets."""
    return training_frames(dynamic_conditions(wildcards.dvae)[0])


def dynamic_ppca_frames(wildcards):
    """Input function: `training_frames` of the dynamic PCA."""
    return training_frames(dynamic_conditions(DYNAMIC_PPCA)[0])


def dvae_data(wildcards):
    """Input function: frames of a variant's version of the offsets."""
    return f"{RESULTS}/dynamic/{dynamic_conditions(wildcards.dynamic)[0]}"


def dvae_conditioning(wildcards):
    """Input function: the conditioning network of a variant."""
    version, frames = dynamic_conditions(wildcards.dvae)
    return f"{RESULTS}/gcvae/conditioning/{version}_{frames}"


def conditioning_settings(model):
    """Settings of the autoencoder of the svae's or the dvae's conditions."""
    return {
        "condition": config["gcvae"][model]["network"]["condition"],
        "training": {**config["gcvae"]["conditioning"], "seed": config["seed"]},
    }


def vae_settings(model):
    """Settings of the paper's svae or dvae, by group."""
    return {
        "network": config["gcvae"][model]["network"],
        "loss": config["gcvae"]["loss"],
        "training": {**config["gcvae"][model]["training"], "seed": config["seed"]},
    }


def svae_settings(wildcards):
    """Input function: settings of a static variant."""
    return override_settings(vae_settings("svae"), SVAE_VARIANTS[wildcards.svae])


def dvae_settings(wildcards):
    """Input function: settings of a dynamic variant."""
    return override_settings(vae_settings("dvae"), DVAE_VARIANTS[wildcards.dvae])


def dvae_poses(wildcards):
    """Input function: the number of poses that a variant is conditioned on."""
    return dynamic_conditions(wildcards.dvae)[1]


def dynamic_poses(wildcards):
    """Input function: the same for any dynamic model."""
    return dynamic_conditions(wildcards.dynamic)[1]


def ppca_settings(model):
    """Settings of the PCA that the svae or dvae is compared with: codes of the same size."""
    latent = config["gcvae"][model]["network"]["latent"]
    return {"latent": latent, "seed": config["seed"]}


def svae_hierarchy(wildcards):
    return f"{RESULTS}/super_body/hierarchy_{pooling_of(wildcards.svae)}.npz"


def shown_static():
    """The static model that figures and samples are made with."""
    return config["gcvae"]["sampling"]["variant"]
