"""The workflow on a cluster: how many jobs the paper's size has, and what they ask for."""

import json
import re
from statistics import median

import pytest
import yaml

from toys.snakemake_run import ROOT, snakemake

TINY, SHARDS = "tests/data/tiny.yaml", "tests/data/tiny_shards.yaml"


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
    config["samples"]["count"] //= 10
    config["static"]["count"] //= 10
    path = tmp_path_factory.mktemp("paper") / "paper.yaml"
    path.write_text(json.dumps(config))
    return planned_jobs(project, "all", "--configfile", str(path))


def test_the_paper_s_size_is_few_long_jobs(paper):
    per_share = [job for job in paper if re.match(r"make_samples|.*static|sample_fields", job[0])]
    others = len(paper) - len(per_share)
    assert 10 * len(per_share) + others < 3000
    # What is asked for is three times what is expected.
    minutes = [int(resources["runtime"]) / 3 for _, resources in paper]
    weights = [10 if job in per_share else 1 for job in paper]
    spread = [m for m, weight in zip(minutes, weights, strict=True) for _ in range(weight)]
    assert median(spread) > 5


def test_a_shard_asks_for_its_longest_and_not_for_the_sum(paper):
    shards = [resources for rule, resources in paper if rule.startswith("make_samples_")]
    assert len(shards) == 35
    assert {int(resources["mem_mb"]) for resources in shards} == {3000}
    assert all(60 < int(resources["runtime"]) < 24 * 60 for resources in shards)


def test_shards_replace_the_steps_of_samples(project):
    rules = [rule for rule, _ in planned_jobs(project, "all", "--configfile", TINY, SHARDS)]
    assert rules.count("make_samples_000") == rules.count("make_samples_001") == 1
    assert not {"write_sample", "render_gallery", "register_sample", "scan_sample"} & set(rules)
    single = [rule for rule, _ in planned_jobs(project, "all", "--configfile", TINY)]
    assert single.count("write_sample") == 3
    assert not any(rule.startswith("make_samples") for rule in single)


@pytest.mark.parametrize(
    ("solver", "accelerator", "gpus"),
    [("xpbd", "gpu", "1"), ("xpbd", "auto", "0"), ("blender", "gpu", "0")],
)
def test_shards_ask_for_a_gpu_where_their_simulations_do(
    project, tmp_path, solver, accelerator, gpus
):
    mine = {"simulation": {"solver": solver, "accelerator": accelerator}}
    (tmp_path / "mine.yaml").write_text(json.dumps(mine))
    files = TINY, SHARDS, str(tmp_path / "mine.yaml")
    jobs = planned_jobs(project, "all", "--configfile", *files)
    asked = [resources["gpu"] for rule, resources in jobs if rule.startswith("make_samples")]
    assert asked == [gpus] * 2


@pytest.mark.parametrize(("accelerator", "gpus"), [("auto", "0"), ("gpu", "1")])
def test_what_uses_a_gpu_asks_for_one_where_the_config_does(project, tmp_path, accelerator, gpus):
    config = yaml.safe_load((ROOT / TINY).read_text())
    for model in ("gcvae", "garment4d"):
        config[model]["trainer"] = {"accelerator": accelerator}
    config.setdefault("simulation", {})["accelerator"] = accelerator
    (tmp_path / "mine.yaml").write_text(json.dumps(config))
    jobs = planned_jobs(project, "all", "--configfile", str(tmp_path / "mine.yaml"))
    asked = {rule: resources.get("gpu") for rule, resources in jobs}
    for rule in ("train_svae", "train_dvae", "train_garment4d_posed", "evaluate_garment4d"):
        assert asked[rule] == gpus, rule
    assert asked["simulate_learning"] == gpus
    assert asked["simulate_outfit"] == "0"  # by Blender
    assert asked["evaluate_static"] is None
