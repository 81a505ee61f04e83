"""The rules that leave what is passed on: the dataset and the trained models."""

from dataclasses import replace

import pandas as pd

from drapeline.dataset.collect import collect_dataset
from drapeline.metrics.table import write_metrics
from drapeline.models.training.module import BEST
from toys.gcvae_files import save_model
from toys.metric_rows import metric_table
from toys.tiny_sample import write_tiny_sample


def test_a_dataset_is_released_under_the_names_of_the_config(run_rule, toy_body, tmp_path):
    body = replace(toy_body, name="drapeline-anny-female-1")
    collect_dataset([write_tiny_sample(tmp_path, body).folder], tmp_path / "dataset")
    run_rule(
        "release_dataset",
        input=[tmp_path / "dataset"],
        output=[tmp_path / "release"],
        params={"about": {"name": "toys", "creator": "Nobody", "version": "1.2.0"}},
    )
    assert '"name": "toys"' in (tmp_path / "release/croissant.json").read_text()
    assert list(pd.read_parquet(tmp_path / "release/samples.parquet")["sample"]) == ["00001"]


def test_models_are_packed_with_the_commit_of_this_copy(run_rule, tmp_path):
    save_model(tmp_path / "svae")
    write_metrics(tmp_path / "metrics.tsv", metric_table([]))
    package = {
        "folder": str(tmp_path / "svae"),
        "title": "Toys",
        "use": "model.sample(1)",
        "models": ["svae"],
        "variants": ["svae"],
        "metrics": ["surface_error_mm"],
        "garments": ["Skirt"],
    }
    splits = ("train", "val", "test")
    about = {
        "seed": 3,
        "samples": {split: {"sequences": 1, "outfits at rest": 2} for split in splits},
        "clips": {split: [] for split in splits},
        "learned": [],
        "config": "mine.yaml",
        "body_files": [],
    }
    run_rule(
        "pack_models",
        input={"model": tmp_path / "svae", "metrics": tmp_path / "metrics.tsv"},
        output=[tmp_path / "weights"],
        params={"told": {"models": {"rest/toy": package}, "about": about}},
    )
    assert (tmp_path / "weights/rest/toy" / BEST).is_file()
    card = (tmp_path / "weights/rest/toy/README.md").read_text()
    said = card.partition("at commit ")[2].partition(",")[0]
    assert said == "unknown" or len(said) >= 7
