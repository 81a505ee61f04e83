"""Frames of test samples that are simulated again."""

import numpy as np
import pytest

from drapeline.dataset.reader import Sample
from drapeline.generation.again import OTHER_SOLVER, REST_SHAPE, SampleAgain
from drapeline.metrics.cost import read_costs
from drapeline.metrics.predictions import FITTED, load_fitted_scans
from drapeline.metrics.properties import COMMON
from drapeline.metrics.table import ALL, METRICS_FILE, read_metrics
from drapeline.models.gcvae import floor
from drapeline.models.gcvae.floor import move_garments_again
from toys.jobs import job_of
from toys.metric_rows import find_value
from toys.protocol import SAMPLES, save_cases

TOLD = {"garments": ["Skirt"], "split": "test", "seed": 3}


@pytest.fixture(scope="module")
def given(tmp_path_factory, toy_body):
    """With exact scans of two frames of each sample."""
    files = save_cases(tmp_path_factory.mktemp("cases"), toy_body, window=1)
    return {**files, "scans": files["clean_scans"]}


def raised(folder, by_m):
    """Garment -> frames of a sample, so much higher."""
    with Sample(folder) as sample:
        return {
            name: sample.vertices(name, 0, len(sample), "root") + np.float32([0, 0, by_m])
            for name in sample.garments
        }


def test_each_way_has_rows_and_samples_that_broke_down_are_left_out(given, tmp_path, monkeypatch):
    ways, asked = {SAMPLES[0]: (REST_SHAPE, 0.0), SAMPLES[1]: (OTHER_SOLVER, 0.02)}, []

    def simulate(job, folders, bodies):
        asked.extend(folder.name for folder in folders)
        for folder in folders:
            if folder.name in ways:
                way, by_m = ways[folder.name]
                yield SampleAgain(folder.name, way, raised(folder, by_m))

    monkeypatch.setattr(floor, "simulate_samples_again", simulate)
    move_garments_again(job_of(given, tmp_path / "again", **TOLD))
    assert asked == [*SAMPLES]
    rows = read_metrics(tmp_path / "again" / METRICS_FILE)
    assert {*rows["model"]} == {"moved"}
    assert {*rows["variant"]} == {REST_SHAPE, OTHER_SOLVER}
    for way, by_mm in ways.values():
        to_true = find_value(rows, way, "test", ALL, "surface_to_true_mm")
        assert to_true.n == 4  # two garments in two frames of one sample
        assert (to_true.value == pytest.approx(0, abs=1e-3)) == (by_mm == 0)
        # Of the two garments, all models know the skirt.
        assert find_value(rows, way, "test", COMMON, "surface_to_true_mm").n == 2
    fits = load_fitted_scans(tmp_path / "again" / FITTED)
    assert {name.split("_")[0]: {*found} for name, found in fits.items()} == {
        name: {way} for name, (way, _) in ways.items()
    }
    for name, found in fits.items():
        sample, frame = name.split("_")
        way, by_m = ways[sample]
        true = raised(given["samples"][0] / sample, by_m)
        for garment, mesh in found[way].items():
            np.testing.assert_array_equal(mesh.vertices, true[garment][int(frame)])
    assert {*read_costs([tmp_path / "again"])["variant"]} == {REST_SHAPE, OTHER_SOLVER}


def test_only_samples_that_were_scanned_are_simulated(given, tmp_path, monkeypatch, toy_body):
    asked = []
    monkeypatch.setattr(
        floor,
        "simulate_samples_again",
        lambda job, folders, bodies: iter(asked.extend(one.name for one in folders) or ()),
    )
    none = save_cases(tmp_path / "none", toy_body, window=1, scanned=SAMPLES[1:])
    job = job_of({**given, "scans": none["clean_scans"]}, tmp_path / "out", **TOLD)
    move_garments_again(job)
    assert asked == [*SAMPLES[1:]]
    assert not len(read_metrics(tmp_path / "out" / METRICS_FILE))
