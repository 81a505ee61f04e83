"""The workflow on a cluster: how many jobs the paper's size has, and what they ask for."""

import json
import re
from statistics import median

import pytest
import yaml

from drapeline.models.gcvae.settings import DVAE_VARIANTS, PICTURES, SVAE_VARIANTS
from drapeline.models.registry import models
from toys.plans import files_of, tasks_of
from toys.snakemake_run import ROOT, snakemake

TINY = "tests/data/tiny.yaml"


def planned_jobs(project, *arguments):
    """Rule and resources of every job of a dry run that asks for time."""
    run = snakemake(project, "--dry-run", "--forceall", *arguments)
    assert run.returncode == 0, run.stderr
    text = run.stdout + run.stderr
    jobs = [
        (rule, dict(re.findall(r"(\w+)=([\w.]+)", resources)))
        for rule, resources in re.findall(
            r"^rule (\w+):\n(?:    .*\n)*?    resources: (.*)$", text, re.MULTILINE
        )
    ]
    return [job for job in jobs if "runtime" in job[1]]


@pytest.fixture(scope="module")
def paper(project, tmp_path_factory):
    """The paper's size, with a tenth of its samples and outfits: plans in seconds."""
    config = yaml.safe_load((ROOT / "workflow/config/paper.yaml").read_text())
    for group in ("dataset", "static"):
        config["groups"][group]["count"] //= 10
    path = tmp_path_factory.mktemp("paper") / "paper.yaml"
    path.write_text(json.dumps(config))
    return planned_jobs(project, "all", "--configfile", str(path))


SHARDED = {
    *("animate_bodies", "make_outfits", "simulate_outfits", "write_samples", "render_gallery"),
    *("register_samples", "register_outfits", "fit_templates", "sample_clouds", "sample_fields"),
}


def test_the_paper_s_size_is_few_long_jobs(paper):
    sharded = [job for job in paper if job[0] in SHARDED]
    assert 10 * len(sharded) + len(paper) - len(sharded) < 3000
    # What is asked for is three times what is expected.
    minutes = [int(job[1]["runtime"]) / 3 for job in paper]
    weights = [10 if job[0] in SHARDED else 1 for job in paper]
    spread = [m for m, weight in zip(minutes, weights, strict=True) for _ in range(weight)]
    assert median(spread) > 3
    assert sum(spread) / len(spread) > 10


def test_a_shard_asks_for_its_longest_and_not_for_the_sum(paper):
    shards = [resources for rule, resources in paper if rule == "simulate_outfits"]
    assert len(shards) == 18
    assert {int(resources["mem_mb"]) for resources in shards} == {3000}
    assert all(60 < int(resources["runtime"]) < 24 * 60 for resources in shards)


def test_each_step_is_a_job_for_each_shard(project, tmp_path):
    pairs = tmp_path / "pairs.yaml"
    pairs.write_text(json.dumps({"groups": {"dataset": {"shard_size": 2}}}))
    steps = ("animate_bodies", "make_outfits", "simulate_outfits", "write_samples")
    for configs, jobs in (([TINY], 5), ([TINY, str(pairs)], 4)):
        rules = [rule for rule, _ in planned_jobs(project, "all", "--configfile", *configs)]
        at_rest = 2
        assert {rule: rules.count(rule) for rule in steps} == {
            **dict.fromkeys(steps, jobs),
            "make_outfits": jobs + at_rest,
        }


@pytest.mark.parametrize(
    ("solver", "accelerator", "gpus"),
    [("xpbd", "gpu", "1"), ("xpbd", "auto", "0"), ("blender", "gpu", "0")],
)
def test_simulations_ask_for_a_gpu_where_their_solver_can_use_one(
    project, tmp_path, solver, accelerator, gpus
):
    mine = {"simulation": {"solver": solver, "accelerator": accelerator}}
    (tmp_path / "mine.yaml").write_text(json.dumps(mine))
    jobs = planned_jobs(project, "dataset", "--configfile", TINY, str(tmp_path / "mine.yaml"))
    for rule in ("simulate_outfits", "write_samples"):
        assert [resources["gpu"] for name, resources in jobs if name == rule] == [gpus] * 3


@pytest.mark.parametrize(("accelerator", "gpus"), [("auto", "0"), ("gpu", "1")])
def test_what_uses_a_gpu_asks_for_one_where_the_config_does(project, tmp_path, accelerator, gpus):
    config = yaml.safe_load((ROOT / TINY).read_text())
    for model in ("gcvae", "garment4d"):
        config[model]["trainer"] = {"accelerator": accelerator}
    config.setdefault("simulation", {})["accelerator"] = accelerator
    (tmp_path / "mine.yaml").write_text(json.dumps(config))
    jobs = planned_jobs(project, "all", "--configfile", str(tmp_path / "mine.yaml"))
    asked = {}
    for rule, resources in jobs:
        asked.setdefault(rule, set()).add(resources.get("gpu"))
    assert asked["train"] == asked["evaluate"] == {"0", gpus}
    assert asked["simulate_outfits"] == {"0", gpus}  # by Blender, and by the other solver


def test_trainings_and_the_evaluation_of_garment4d_can_use_a_gpu():
    config = yaml.safe_load((ROOT / TINY).read_text())
    for model in models():
        config.setdefault(model, {})["trainer"] = {"accelerator": "gpu"}
    plans = {name: model.plan(files_of(config)) for name, model in models().items()}
    using = {
        name: {task for task, one in tasks_of(plan).items() if one.gpus}
        for name, plan in plans.items()
    }
    # Conditionings and PCA have no use for one.
    assert using["gcvae"] == {*SVAE_VARIANTS, *DVAE_VARIANTS, PICTURES}
    assert using["smplicit"] == set(plans["smplicit"].trainings)
    evaluated = {f"evaluated/Skirt{end}" for end in ("", "_ablations")}
    assert using["garment4d"] == {*plans["garment4d"].trainings, *evaluated}
