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
from drapeline.frames import GENDERS
from drapeline.motions.table import motion_table
from drapeline.nets.variants import pooling_of
from drapeline.outfits.static_plan import plan_static
from drapeline.outfits.kinds import KINDS
from drapeline.planning import plan_samples
from drapeline.settings import checked_settings
from drapeline.source_digest import source_digest

try:
    config.update(
        checked_settings(
            config,
            yaml.safe_load((ROOT / "workflow/schemas/config.schema.yaml").read_text()),
            " + ".join(map(os.path.relpath, workflow.configfiles)),
        )
    )
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
        kinds=config["outfits"]["kinds"],
        male_skirts=config["outfits"]["male_skirts"],
    )
    STATIC = plan_static(
        config["seed"],
        config["static"]["count"],
        config["static"]["shard_size"],
        {split: config["static"][f"{split}_share"] for split in ("val", "test")},
        female_share=config["body"]["female_share"],
        kinds=KINDS,
        male_skirts=config["outfits"]["male_skirts"],
    )
except (InputError, OSError) as error:
    raise WorkflowError(str(error)) from None

RESULTS = config["results"]
LOGS = f"{RESULTS}/logs"
BENCHMARKS = f"{RESULTS}/benchmarks"
EXPORT_FORMATS = ["usdc", "glb", "abc", "mdd", "pc2", "obj"]


wildcard_constraints:
    gender="|".join(GENDERS),
    sequence="|".join(MOTIONS),
    # A long alternation would make the matching of n samples quadratic.
    sample="|".join(SAMPLES) if len(SAMPLES) <= 500 else r"\d{5}",
    shard=r"\d+",
    format="|".join(EXPORT_FORMATS),


def source_hash(rule_name):
    """Digest of a rule's script and of the library code it imports."""
    return source_digest(ROOT / "scripts" / f"{rule_name}.py", SOURCE)


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
        own[name] for name in SAMPLES[wildcards.sample].kind.split("+") if name in own
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


def conditions_input(wildcards):
    """Rows that hold the conditions; those of the DVAE contain the static code."""
    if wildcards.conditions == "static":
        return {"data": f"{RESULTS}/static/data"}
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


def conditioning_settings(wildcards):
    kind = "svae" if wildcards.conditions == "static" else "dvae"
    return {
        "condition": config["gcvae"][kind]["network"]["condition"],
        "epochs": config["gcvae"]["conditioning"]["epochs"],
        "seed": config["seed"],
    }


def metric_files(wildcards):
    """Metrics of the baselines and of every model of a table."""
    names = ["baselines", "dynamic_baselines", *METRIC_TABLES[wildcards.table]]
    return [f"{RESULTS}/metrics/{name}.tsv" for name in names]


def shown_svae():
    """The static model that figures and samples are made with."""
    return config["gcvae"]["sampling"]["variant"]
