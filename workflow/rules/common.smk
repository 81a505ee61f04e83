import os
import re
import sys
from dataclasses import asdict
from pathlib import Path

from typing import NamedTuple

import yaml
from snakemake.exceptions import WorkflowError
from snakemake.logging import logger

# Of drapeline, which may be a module of another workflow or work in another folder.
ROOT = Path(str(workflow.current_basedir)).parents[1]
SOURCE = ROOT / "src"
sys.path.insert(0, str(SOURCE))
os.environ.update(
    PYTHONPATH=os.pathsep.join(
        filter(None, [str(SOURCE), os.environ.get("PYTHONPATH")])
    )
)

from drapeline.dataset.record import outfit_text, read_meta
from drapeline.errors import InputError
from drapeline.experiment.checks import refuse_contradictions, require_splits
from drapeline.experiment.config import fill_settings
from drapeline.experiment.learning_plan import plan_learning
from drapeline.experiment.resources import asked_mb, asked_minutes, cloth_factor
from drapeline.experiment.samples import plan_samples
from drapeline.experiment.shards import shard_samples
from drapeline.experiment.source_digest import Sources
from drapeline.frames import GENDERS
from drapeline.motions.frame_counts import FrameCounts
from drapeline.motions.table import motion_table
from drapeline.outfits.garment_types import OUTFIT_TYPES
from drapeline.outfits.own_garments import own_garments
from drapeline.outfits.static_plan import plan_static
from drapeline.preflight import find_slurm_problem, slurm_config
from drapeline.storage import sweep

try:
    config.update(
        fill_settings(
            config,
            yaml.load(
                (ROOT / "workflow/schemas/config.schema.yaml").read_text(),
                # Every command reads it, and in pure Python that takes most of a second.
                getattr(yaml, "CSafeLoader", yaml.SafeLoader),
            ),
            " + ".join(map(os.path.relpath, workflow.configfiles)) or "config",
        )
    )
    refuse_contradictions(config)
    CLIPS = config["motions"]["table"] or os.path.relpath(
        ROOT / "workflow/resources/motions/clips.tsv"
    )
    FRAME_COUNTS = FrameCounts(".snakemake/drapeline/frames.json")
    MOTIONS = motion_table(
        CLIPS,
        config["motions"]["sequences"],
        loop_frames=config["motions"]["loop_frames"],
        counts=FRAME_COUNTS,
    )
    OWN_GARMENTS = own_garments(config["outfits"]["own_garments"])
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
    LEARNING_MOTIONS, LEARNING = {}, {}
    if config["learning"]["count"]:
        LEARNING_MOTIONS = motion_table(
            CLIPS,
            config["learning"]["sequences"] or config["motions"]["sequences"],
            loop_frames=config["learning"]["loop_frames"],
            counts=FRAME_COUNTS,
        )
        LEARNING = plan_learning(
            config["seed"],
            {name: motion.frames for name, motion in LEARNING_MOTIONS.items()},
            **{
                key: config["learning"][key]
                for key in (
                    *(
                        "frames",
                        "frames_min",
                        "count",
                        "shard_size",
                        "speeds",
                        "mirror",
                    ),
                    *("val_share", "test_share"),
                )
            },
            known_splits={plan.sequence: plan.split for plan in SAMPLES.values()},
            female_share=config["body"]["female_share"],
            outfit_types=config["learning"]["types"],
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
# Networks of several models are trained side by side; more threads each would only slow all down.
# A cluster's job has its own machine to count cores on, and must find the threads it asked for.
_CORES = None if workflow.remote_exec else workflow.resource_settings.cores
NETWORK_THREADS = min(max((_CORES or 8) // 2, 1), 8)
# Everything waits for samples, and Garment4D has the longest chain after them; whatever is left
# fills the cores at the end.
SAMPLES_FIRST, LONG_CHAIN = 2, 1
# Only rules that evaluate read these, none that trains.
EVALUATED_SPLITS = ["test"]
# Rules files add to these two: what `all` makes, and which files of metrics each table holds, in
# this order.
DEFAULT_TARGETS = []
# Samples that one job makes, by shard; empty where each step of a sample is a job of its own.
SAMPLE_SHARDS = shard_samples(SAMPLES, config["samples"]["shard_size"])


class SampleStep(NamedTuple):
    """What a rule for single samples makes, which shards make where there are some.

    Attributes:
        script: of the rule.
        output: a path with `{sample}`.
        samples: of which it is wanted.
        is_folder: whether the output is a folder.
    """

    script: str
    output: str
    samples: set
    is_folder: bool = True


# Rules files add to this.
SAMPLE_STEPS = []
METRIC_TABLES = {"metrics": [], "representations": [], "scans": []}
BODY_SETTINGS = {
    key: config["body"][key] for key in ("shape_range", "shape_draws", "segment_gap_m")
}
OUTFIT_SETTINGS = {
    key: config["outfits"][key]
    for key in (
        *("edge_length_m", "vertices_min"),
        *("tightness_range", "elastic_probability"),
    )
}
# Garment types that every model learns, on which they are compared.
COMPARED_GARMENTS = config["garment4d"]["garments"]
# A long alternation would make the matching of n samples quadratic.
ANY_SAMPLE = "|".join(SAMPLES) if len(SAMPLES) <= 500 else r"\d{5}"
# Those of which rules for single samples make what shards make where there are some.
SINGLE_SAMPLE = "(?!)" if SAMPLE_SHARDS else ANY_SAMPLE


wildcard_constraints:
    gender="|".join(GENDERS),
    sequence="|".join(map(re.escape, MOTIONS)),
    sample=ANY_SAMPLE,
    shard=r"\d+",


SOURCES = Sources(SOURCE, memory=".snakemake/drapeline/sources.json")


def remove_scraps():
    """Remove what killed jobs were writing; a start of Snakemake does so before its first job."""
    for folder in (RESULTS, "resources/body", ".snakemake/drapeline"):
        for scrap in sweep(folder):
            logger.info(f"Removed {scrap}, which a killed job was writing.")


def check_cluster():
    """Stop where Snakemake would submit jobs and never learn that they ended."""
    asking = getattr(workflow.executor_settings, "status_command", None)
    problem = asking and find_slurm_problem(asking, slurm_config())
    if problem:
        raise WorkflowError(problem)


def source_hash(script, *modules):
    """Digest of a rule's script, of modules it is told of, and of the library code they import."""
    return SOURCES.digest(ROOT / "scripts" / f"{script}.py", *modules)


def plan(key):
    """Input or params function: one field of the sample's plan."""
    return lambda wildcards: getattr(SAMPLES[wildcards.sample], key)


def unsplit_plan(wildcards):
    """Params function: a sample's plan but for its split, which only its record holds."""
    values = asdict(SAMPLES[wildcards.sample])
    return {name: value for name, value in values.items() if name != "split"}


def shard_folder(shard):
    """Where the samples of a shard are made; what the steps leave behind stays there."""
    return f"{RESULTS}/shards/{shard}"


def shard_benchmarks(shard):
    return f"{shard_folder(shard)}/benchmarks"


def per_sample(pattern):
    return expand(pattern, sample=SAMPLES)


def body_file(gender):
    """The user's own SMPL file where the config names one, else the baked body."""
    return config["body"]["files"].get(gender, f"resources/body/{gender}.npz")


WHOLE_BODIES = {gender: body_file(gender) for gender in GENDERS}


def gender_body(wildcards):
    return body_file(wildcards.gender)


def sample_body(wildcards):
    return body_file(SAMPLES[wildcards.sample].gender)


def sample_motion(wildcards):
    return f"{RESULTS}/motions/{SAMPLES[wildcards.sample].sequence}.npz"


def motion_files(wildcards):
    """The clip, and the joint map and skeleton it may need."""
    return MOTIONS[wildcards.sequence].files


def baked_body(wildcards):
    return f"resources/body/{wildcards.gender.lower()}.npz"


def motion_parameters(wildcards):
    """What else the importer is told: joint map, skeleton, loop, feet, labels."""
    lock_feet = config["motions"]["lock_feet"]
    return {**MOTIONS[wildcards.sequence].parameters(), "lock_feet": lock_feet}


def sample_templates(wildcards):
    return f"{RESULTS}/templates/{SAMPLES[wildcards.sample].gender}.npz"


def sample_own_garments(wildcards):
    """Params function: the user's own among the garments of this sample."""
    sample = SAMPLES[wildcards.sample]
    own = OWN_GARMENTS[sample.gender]
    return {name: own[name] for name in sample.outfit_type.split("+") if name in own}


def own_garment_files(wildcards):
    """The OBJ files of these."""
    return [own["path"] for own in sample_own_garments(wildcards).values()]


def gallery_labels(kind):
    """Labels function: what a sample shows, which its own record knows once it is made."""

    def labels(wildcards, input):
        meta = read_meta(input[0])
        return {
            "sample": wildcards.sample,
            "motion": meta["motion"]["sequence"],
            "wears": outfit_text(meta),
            "kind": kind,
        }

    return labels


def samples_side_by_side(wildcards):
    """Input function: the samples whose ids, joined by hyphens, name the picture."""
    return expand(f"{RESULTS}/samples/{{sample}}", sample=wildcards.samples.split("-"))


def shard_plans(wildcards):
    """The plans of a shard's static outfits."""
    return [asdict(plan) for plan in STATIC[wildcards.shard]]


def static_data(*splits):
    """Input function: garments at rest, once the plan is known to fill these splits."""

    def checked(wildcards):
        planned = [plan.split for plans in STATIC.values() for plan in plans]
        require_splits(planned, splits, group="static", shares=config["static"])
        return f"{RESULTS}/static/data"

    return checked


def in_progress(stage):
    """Params function: where a training keeps its state, which outlives the job."""
    return lambda wildcards, output: str(
        Path(output[0]).parent / ".progress" / f"{stage}_{Path(output[0]).name}"
    )


def metric_files(wildcards):
    """Metrics of every model of a table."""
    return [f"{RESULTS}/metrics/{name}.tsv" for name in METRIC_TABLES[wildcards.table]]
