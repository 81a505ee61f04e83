"""The comparison of fits to scans, with fits whose error is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from drapeline.dataset.reader import Sample
from drapeline.dataset.segmented_scans import save_scans, scan_sample
from drapeline.dataset.settings import ScanSettings
from drapeline.errors import DamagedFile
from drapeline.geometry.mesh import Mesh, vertex_normals
from drapeline.metrics.cost import read_costs
from drapeline.metrics.predictions import BODY, FITTED, TRUE, load_fitted_scans
from drapeline.metrics.properties import COMMON
from drapeline.metrics.table import ALL, METRICS, read_metrics
from drapeline.models import contract
from drapeline.models.compare import (
    MOVED,
    SCAN,
    answer_frames,
    body_rows,
    compare_frames,
    known_scans,
    skin_of,
    truth_shown,
    write_frames,
)
from drapeline.models.contract import Stopwatch
from drapeline.outfits.garment_types import GARMENT4D_TYPES
from toys.jobs import job_of
from toys.metric_rows import find_value
from toys.tiny_sample import TIGHTNESS, write_tiny_sample

ABOUT = {"garments": GARMENT4D_TYPES, "split": "test", "seed": 3}


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


def raised(*heights):
    """An answer: the simulated garments, each time a given height above themselves."""

    def answer(known):
        return {
            f"raised_{height}": {
                name: replace(mesh, vertices=mesh.vertices + np.float32([0, 0, height]))
                for name, mesh in known.true.items()
            }
            for height in heights
        }

    return answer


def rows_of(scans, answer, model=SCAN, **told):
    return compare_frames(scans, answer, Stopwatch(), model=model, **{**ABOUT, **told})[0]


def test_a_file_may_hold_scans_of_several_samples(tmp_path, toy_body, bodies):
    files, folders = scanned(tmp_path, toy_body, ["00003", "L00002"])
    several = known_scans(files, folders[::-1], bodies)
    assert [(one.clip, one.scan.name) for one in several] == [
        ("walk", f"{name}_{frame:03d}") for name in ("00003", "L00002") for frame in (1, 4)
    ]


def test_a_scan_of_a_sample_that_is_not_given_is_refused(tmp_path, toy_body, bodies):
    files, folders = scanned(tmp_path, toy_body, ["00003"])
    sentence = r"scans\.npz: has a scan of '00003', expected one of the 1 samples"
    with pytest.raises(DamagedFile, match=sentence):
        known_scans(files, folders[:1], bodies)


def test_the_truth_is_that_of_the_frame(known):
    assert [one.scan.name for one in known] == ["00001_001", "00001_004"]
    for one in known:
        assert set(one.true) == set(one.scan.garments) == set(one.classes)


def test_a_person_is_known_up_to_the_frame(known, tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body)
    for one in known:
        person, frame = one.person, one.scan.frame
        np.testing.assert_array_equal(person.tightness, TIGHTNESS)
        assert (person.sample, person.gender) == ("00001", one.scan.gender)
        assert len(person.poses) == len(person.trans) == frame + 1
        np.testing.assert_allclose(person.poses, tiny.poses[: frame + 1], atol=1e-5)
        np.testing.assert_allclose(person.trans, tiny.trans[: frame + 1], atol=1e-5)
        assert [*person.rest] == ["Skirt", "Tshirt"]  # from the inside to the outside
        for name, mesh in person.rest.items():
            rest = tiny.meshes[name]
            np.testing.assert_allclose(mesh.vertices, rest.vertices, atol=1e-5)
            np.testing.assert_array_equal(mesh.faces, one.true[name].faces)


def thick(mesh, by_m):
    """The mesh, moved along its normals."""
    return replace(mesh, vertices=mesh.vertices + by_m * vertex_normals(mesh.vertices, mesh.faces))


def test_garments_that_are_moved_right_measure_nothing_and_others_how_far_off_they_are(known):
    """Spheres, which are as far from one another everywhere as their radii say."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    sphere = Mesh(ball.vertices, np.asarray(ball.faces))
    scans = [one._replace(true=dict.fromkeys(one.true, sphere)) for one in known]

    def move(one):
        return {
            variant: {name: thick(mesh, by_m) for name, mesh in one.true.items()}
            for variant, by_m in (("true", 0.0), ("off", 0.01))
        }

    rows = rows_of(scans, move, model=MOVED)
    assert {*rows["model"]} == {MOVED}
    for metric in ("surface_to_true_mm", "true_to_surface_mm"):
        assert find_value(rows, "true", "test", ALL, metric).value == pytest.approx(0, abs=1e-3)
        assert find_value(rows, "off", "test", ALL, metric).value == pytest.approx(10, rel=0.01)


def test_costs_are_of_each_variant_for_one_garment(known, monkeypatch):
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(contract, "process_time", lambda: clock.now)
    watch = Stopwatch()

    def answer(one):
        """Both need four seconds of preparation; the second needs six more of its own."""
        clock.now += 1000  # is nothing to them
        with watch.of("raised_0.0", "raised_0.02"):
            clock.now += 4
        with watch.of("raised_0.02"):
            clock.now += 6
        return raised(0.0, 0.02)(one)

    _, _, costs = compare_frames(known, answer, watch, model=MOVED, **ABOUT)
    garments = sum(len(one.true) for one in known)
    assert [one[:4] for one in costs] == [
        (MOVED, "raised_0.0", pytest.approx(4 * len(known) / garments), garments),
        (MOVED, "raised_0.02", pytest.approx(10 * len(known) / garments), garments),
    ]


def test_an_evaluation_leaves_rows_fits_and_costs(known, tmp_path):
    found = compare_frames(known, raised(0.02), Stopwatch(), model=MOVED, **ABOUT)
    write_frames(tmp_path / "moved", *found)
    rows, fits, costs = found
    read = read_metrics(tmp_path / "moved/metrics.tsv")
    assert read["value"].tolist() == pytest.approx(rows["value"].tolist(), rel=1e-5)
    assert load_fitted_scans(tmp_path / "moved" / FITTED).keys() == fits.keys()
    assert read_costs([tmp_path / "moved"])["variant"].tolist() == [one.variant for one in costs]


def test_distances_are_those_of_the_fits_by_class(known):
    rows, found, _ = compare_frames(known, raised(0.0, 0.02), Stopwatch(), model=SCAN, **ABOUT)
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
        rows = rows_of(scans, raised(0.02))
        return find_value(rows, "raised_0.02", "test", garment, metric)

    every, common = (found([dress, other], name) for name in (ALL, COMMON))
    alone = found([other], ALL)
    assert (common["value"], common["n"]) == (alone["value"], alone["n"])
    assert every.n == common.n + 1
    assert found([dress], COMMON) is None


@pytest.mark.parametrize("garments", [["Skirt"], ["Tshirt", "Dress"], ["Skirt", "Tshirt"]])
def test_which_garments_all_models_know_is_told(known, garments):
    rows = rows_of(known, raised(0.0, 0.02), garments=garments)
    alone = [
        one._replace(true={name: mesh for name, mesh in one.true.items() if name in garments})
        for one in known
    ]
    expected = rows_of(alone, raised(0.0, 0.02))
    for variant in ("raised_0.0", "raised_0.02"):
        common = find_value(rows, variant, "test", COMMON, "surface_to_true_mm")
        own = find_value(expected, variant, "test", ALL, "surface_to_true_mm")
        assert (common["value"], common["n"]) == (own["value"], own["n"])
        every = find_value(rows, variant, "test", ALL, "surface_to_true_mm")
        assert every.n == sum(len(one.true) for one in known)


def test_jobs_tell_which_garments_all_models_know(known, tmp_path):
    told = {**ABOUT, "garments": ["Tshirt"]}
    answer_frames(job_of({}, tmp_path / "moved", **told), known, raised(0.02), Stopwatch(), MOVED)
    rows = read_metrics(tmp_path / "moved/metrics.tsv")
    assert find_value(rows, "raised_0.02", "test", COMMON, "surface_to_true_mm").n == len(known)


def test_garments_of_several_solvers_have_rows_of_their_own_besides_those_of_all(known):
    blender, xpbd = (
        one._replace(source=name) for one, name in zip(known, ("blender", "xpbd"), strict=True)
    )

    def found(scans, source=""):
        rows = rows_of(scans, raised(0.02))
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
    rows = body_rows(known, states, bodies, model="clean_scan", split="test", seed=3)
    assert {*rows["model"]} == {"clean_scan"}
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
