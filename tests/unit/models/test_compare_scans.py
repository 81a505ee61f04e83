"""The comparison of fits to scans, with fits whose error is known."""

from dataclasses import replace

import numpy as np
import pytest

from drapeline.dataset.reader import Sample
from drapeline.dataset.segmented_scans import save_scans, scan_sample
from drapeline.dataset.settings import ScanSettings
from drapeline.errors import DamagedFile
from drapeline.metrics.predictions import BODY, TRUE
from drapeline.metrics.properties import COMMON
from drapeline.metrics.table import ALL, METRICS
from drapeline.models.compare import (
    SCAN,
    body_rows,
    compare_scan_fits,
    known_scans,
    skin_of,
    truth_shown,
)
from toys.metric_rows import find_value
from toys.tiny_sample import write_tiny_sample


@pytest.fixture(scope="module")
def bodies(toy_body):
    return {"female": toy_body, "male": toy_body}


@pytest.fixture(scope="module")
def known(tmp_path_factory, toy_body, bodies):
    """Two scans of a sample; the fitted body is the estimated one."""
    folder = tmp_path_factory.mktemp("scans")
    return known_scans(*scanned(folder, toy_body, ["00001"]), bodies)


def scanned(folder, body, names):
    """A file without scans and one with two scans of each sample, and the samples' folders."""
    folders = [write_tiny_sample(folder / name, body, name).folder for name in names]
    scans = []
    for path in folders:
        with Sample(path) as sample:
            scans += scan_sample(sample, body, ScanSettings(points=500, frames=2), 1)
    save_scans(folder / "scans.npz", scans, [scan.estimate for scan in scans])
    save_scans(folder / "none.npz", [], [])
    return [folder / "none.npz", folder / "scans.npz"], [folder / "rejected", *folders]


class Raised:
    """The simulated garments of some types, a given height above themselves."""

    def __init__(self, known, heights):
        self._true = {one.scan.name: one.true for one in known}
        self._heights = heights

    def fit(self, scan, body):
        return {
            f"raised_{height}": {
                name: replace(mesh, vertices=mesh.vertices + np.float32([0, 0, height]))
                for name, mesh in self._true[scan.name].items()
            }
            for height in self._heights
        }


def test_a_file_may_hold_scans_of_several_samples(tmp_path, toy_body, bodies):
    files, folders = scanned(tmp_path, toy_body, ["00003", "L00002"])
    several = known_scans(files, folders[::-1], bodies)
    assert [(one.clip, one.scan.name) for one in several] == [
        ("walk", f"{name}_{frame:03d}") for name in ("00003", "L00002") for frame in (1, 4)
    ]


def test_a_scan_of_a_sample_that_is_not_given_is_refused(tmp_path, toy_body, bodies):
    files, folders = scanned(tmp_path, toy_body, ["00003"])
    with pytest.raises(DamagedFile, match=r"scans\.npz: has a scan of '00003', expected one of 1"):
        known_scans(files, folders[:1], bodies)


def test_the_truth_is_that_of_the_frame(known):
    assert [one.scan.name for one in known] == ["00001_001", "00001_004"]
    for one in known:
        assert set(one.true) == set(one.scan.garments) == set(one.classes)


def test_distances_are_those_of_the_fits_by_class(known):
    rows, found = compare_scan_fits(known, Raised(known, [0.0, 0.02]), split="test", seed=3)
    assert {(row.model, row.split, row.seed) for row in rows.itertuples()} == {(SCAN, "test", 3)}
    classes = {name for one in known for name in one.classes.values()}
    assert set(rows["garment"]) == {ALL, COMMON, *classes}
    exact = find_value(rows, "raised_0.0", "test", ALL, "surface_to_true_mm")
    assert exact.value == pytest.approx(0, abs=1e-3)
    assert exact.n == sum(len(one.true) for one in known)
    for metric in ("surface_to_true_mm", "true_to_surface_mm"):
        assert 0 < find_value(rows, "raised_0.02", "test", ALL, metric).value < 20.1
    assert set(found) == {one.scan.name for one in known}


def test_garments_that_all_models_know_have_rows_of_their_own(known):
    (one, other), metric = known, "surface_to_true_mm"
    dress = one._replace(true={"Dress": other.true["Skirt"]}, classes={"Dress": "whole body"})

    def found(scans, garment):
        fitter = Raised(scans, [0.02])
        rows, _ = compare_scan_fits(scans, fitter, split="test", seed=3)
        return find_value(rows, "raised_0.02", "test", garment, metric)

    every, common = (found([dress, other], name) for name in (ALL, COMMON))
    alone = found([other], ALL)
    assert (common["value"], common["n"]) == (alone["value"], alone["n"])
    assert every.n == common.n + 1
    assert found([dress], COMMON) is None


def test_garments_of_several_solvers_have_rows_of_their_own_besides_those_of_all(known):
    blender, xpbd = (
        one._replace(source=name) for one, name in zip(known, ("blender", "xpbd"), strict=True)
    )
    fitter = Raised(known, [0.02])

    def found(scans, source=""):
        rows, _ = compare_scan_fits(scans, fitter, split="test", seed=3)
        return find_value(rows, "raised_0.02", "test", ALL, "surface_to_true_mm", source)

    both, own = found([blender, xpbd]), found([blender, xpbd], "xpbd")
    assert own.value == found([xpbd]).value != both.value
    assert both.n == 2 * own.n
    assert found([xpbd], "xpbd") is None


def test_bodies_are_compared_by_their_vertices(known, bodies):
    away = [
        one.scan.estimate._replace(trans=one.scan.estimate.trans + [0, 0, 10.0]) for one in known
    ]
    states = {"near": [one.body for one in known], "far": away}
    rows = body_rows(known, states, bodies, split="test", seed=3)
    near, far = (find_value(rows, name, "test", ALL, "vertex_error_mm") for name in states)
    assert 1 < near.value < 500
    assert far.value == pytest.approx(10_000, rel=0.05)
    assert not rows.duplicated(list(METRICS.key)).any()


def test_figures_get_the_simulated_garments_and_both_bodies(known, bodies):
    shown = truth_shown(known[0], bodies)
    assert {name: shown[TRUE][name] for name in known[0].true} == known[0].true
    np.testing.assert_array_equal(shown[TRUE][BODY].vertices, known[0].true_body)
    fitted = skin_of(known[0].body, bodies[known[0].scan.gender])
    np.testing.assert_array_equal(shown[BODY][BODY].vertices, fitted.vertices)
    assert len(fitted.vertices) == len(bodies["female"].v_template)
