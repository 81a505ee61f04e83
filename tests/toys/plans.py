"""What experiments do with models, without Snakemake."""

import yaml

from drapeline.experiment.config import fill_settings
from drapeline.experiment.files import ExperimentFiles
from drapeline.experiment.groups import plan_groups
from drapeline.frames import GENDERS
from drapeline.motions.table import FrameCounts, MotionTable
from toys.schema import SCHEMA
from toys.snakemake_run import ROOT


def files_of(config="tests/data/tiny.yaml"):
    """Files of an experiment, by the path of its config or by what that holds."""
    given = config if isinstance(config, dict) else yaml.safe_load((ROOT / config).read_text())
    settings = fill_settings(given, SCHEMA, "config")
    clips = MotionTable(ROOT / "workflow/resources/motions/clips.tsv")
    groups = plan_groups(settings, clips, FrameCounts())
    bodies = {gender: f"{gender}.npz" for gender in GENDERS}
    return ExperimentFiles(settings, groups, bodies, "drapeline.xpbd.solver")


def tasks_of(plan):
    """All tasks, by what they make."""
    evaluations = {name: one.task for name, one in plan.evaluations.items()}
    figures = {name: one.task for name, one in plan.figures.items()}
    return {**plan.data, **plan.trainings, **evaluations, **plan.samples, **figures}
