from drapeline.experiment.checks import require_splits
from drapeline.models.gcvae.variants import (
    DVAE_VARIANTS,
    SVAE_VARIANTS,
    dynamic_conditions,
    pooling_of,
)
from drapeline.models.training.settings import override_settings

# Samples in motion as their metrics read them.
MOVING_INPUTS = {
    "samples": per_sample(f"{RESULTS}/samples/{{sample}}"),
    "registrations": per_sample(f"{RESULTS}/registration/samples/{{sample}}"),
    "topology": TOPOLOGY,
}
GCVAE_BASELINES = ["baselines", "dynamic_baselines"]
METRIC_TABLES["metrics"] += [
    *[*GCVAE_BASELINES, "svae", "svae_ours"],
    *["dvae_unposed_4", "dvae_ours"],
]
METRIC_TABLES["metrics_gcvae_ablations"] = [
    *[*GCVAE_BASELINES, *SVAE_VARIANTS, *DVAE_VARIANTS],
]


wildcard_constraints:
    svae="|".join(SVAE_VARIANTS),
    dvae="|".join(DVAE_VARIANTS),
    conditions="static|(posed|unposed)_[14]",


def static_model():
    """The SVAE whose codes the DVAE is conditioned on."""
    return f"{RESULTS}/gcvae/{config['gcvae']['dvae']['static_model']}"


def conditions_input(wildcards):
    """Rows that hold the conditions; those of the DVAE contain the static code.

    All trainings of garment VAEs begin here, so it is here that splits are checked.
    """
    if wildcards.conditions == "static":
        return {"data": static_data("train", "val")(wildcards)}
    planned = [plan.split for plan in SAMPLES.values()]
    require_splits(planned, ["train", "val"], group="samples", shares=config["samples"])
    version = wildcards.conditions.split("_")[0]
    return {"data": f"{RESULTS}/dynamic/{version}", "svae": static_model()}


def condition_frames(wildcards):
    """How many poses are among the conditions."""
    return int(wildcards.conditions.rpartition("_")[2].replace("static", "0"))


def conditioning_settings(wildcards):
    model = "svae" if wildcards.conditions == "static" else "dvae"
    return {
        "condition": config["gcvae"][model]["network"]["condition"],
        "training": {**config["gcvae"]["conditioning"], "seed": config["seed"]},
    }


def vae_settings(model):
    """Params function: settings of the svae or the dvae by group, the paper's or our own."""

    def settings(wildcards):
        paper = {
            "network": config["gcvae"][model]["network"],
            "loss": config["gcvae"]["loss"],
            "training": {**config["gcvae"][model]["training"], "seed": config["seed"]},
        }
        ours = f"{model}_ours"
        own = wildcards[model] == ours
        return override_settings(paper, config["gcvae"][ours]) if own else paper

    return settings


def svae_hierarchy(wildcards):
    return f"{RESULTS}/registration/hierarchy_{pooling_of(wildcards.svae)}.npz"


def svae_inputs(wildcards):
    """Input function: the conditioning network of the paper's static variants."""
    if wildcards.svae == "svae_ours":
        return {}
    return {"conditioning": f"{RESULTS}/gcvae/conditioning/static"}


def dvae_data(wildcards):
    """Input function: frames of a dynamic variant's version of the offsets."""
    return f"{RESULTS}/dynamic/{dynamic_conditions(wildcards.dvae)[0]}"


def dvae_inputs(wildcards):
    """Input function: the conditioning network of the paper's dynamic variants."""
    if wildcards.dvae == "dvae_ours":
        return {}
    version, frames = dynamic_conditions(wildcards.dvae)
    return {"conditioning": f"{RESULTS}/gcvae/conditioning/{version}_{frames}"}


def shown_svae():
    """The static model that figures and samples are made with."""
    return config["gcvae"]["sampling"]["variant"]
