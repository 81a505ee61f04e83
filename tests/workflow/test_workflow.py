"""The workflow as Snakemake reads it: plans of each size, refusals before any job."""

import os
import re

import numpy as np
import pytest
import yaml

from toys.plans import files_of
from toys.snakemake_run import snakemake

CONFIGS = [
    *("tests/data/tiny.yaml", "config.yaml"),
    *("workflow/config/reference.yaml", "workflow/config/paper.yaml"),
]


def with_settings(tmp_path, **settings):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"results": str(tmp_path / "results"), **settings}))
    return ["--dry-run", "all", "--configfile", str(path)]


@pytest.fixture
def dry_run_error(project, tmp_path):
    """What a dry run says that these settings stop."""

    def error(**settings):
        run = snakemake(project, *with_settings(tmp_path, **settings))
        assert run.returncode != 0
        assert not (tmp_path / "results").exists()
        return run.stderr + run.stdout

    return error


@pytest.mark.parametrize("config", CONFIGS[:2])
def test_each_size_plans_every_step(config, project):
    run = snakemake(project, "--dry-run", "all", "--forceall", "--configfile", config)
    assert run.returncode == 0, run.stderr
    steps = {line.split()[0] for line in (run.stdout + run.stderr).splitlines() if line.strip()}
    for rule in (
        "import_motion",
        "animate_bodies",
        "make_outfits",
        "simulate_outfits",
        "write_samples",
    ):
        assert rule in steps


def test_published_samples_and_their_pictures_come_before_anything_else(project):
    config = "tests/data/tiny.yaml"
    run = snakemake(project, "--dry-run", "all", "--forceall", "--configfile", config)
    planned = run.stdout + run.stderr
    steps = ("animate_bodies", "make_outfits", "simulate_outfits", "write_samples")
    shared = ("import_motion", "copy_body", "build_templates")
    first, others = [], []
    for rule, text in re.findall(r"^rule (\w+):\n((?: .*\n)+)", planned, re.MULTILINE):
        priority = re.search(r"^ +priority: ([\d.]+)$", text, re.MULTILINE)
        pictures = rule in ("render_gallery", "collect_dataset", "write_overview")
        if pictures or (rule in steps and "group=dataset," in text):
            first.append(float(priority[1]))
        elif rule not in shared:
            others.append(float(priority[1]) if priority else 0)
    assert min(first) > max(others)


def test_types_left_out_are_neither_trained_nor_needed(project, tmp_path):
    config = with_settings(tmp_path, garment4d={"garments": ["Trousers"]})[-1]
    run = snakemake(project, "--dry-run", "all", "--forceall", "--configfile", config)
    assert run.returncode == 0, run.stderr
    planned = run.stdout + run.stderr
    assert "garment4d/Trousers/posed" in planned
    assert "garment4d/Skirt" not in planned
    assert "garment4d/Tshirt" not in planned


def test_a_type_is_learned_for_scans_though_nothing_is_compared_on_it(project, tmp_path):
    scans = {key: str(tmp_path / f"{key}.npz") for key in ("points", "body")}
    for path in scans.values():
        np.savez(path)
    config = with_settings(
        tmp_path, garment4d={"garments": ["Trousers"], "reconstruct": {"garment": "Dress", **scans}}
    )[-1]
    run = snakemake(project, "--dry-run", "reconstruct", "--configfile", config)
    assert run.returncode == 0, run.stderr
    planned = run.stdout + run.stderr
    for made in ("Dress/template.npz", "Dress/fits/", "Dress/data_surface", "Dress/ours", "labels"):
        assert f"garment4d/{made}" in planned
    assert "garment4d/labelled" in planned
    assert "canonical" not in planned
    assert "garment4d/Trousers" not in planned


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"groups": {"dataset": {"cuont": 3}}},
            "'groups.dataset.cuont' is not a setting, did you mean count?",
        ),
        (
            {"motions": {"frames": 300, "frames_min": 300, "loop_frames": 60}},
            "frames_min is 300, but some clips have fewer frames at 30 fps: walk 60, run 60,",
        ),
        (
            {"groups": {"dataset": {"count": 40, "val_share": 0}}},
            "groups.dataset.val_share is 0 and its test_share 0.2, which puts none of 40 into val",
        ),
        (
            {"groups": {"dataset": {"count": 12}, "static": {"count": 24, "test_share": 0}}},
            "its test_share 0, which puts none of 24 into test",
        ),
        ({"learning": {"count": 3}}, "'learning.count' is called groups.learning.count now"),
        (
            {"outfits": {"types": ["Jumpsuit"]}, "garment4d": {"skinned": {"shards": 0}}},
            "the plan has no simulated",
        ),
    ],
)
def test_a_wrong_setting_stops_before_any_job(dry_run_error, settings, message):
    text = dry_run_error(**settings)
    assert message in " ".join(text.split())


def test_what_only_training_needs_does_not_stop_the_dataset(project, tmp_path):
    config = with_settings(
        tmp_path, groups={"dataset": {"count": 1, "val_share": 0, "test_share": 0}}
    )[-1]
    target = str(tmp_path / "results/dataset")
    run = snakemake(project, "--dry-run", target, "--configfile", config)
    assert run.returncode == 0, run.stderr


def test_a_table_of_ones_own_means_all_its_rows(project, tmp_path):
    clips = project / "workflow/resources/motions"
    table = tmp_path / "mine.tsv"
    table.write_text(f"name\tfile\nwalk\t{clips}/walk.npz\nmine\t{clips}/kick.npz\n")
    config = with_settings(tmp_path, motions={"table": str(table)})[-1]
    run = snakemake(project, "dataset", "--dry-run", "--configfile", config)
    assert run.returncode == 0, run.stderr
    assert set(re.findall(r"motions/(\w+)/\w+\.npz", run.stdout + run.stderr)) >= {"walk", "mine"}
    assert "motions/dance_a/" not in run.stdout + run.stderr


def test_configs_are_laid_over_one_another_only_where_the_user_names_them(project, tmp_path):
    config = with_settings(tmp_path, groups={"dataset": {"count": 20}})[-1]
    others = [len(group.shards) for group in files_of("config.yaml").published[1:]]
    both = ["config.yaml", config]
    for configs, clips, samples in (([config], 15, 20), (both, 8, 20 + sum(others))):
        run = snakemake(project, "dataset", "--dry-run", "--configfile", *configs)
        assert run.returncode == 0, run.stderr
        assert re.search(rf"^import_motion +{clips}$", run.stdout + run.stderr, re.MULTILINE)
        assert re.search(rf"^simulate_outfits +{samples}$", run.stdout + run.stderr, re.MULTILINE)


def test_a_missing_or_broken_motion_is_named_before_any_job(dry_run_error, tmp_path):
    table = tmp_path / "clips.tsv"
    table.write_text("name\tfile\tloop\nmine\tmine.bvh\tno\n")
    text = dry_run_error(motions={"table": str(table), "sequences": []})
    assert "mine.bvh: no such file" in text
    (tmp_path / "mine.bvh").write_text("not a motion")
    assert "mine.bvh" in dry_run_error(motions={"table": str(table), "sequences": []})


def test_a_target_that_does_not_exist_is_refused(project, tmp_path):
    config = with_settings(tmp_path)[-1]
    target = str(tmp_path / "results/samples/datasets/00001")
    run = snakemake(project, "--dry-run", target, "--configfile", config)
    assert run.returncode != 0
    meant = tmp_path / "results/samples/dataset/00001"
    assert f"did you mean {meant}?" in run.stderr + run.stdout
    assert not (tmp_path / "results").exists()


def test_a_folder_of_answers_is_scored_under_its_name_however_it_is_given(project, tmp_path):
    mesh = tmp_path / "mine/motion/00001_001/Skirt.obj"
    mesh.parent.mkdir(parents=True)
    mesh.touch()
    config = with_settings(tmp_path)[-1]
    words = ["--dry-run", "compare_systems", "score", "--configfile", config, "--config"]
    for folder in (os.path.relpath(tmp_path / "mine", project), f"{tmp_path}/mine/"):
        run = snakemake(project, *words, f"predictions={folder}")
        assert run.returncode == 0, run.stderr
        jobs = dict(
            re.findall(r"^rule (\w+):\n((?: .*\n)+)", run.stdout + run.stderr, re.MULTILINE)
        )
        scored = str(tmp_path / "results/scores/mine")
        assert f"output: {scored}\n" in jobs["score_predictions"]
        assert "Skirt.obj" in jobs["score_predictions"]
        assert scored in jobs["tabulate_score"]
        assert scored in jobs["tabulate_systems"]


def test_scoring_without_a_folder_of_answers_is_refused(project, tmp_path):
    config = with_settings(tmp_path)[-1]
    run = snakemake(project, "--dry-run", "score", "--configfile", config)
    assert run.returncode != 0
    assert "predictions is not set, expected a folder of meshes" in run.stderr + run.stdout
