import os
import sys
import threading
import time
from functools import cache
from glob import glob
from pathlib import Path

import yaml
from snakemake.cli import get_argument_parser
from snakemake.exceptions import WorkflowError
from snakemake.io import WILDCARD_REGEX, get_wildcard_constraints
from snakemake.logging import logger
from snakemake.scheduling.job_scheduler import JobScheduler

# Of drapeline, which may be a module of another workflow or work in another folder.
ROOT = Path(str(workflow.current_basedir)).parents[1]
SOURCE = ROOT / "src"
sys.path.insert(0, str(SOURCE))
os.environ.update(
    PYTHONPATH=os.pathsep.join(
        filter(None, [str(SOURCE), os.environ.get("PYTHONPATH")])
    )
)


from drapeline.errors import InputError
from drapeline.experiment.checks import refuse_contradictions
from drapeline.experiment.config import fill_settings
from drapeline.experiment.groups import plan_groups
from drapeline.experiment.old_keys import refuse_old_keys
from drapeline.experiment.source_digest import Sources
from drapeline.experiment.targets import explain_target
from drapeline.frames import GENDERS
from drapeline.models.pictures.plan import pictured_samples
from drapeline.models.registry import models
from drapeline.motions.table import FrameCounts, MotionTable
from drapeline.preflight import find_slurm_problem, slurm_config
from drapeline.storage import sweep

CONFIG_FILES = " + ".join(map(os.path.relpath, workflow.configfiles)) or "config"
try:
    refuse_old_keys(config, CONFIG_FILES)
    # Every command reads it, and in pure Python that takes most of a second.
    SCHEMA = yaml.load(
        (ROOT / "workflow/schemas/config.schema.yaml").read_text(),
        getattr(yaml, "CSafeLoader", yaml.SafeLoader),
    )
    MODELS = models()
    for name in MODELS.keys() - SCHEMA["properties"].keys():  # of other packages
        block = MODELS[name].settings.schema_of_config()
        SCHEMA["properties"][name] = {**block, "default": {}}
    config.update(fill_settings(config, SCHEMA, CONFIG_FILES))
    refuse_contradictions(config)
    FRAME_COUNTS = FrameCounts(".snakemake/drapeline/frames.json")
    MOTION_TABLE = MotionTable(
        config["motions"]["table"]
        or os.path.relpath(ROOT / "workflow/resources/motions/clips.tsv"),
        config["motions"]["folder"],
    )
    GROUPS = plan_groups(config, MOTION_TABLE, FRAME_COUNTS)
except (InputError, OSError) as error:
    raise WorkflowError(str(error)) from None

RESULTS = config["results"]
LOGS = f"{RESULTS}/logs"
BENCHMARKS = f"{RESULTS}/benchmarks"
# Networks of several models are trained side by side; more threads each would only slow all down.
# A cluster's job has its own machine to count cores on, and must find the threads it asked for.
_CORES = None if workflow.remote_exec else workflow.resource_settings.cores
NETWORK_THREADS = min(max((_CORES or 8) // 2, 1), 8)
# Samples that are published, and their pictures, are there to be looked at after some minutes. Then
# everything waits for samples, and Garment4D has the longest chain after them; whatever is left fills
# the cores at the end.
PICTURES_FIRST, PUBLISHED_FIRST, SAMPLES_FIRST, LONG_CHAIN = 4, 3, 2, 1
# What `all` makes; rules files add to it.
DEFAULT_TARGETS = []


wildcard_constraints:
    gender="|".join(GENDERS),


SOURCES = Sources(SOURCE, memory=".snakemake/drapeline/sources.json")


def remove_scraps():
    """Remove what killed jobs were writing; a start of Snakemake does so before its first job."""
    for folder in (RESULTS, "resources/body", ".snakemake/drapeline"):
        for scrap in sweep(folder):
            logger.info(f"Removed {scrap}, which a killed job was writing.")


def tell_left_out():
    """Say which motions the experiment goes without."""
    if missing := MOTION_TABLE.left_out:
        logger.warning(
            f"{MOTION_TABLE.path}: goes without {', '.join(missing)}, whose files are not there;"
            " motions.folder may name the folder that they are in."
        )


def wake_once(scheduler, delay):
    """Let a scheduler look for jobs after so many seconds, once for all who ask meanwhile.

    Snakemake's own asks for another look at every look, and at every job's end for one more: after a
    hundred jobs it looks ten times in a second, which takes a quarter of a core.
    """
    now = time.monotonic()
    if now < getattr(scheduler, "wakes_at", 0) <= now + delay:
        return
    scheduler.wakes_at = now + delay
    timer = threading.Timer(delay, scheduler._open_jobs.release)
    timer.daemon = True
    timer.start()


JobScheduler._schedule_reevalutation = wake_once


def check_cluster():
    """Stop where Snakemake would submit jobs and never learn that they ended."""
    asking = getattr(workflow.executor_settings, "status_command", None)
    problem = asking and find_slurm_problem(asking, slurm_config())
    if problem:
        raise WorkflowError(problem)


def check_targets():
    """Answer targets that nothing makes with the nearest that can be made."""
    started_by = Path(sys.argv[0])
    by_command = "snakemake" in (started_by.name, started_by.parent.name)
    if workflow.remote_exec or not by_command:
        return
    if Path(workflow.main_snakefile).resolve() != (ROOT / "Snakefile").resolve():
        return  # of another workflow, whose rules come after these
    names = [one.name for one in workflow.rules if not one.has_wildcards()]
    patterns = {}
    for file in (file for one in workflow.rules for file in one.output):
        constraints = get_wildcard_constraints(file)
        plain = WILDCARD_REGEX.sub(r"{\g<name>}", file)
        patterns[plain] = {name: found.pattern for name, found in constraints.items()}
    # The rules are there before Snakemake says what it was asked for.
    asked, _ = get_argument_parser().parse_known_args(sys.argv[1:])
    for target in asked.targets:
        path = os.path.normpath(target)
        made = any(one.is_producer(path) for one in workflow.rules)
        if made or Path(path).exists():
            continue
        if problem := explain_target(path, names, patterns):
            raise WorkflowError(problem)


@cache
def source_hash(script, *modules):
    """Digest of a rule's script, of modules it is told of, and of the library code they import."""
    return SOURCES.digest(ROOT / "scripts" / f"{script}.py", *modules)


def body_file(gender):
    """The user's own SMPL file where the config names one, else the baked body."""
    return config["body"]["files"].get(gender, f"resources/body/{gender}.npz")


WHOLE_BODIES = {gender: body_file(gender) for gender in GENDERS}


def gender_body(wildcards):
    return body_file(wildcards.gender)


def baked_body(wildcards):
    return f"resources/body/{wildcards.gender.lower()}.npz"
