"""The workflow as Snakemake reads it: plans of each size, refusals before any job."""

import shutil
import subprocess
import sys

import pytest
import yaml

from snakemake_run import ROOT, snakemake

CONFIGS = ["tests/data/tiny.yaml", "config.yaml", "workflow/config/paper.yaml"]


def with_settings(tmp_path, **settings):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"results": str(tmp_path / "results"), **settings}))
    return ["--dry-run", "all", "--configfile", str(path)]


def dry_run_error(tmp_path, **settings):
    run = snakemake("--nolock", *with_settings(tmp_path, **settings))
    assert run.returncode != 0
    assert not (tmp_path / "results").exists()
    return run.stderr + run.stdout


@pytest.mark.parametrize("config", CONFIGS[:2])
def test_each_size_plans_every_step(config, tmp_path):
    run = snakemake("--nolock", "--dry-run", "all", "--forceall", "--configfile", config)
    assert run.returncode == 0, run.stderr
    steps = {line.split()[0] for line in (run.stdout + run.stderr).splitlines() if line.strip()}
    for rule in ("import_motion", "animate_body", "make_outfit", "simulate_outfit", "write_sample"):
        assert rule in steps


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"samples": {"cuont": 3}}, "'samples.cuont' is not a setting, expected one of count"),
        ({"motions": {"sequences": ["wlak"]}}, "lists no 'wlak', expected one of walk, run"),
        (
            {"motions": {"frames": 300, "frames_min": 300, "loop_frames": 60}},
            "frames_min is 300, but the longest clip has",
        ),
        ({"outfits": {"tightness_range": [1, -1]}}, "is [1, -1], expected the lower end first"),
        (
            {"samples": {"count": 6, "val_share": 0}},
            "samples.val_share is 0 and samples.test_share 0.2, which puts none of 6 into val",
        ),
        (
            {"samples": {"count": 12}, "static": {"count": 24, "test_share": 0}},
            "static.test_share 0, which puts none of 24 into test",
        ),
        (
            {"outfits": {"types": ["Jumpsuit"]}, "garment4d": {"skinned": {"shards": 0}}},
            "the plan has 0 sequences of a",
        ),
    ],
)
def test_a_wrong_setting_stops_before_any_job(tmp_path, settings, message):
    text = dry_run_error(tmp_path, **settings)
    assert message in " ".join(text.split())


def test_what_only_training_needs_does_not_stop_the_dataset(tmp_path):
    config = with_settings(tmp_path, samples={"count": 1, "val_share": 0, "test_share": 0})[-1]
    target = str(tmp_path / "results/dataset")
    run = snakemake("--nolock", "--dry-run", target, "--configfile", config)
    assert run.returncode == 0, run.stderr


def test_a_missing_or_broken_motion_is_named_before_any_job(tmp_path):
    table = tmp_path / "clips.tsv"
    table.write_text("name\tfile\tloop\nmine\tmine.bvh\tno\n")
    text = dry_run_error(tmp_path, motions={"table": str(table), "sequences": []})
    assert "mine.bvh: no such file" in text
    (tmp_path / "mine.bvh").write_text("not a motion")
    assert "mine.bvh" in dry_run_error(tmp_path, motions={"table": str(table), "sequences": []})


def test_a_target_that_does_not_exist_is_refused(tmp_path):
    config = with_settings(tmp_path)[-1]
    run = snakemake(
        "--nolock", "--dry-run", str(tmp_path / "results/samples/99999"), "--configfile", config
    )
    assert run.returncode != 0
    assert "MissingRuleException" in run.stderr + run.stdout


def test_changing_library_code_reruns_the_rules_that_use_it(tmp_path):
    """In a copy of the project: outfit code counts for outfits, not for the body."""
    for name in ("Snakefile", "config.yaml"):
        shutil.copy(ROOT / name, tmp_path / name)
    for name in ("workflow", "scripts", "src", "envs"):
        # The other worker's compiled files come and go.
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    tree = tmp_path / "src" / "drapeline"

    def digests():
        code = (
            "from pathlib import Path\nfrom drapeline.experiment.source_digest import Sources\n"
            "sources = Sources('src')\n"
            "for p in sorted(Path('scripts').glob('*.py')):"
            " print(p.stem, sources.digest(p))"
        )
        run = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return dict(line.split() for line in run.stdout.splitlines())

    before = digests()
    with open(next(iter(sorted(tree.glob("outfits/templates*.py")))), "a") as stream:
        stream.write("\nADDED = 1\n")
    changed = {name for name, value in digests().items() if value != before[name]}
    assert "make_outfit" in changed
    assert not changed & {"bake_body", "import_motion", "animate_body"}
