import os
import sys
from dataclasses import asdict
from pathlib import Path

import yaml
from snakemake.exceptions import WorkflowError

ROOT = Path(workflow.basedir)
SOURCE = ROOT / "src"
sys.path.insert(0, str(SOURCE))
os.environ.update(
    PYTHONPATH=os.pathsep.join(
        filter(None, [str(SOURCE), os.environ.get("PYTHONPATH")])
    )
)

from drapeline.errors import InputError
from drapeline.experiment.checks import (
    planned_sequences,
    refuse_contradictions,
    require_sequences,
    require_splits,
)
from drapeline.frames import GENDERS
from drapeline.motions.table import motion_table
from drapeline.models.gcvae.variants import dynamic_conditions, laid_over, pooling_of
from drapeline.outfits.static_plan import plan_static
from drapeline.outfits.garment_types import OUTFIT_TYPES, TEMPLATE_TYPES
from drapeline.experiment.samples import plan_samples
from drapeline.experiment.config import checked_settings
from drapeline.experiment.source_digest import Sources

try:
    config.update(
        checked_settings(
            config,
            yaml.safe_load((ROOT / "workflow/schemas/config.schema.yaml").read_text()),
            " + ".join(map(os.path.relpath, workflow.configfiles)),
        )
    )
    refuse_contradictions(config)
    MOTIONS = motion_table(
        config["motions"]["table"],
        config["motions"]["sequences"],
        loop_frames=config["motions"]["loop_frames"],
    )
    SAMPLES = plan_samples(
        config["seed"],
        {name: motion.frames for name, motion in MOTIONS.items()},
        frames=config["motions"]["frames"],
        frames_min=config["motions"]["frames_min"],
        count=config["samples"]["count"],
        val_share=config["samples"]["val_share"],
        test_share=config["samples"]["test_share"],
        female_share=config["body"]["female_share"],
        outfit_types=config["outfits"]["types"],
        male_skirts=config["outfits"]["male_skirts"],
    )
    STATIC = plan_static(
        config["seed"],
        config["static"]["count"],
        config["static"]["shard_size"],
        {split: config["static"][f"{split}_share"] for split in ("val", "test")},
        female_share=config["body"]["female_share"],
        outfit_types=OUTFIT_TYPES,
        male_skirts=config["outfits"]["male_skirts"],
    )
except (InputError, OSError) as error:
    raise WorkflowError(str(error)) from None

RESULTS = config["results"]
LOGS = f"{RESULTS}/logs"
BENCHMARKS = f"{RESULTS}/benchmarks"
# Shards of static outfits that Garment4D learns from besides simulated samples.
SKINNED = list(STATIC)[: config["garment4d"]["skinned"]["shards"]]
# Samples that wear a type which Garment4D learns.
TEMPLATE_WEARERS = [
    sample
    for sample, planned in SAMPLES.items()
    if set(planned.outfit_type.split("+")) & set(TEMPLATE_TYPES)
]
RECONSTRUCT = config["garment4d"]["reconstruct"]
# Networks of several kinds are trained side by side; more threads each would only slow all down.
# A cluster's job has its own machine to count cores on, and must find the threads it asked for.
_CORES = None if workflow.remote_exec else workflow.resource_settings.cores
NETWORK_THREADS = min(max((_CORES or 8) // 2, 1), 8)
# All the rest waits for samples, and Garment4D's is the longest chain after them; what is left over
# fills the cores at the end.
SAMPLES_FIRST, LONG_CHAIN = 2, 1
EXPORT_FORMATS = ["usdc", "glb", "abc", "mdd", "pc2", "obj"]


wildcard_constraints:
    gender="|".join(GENDERS),
    sequence="|".join(MOTIONS),
    # A long alternation would make the matching of n samples quadratic.
    sample="|".join(SAMPLES) if len(SAMPLES) <= 500 else r"\d{5}",
    shard=r"\d+",
    format="|".join(EXPORT_FORMATS),


SOURCES = Sources(SOURCE, memory=".snakemake/drapeline_sources.json")


def source_hash(rule_name):
    """Digest of a rule's script and of the library code it imports."""
    return SOURCES.digest(ROOT / "scripts" / f"{rule_name}.py")


def plan(key):
    """Input or params function: one field of the sample's plan."""
    return lambda wildcards: getattr(SAMPLES[wildcards.sample], key)


def body_file(gender):
    """The user's own SMPL file where the config names one, else the baked body."""
    return config["body"]["files"].get(gender, f"resources/body/{gender}.npz")


def gender_body(wildcards):
    return body_file(wildcards.gender)


def sample_body(wildcards):
    return body_file(SAMPLES[wildcards.sample].gender)


def sample_motion(wildcards):
    return f"{RESULTS}/motions/{SAMPLES[wildcards.sample].sequence}.npz"


def sample_templates(wildcards):
    return f"{RESULTS}/templates/{SAMPLES[wildcards.sample].gender}.npz"


def motion_files(wildcards):
    """The clip, and the joint map and skeleton it may need."""
    return MOTIONS[wildcards.sequence].files


def motion_parameters(wildcards):
    """What else the importer is told: joint map, skeleton, loop, labels."""
    return MOTIONS[wildcards.sequence].parameters()


def per_sample(pattern):
    return [pattern.format(results=RESULTS, sample=sample) for sample in SAMPLES]


def shard_plans(wildcards):
    """What the outfits of a shard of static outfits are going to be."""
    return [asdict(plan) for plan in STATIC[wildcards.shard]]


def own_garment_files(wildcards):
    """The user's own OBJ files among the garments of this sample."""
    own = config["outfits"]["own_garments"]
    return [
        own[name]
        for name in SAMPLES[wildcards.sample].outfit_type.split("+")
        if name in own
    ]


def gallery_files():
    return per_sample("{results}/gallery/{sample}.png") + per_sample(
        "{results}/gallery/{sample}_moving.png"
    )


def in_progress(kind):
    """Params function: where a training under way keeps its state, which outlives the job."""
    return lambda wildcards, output: str(
        Path(output[0]).parent / ".progress" / f"{kind}_{Path(output[0]).name}"
    )


def static_data(*splits):
    """Input function: garments at rest, some of which are planned for each of these splits."""

    def checked(wildcards):
        planned = [plan.split for plans in STATIC.values() for plan in plans]
        require_splits(planned, splits, group="static", shares=config["static"])
        return f"{RESULTS}/static/data"

    return checked


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


def static_model():
    """The SVAE whose codes the DVAE is conditioned on."""
    return f"{RESULTS}/gcvae/{config['gcvae']['dvae']['static_model']}"


def svae_hierarchy(wildcards):
    return f"{RESULTS}/registration/hierarchy_{pooling_of(wildcards.svae)}.npz"


def vae_settings(kind):
    """Settings of a full model, by group."""
    return {
        "network": config["gcvae"][kind]["network"],
        "loss": config["gcvae"]["loss"],
        "training": {**config["gcvae"][kind]["training"], "seed": config["seed"]},
    }


def trained_settings(kind):
    """Params function: settings of the paper's model of a kind, or of ours."""

    def settings(wildcards):
        paper, variant = vae_settings(kind), wildcards.get(kind)
        ours = f"{kind}_ours"
        return laid_over(paper, config["gcvae"][ours]) if variant == ours else paper

    return settings


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


def conditioning_settings(wildcards):
    kind = "svae" if wildcards.conditions == "static" else "dvae"
    return {
        "condition": config["gcvae"][kind]["network"]["condition"],
        "training": {**config["gcvae"]["conditioning"], "seed": config["seed"]},
    }


def metric_files(wildcards):
    """Metrics of every model of a table."""
    return [f"{RESULTS}/metrics/{name}.tsv" for name in METRIC_TABLES[wildcards.table]]


def shown_svae():
    """The static model that figures and samples are made with."""
    return config["gcvae"]["sampling"]["variant"]


def own_template(wildcards):
    """The user's own OBJ that garments of this type are registered to."""
    own = config["garment4d"]["template"]["files"].get(wildcards.garment)
    return {"own": own} if own else {}


def cloud_settings(wildcards):
    """How point clouds are taken; static outfits in motion follow the config's protocol."""
    return {
        "protocol": config["garment4d"]["protocol"],
        **config["garment4d"]["clouds"],
        **{k: wildcards[k] for k in ("protocol",) if k in wildcards.keys()},
        "seed": config["seed"],
    }


def training_sequences():
    """What the networks of a garment type learn from."""
    return f"{G4D}/{{garment}}/data_{config['garment4d']['protocol']}"


def stage_sequences(stage=None):
    """Input function: `training_sequences`, of which enough are planned for a stage or its baseline."""

    def checked(wildcards):
        name = stage or ("mgn" if wildcards.posed == "mgn" else "posed")
        skinned = config["garment4d"]["skinned"]
        training = config["garment4d"][name]["training"]
        require_sequences(
            wildcards.garment,
            planned_sequences(
                wildcards.garment,
                SAMPLES.values(),
                [plan for shard in SKINNED for plan in STATIC[shard]],
                frames=skinned["frames"],
                step=skinned["step"],
            ),
            stage=name,
            sources=training["sources"],
            window=training["frames"],
        )
        return training_sequences().format(garment=wildcards.garment)

    return checked


def garment_sequences(wildcards):
    """Clouds of one protocol; those of static outfits follow the config's."""
    own = wildcards.protocol == config["garment4d"]["protocol"]
    shards = SKINNED if own else []
    return {
        "samples": [f"{RESULTS}/samples/{sample}" for sample in TEMPLATE_WEARERS],
        "clouds": [
            f"{G4D}/clouds_{wildcards.protocol}/{sample}" for sample in TEMPLATE_WEARERS
        ],
        "skinned": [f"{G4D}/skinned/{shard}" for shard in shards],
        "shards": [f"{RESULTS}/static/outfits/{shard}.npz" for shard in shards],
    }


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
    """Settings of the posed stage, or of its baseline."""
    return stage_settings("mgn" if wildcards.posed == "mgn" else "posed")


def posed_models(wildcards):
    """Trained models of the posed stage that an evaluation holds."""
    return [
        f"{G4D}/{wildcards.garment}/{name}" for name in POSED_MODELS[wildcards.models]
    ]


def evaluated_sequences(wildcards):
    """Sequences of a type; for the ablations with points as in the released code too."""
    data = f"{G4D}/{wildcards.garment}/data_"
    found = {"data": data + config["garment4d"]["protocol"]}
    return found | (
        {"vertex_sampled": data + "vertices"} if wildcards.models == "ablations" else {}
    )


def evaluation_settings(wildcards):
    """Figures 8 to 10 are part of the ablations alone."""
    settings = {**config["garment4d"]["evaluation"], "seed": config["seed"]}
    if wildcards.models == "default":
        settings |= dict.fromkeys(("neighbours", "missing", "accuracy"), [])
    return settings


def own_scans(wildcards):
    """The scans to reconstruct a garment from, and the body in them."""
    missing = [key for key in ("points", "body") if RECONSTRUCT[key] is None]
    if missing:
        raise WorkflowError(
            f"garment4d.reconstruct.{missing[0]} is not set, expected the path of your"
            f" {'point clouds' if missing[0] == 'points' else 'body parameters'}"
        )
    return {key: RECONSTRUCT[key] for key in ("points", "body")}
