from drapeline.experiment.checks import require_splits
from drapeline.models.gcvae.variants import (
    DVAE_VARIANTS,
    SVAE_VARIANTS,
    dynamic_conditions,
    laid_over,
    pooling_of,
)


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
        return laid_over(paper, config["gcvae"][ours]) if own else paper

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
DEFAULT_TARGETS += [f"{RESULTS}/metrics.tsv"]


wildcard_constraints:
    svae="|".join(SVAE_VARIANTS),
    version="posed|unposed",
    dvae="|".join(DVAE_VARIANTS),
    conditions="static|(posed|unposed)_[14]",


rule train_conditioning:
    input:
        unpack(conditions_input),
    output:
        directory(f"{RESULTS}/gcvae/conditioning/{{conditions}}"),
    log:
        f"{LOGS}/train_conditioning/{{conditions}}.log",
    benchmark:
        f"{BENCHMARKS}/train_conditioning/{{conditions}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        frames=condition_frames,
        settings=conditioning_settings,
        progress=in_progress("conditioning"),
        code=source_hash("train_conditioning"),
    script:
        "../../scripts/train_conditioning.py"


rule train_svae:
    input:
        unpack(svae_inputs),
        **SUPER_BODIES,
        data=f"{RESULTS}/static/data",
        topology=TOPOLOGY,
        hierarchy=svae_hierarchy,
    output:
        directory(f"{RESULTS}/gcvae/{{svae}}"),
    log:
        f"{LOGS}/train_svae/{{svae}}.log",
    benchmark:
        f"{BENCHMARKS}/train_svae/{{svae}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=12000,
        runtime=1440,
    params:
        settings=vae_settings("svae"),
        trainer=lookup(dpath="gcvae/trainer", within=config),
        progress=in_progress("svae"),
        code=source_hash("train_svae"),
    script:
        "../../scripts/train_svae.py"


rule train_dvae:
    input:
        unpack(dvae_inputs),
        **SUPER_BODIES,
        data=dvae_data,
        svae=static_model(),
        topology=TOPOLOGY,
        hierarchy=f"{RESULTS}/registration/hierarchy_segments.npz",
    output:
        directory(f"{RESULTS}/gcvae/{{dvae}}"),
    log:
        f"{LOGS}/train_dvae/{{dvae}}.log",
    benchmark:
        f"{BENCHMARKS}/train_dvae/{{dvae}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=12000,
        runtime=1440,
    params:
        settings=vae_settings("dvae"),
        trainer=lookup(dpath="gcvae/trainer", within=config),
        progress=in_progress("dvae"),
        code=source_hash("train_dvae"),
    script:
        "../../scripts/train_dvae.py"


rule evaluate_baselines:
    input:
        **SUPER_BODIES,
        data=f"{RESULTS}/static/data",
        topology=TOPOLOGY,
    output:
        f"{RESULTS}/metrics/baselines.tsv",
    log:
        f"{LOGS}/evaluate_baselines.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_baselines.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        splits=EVALUATED_SPLITS,
        components=lookup(dpath="gcvae/evaluation/pca_components", within=config),
        seed=config["seed"],
        code=source_hash("evaluate_baselines"),
    script:
        "../../scripts/evaluate_baselines.py"


rule evaluate_svae:
    input:
        model=f"{RESULTS}/gcvae/{{svae}}",
        data=f"{RESULTS}/static/data",
    output:
        metrics=f"{RESULTS}/metrics/{{svae}}.tsv",
        codes=f"{RESULTS}/codes/{{svae}}.npz",
    log:
        f"{LOGS}/evaluate_svae/{{svae}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_svae/{{svae}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        splits=EVALUATED_SPLITS,
        code=source_hash("evaluate_svae"),
    script:
        "../../scripts/evaluate_svae.py"


rule evaluate_dynamic_baselines:
    input:
        **MOVING_INPUTS,
        **SUPER_BODIES,
    output:
        f"{RESULTS}/metrics/dynamic_baselines.tsv",
    log:
        f"{LOGS}/evaluate_dynamic_baselines.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_dynamic_baselines.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        splits=EVALUATED_SPLITS,
        step=lookup(dpath="gcvae/dvae/frame_step", within=config),
        seed=config["seed"],
        code=source_hash("evaluate_dynamic_baselines"),
    script:
        "../../scripts/evaluate_dynamic_baselines.py"


rule evaluate_dvae:
    input:
        **MOVING_INPUTS,
        **SUPER_BODIES,
        model=f"{RESULTS}/gcvae/{{dvae}}",
        data=dvae_data,
        static=static_model(),
    output:
        f"{RESULTS}/metrics/{{dvae}}.tsv",
    log:
        f"{LOGS}/evaluate_dvae/{{dvae}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_dvae/{{dvae}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        splits=EVALUATED_SPLITS,
        code=source_hash("evaluate_dvae"),
    script:
        "../../scripts/evaluate_dvae.py"


include: "gcvae_figures.smk"
