"""The rules that make outfits and simulate them."""

import json
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.model import save_body
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.sequence import save_body_sequence
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_meta
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.obj import load_obj
from drapeline.outfits.outfit import load_outfit

PLAN = SamplePlan("00001", "female", "Top+Skirt", "", "walk", 0, 0, 3)
PARAMS = {
    "seed": 5,
    "plans": [asdict(PLAN)],
    "bodies": {},
    "settings": {
        "edge_length_m": 0.05,
        "vertices_min": 0,
        "tightness_range": [-0.5, 0.5],
        "elastic_probability": 1.0,
    },
    "own_garments": {"female": {}, "male": {}},
    "hanging": {},
}


@pytest.fixture(scope="module")
def made(run_rule, toy_body, tmp_path_factory):
    """A toy body standing still, and its templates."""
    folder = tmp_path_factory.mktemp("made")
    save_body(folder / "body.npz", toy_body)
    (folder / "bodies").mkdir()
    poses, trans = np.repeat(REST_POSE[None], 3, 0), np.tile([0.0, 0.0, 0.9], (3, 1))
    record = make_body_sequence(toy_body, np.zeros(10), poses, trans, gender="female")
    save_body_sequence(folder / "bodies" / "00001.npz", record)
    run_rule(
        "build_templates",
        input={"body": folder / "body.npz"},
        output=[folder / "templates.npz"],
    )
    return folder


@pytest.fixture
def stages(made, tmp_path):
    """A folder of its own for each test."""
    return Path(shutil.copytree(made, tmp_path, dirs_exist_ok=True))


def make(run_rule, stages, **changes):
    forms = {"body": stages / "body.npz", "templates": stages / "templates.npz"}
    run_rule(
        "make_outfits",
        input={
            **{f"{gender}_{kind}": form for gender in GENDERS for kind, form in forms.items()},
            "bodies": stages / "bodies",
        },
        output=[stages / "outfits"],
        params={**PARAMS, **changes},
    )
    return load_outfit(stages / "outfits" / "00001.npz", stages / "outfits" / "00001.json")


def test_an_outfit_is_made_of_the_type_and_ranges_asked_for(run_rule, stages):
    outfit = make(run_rule, stages)
    assert [g.name for g in outfit.garments] == ["Skirt", "Top"]
    assert np.abs(outfit.tightness).max() <= 0.5
    again = make(run_rule, stages)
    np.testing.assert_array_equal(again.garments[0].vertices, outfit.garments[0].vertices)
    other = make(run_rule, stages, seed=6)
    assert not np.array_equal(other.tightness, outfit.tightness)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "no such file"),
        ("v 0 0 0\nv 90 0 0\nv 90 0 90\nv 0 0 90\nf 1 2 3 4\n", "centimetres|metres"),
        ("v 0 5 0\nv .5 5 0\nv .5 5 .5\nv 0 5 .5\nf 1 2 3 4\n", "far|body"),
    ],
)
def test_an_unusable_garment_of_the_user_ends_in_one_sentence_and_no_files(
    run_rule, stages, text, message
):
    path = stages / "mine.obj"
    if text:
        path.write_text(text)
    with pytest.raises(SystemExit, match=f"drapeline: .*mine.obj.*({message})"):
        make(run_rule, stages, own_garments={"female": {"Skirt": {"path": str(path)}}, "male": {}})
    assert not (stages / "outfits").exists()


def test_the_body_to_model_on_is_the_one_that_garments_are_checked_against(
    run_rule, stages, toy_body
):
    paths = {gender: stages / f"{gender}.obj" for gender in GENDERS}
    run_rule("body_obj", input=dict.fromkeys(GENDERS, stages / "body.npz"), output=paths)
    for path in paths.values():
        body = load_obj(path)
        np.testing.assert_allclose(body.vertices, rest_body(toy_body, np.zeros(10)), atol=1e-5)
        np.testing.assert_array_equal(body.faces, toy_body.faces)


SETTINGS = {"steps_min": 7, "steps_max": 7, "collider_share": 0.5}
BOUNDS = {"stretch_low": 0, "stretch_high": 9, "layer_share_mean": 1}
SOLVER = {"solver": "toys.cloth", "accelerator": "cpu"}


def inputs(stages):
    folders = {name: stages / name for name in ("bodies", "outfits")}
    return {**dict.fromkeys(GENDERS, stages / "body.npz"), **folders}


def simulate(run_rule, stages):
    """The folder of one attempt."""
    run_rule(
        "simulate_outfits",
        input=inputs(stages),
        output=[stages / "simulation"],
        params={"samples": ["00001"], "settings": SETTINGS, **SOLVER},
    )
    return stages / "simulation" / "00001"


def write(run_rule, stages, attempts=1, **bounds):
    """What the sample's record says of its simulation."""
    run_rule(
        "write_samples",
        input={**inputs(stages), "simulations": stages / "simulation"},
        output=[stages / "samples"],
        params={
            "seed": 5,
            "splits": {"00001": "val"},
            "settings": {**SETTINGS, "attempts": attempts},
            "bounds": {**BOUNDS, **bounds},
            **SOLVER,
        },
    )
    meta = read_meta(stages / "samples" / "00001")
    assert (meta["id"], meta["split"], meta["status"]) == (
        *("00001", "val"),
        meta["simulation"]["status"],
    )
    return meta["simulation"]


def test_an_attempt_is_measured_and_not_judged(run_rule, stages):
    make(run_rule, stages)
    folder = simulate(run_rule, stages)
    names = {"Skirt.f32", "Top.f32", "health.npz", "attempt.json"}
    assert {path.name for path in folder.iterdir()} == names
    record = json.loads((folder / "attempt.json").read_text())
    assert record["solver"]["name"] == "follower"
    assert record["attempt"]["steps"] == 7
    assert "slip_m" in record["attempt"]["measures"]
    assert "status" not in record["attempt"]


def test_a_sample_is_judged_by_the_bounds_of_its_rule(run_rule, stages):
    """Other bounds need no other simulation, and a further attempt is made only where they do."""
    make(run_rule, stages)
    simulate(run_rule, stages)
    accepted = write(run_rule, stages)
    assert accepted["status"] == "accepted", accepted["reason"]
    assert [attempt["steps"] for attempt in accepted["attempts"]] == [7]
    with Sample(stages / "samples" / "00001") as sample:
        assert {*sample.garments} == {"Skirt", "Top"}
    refused = write(run_rule, stages, stretch_low=1)
    assert refused["status"] == "rejected"
    assert "stretch_low" in refused["reason"]
    again = write(run_rule, stages, attempts=2, stretch_low=1)
    assert [attempt["status"] for attempt in again["attempts"]] == ["rejected", "rejected"]
    assert again["attempts"][1]["steps"] > 7
    files = [path.name for path in (stages / "samples" / "00001").rglob("*") if path.is_file()]
    assert sorted(files) == ["manifest.tsv", "meta.json", "worst_frame.npz"]


def test_an_attempt_that_another_bound_asks_for_may_be_accepted(run_rule, stages):
    make(run_rule, stages)
    folder = simulate(run_rule, stages)
    record = json.loads((folder / "attempt.json").read_text())
    record["attempt"]["failure"] = "no memory for cloth"
    (folder / "attempt.json").write_text(json.dumps(record))
    status = write(run_rule, stages, attempts=2)
    assert [attempt["status"] for attempt in status["attempts"]] == ["failed", "accepted"]
    assert status["status"] == "accepted"
    assert not [path for path in (stages / "samples").iterdir() if path.name.startswith(".")]


def test_a_rejected_body_is_a_rejected_sample_with_its_reason(run_rule, stages, toy_body):
    make(run_rule, stages)
    poses, trans = np.repeat(REST_POSE[None], 3, 0), np.tile([0.0, 0.0, 0.9], (3, 1))
    poses[:, 3 * 1 + 2], poses[:, 3 * 2 + 2] = -0.6, 0.6  # legs crossed through one another
    record = make_body_sequence(toy_body, np.zeros(10), poses, trans, gender="female")
    assert record.outcome == "rejected"
    save_body_sequence(stages / "bodies" / "00001.npz", record)
    assert [path.name for path in simulate(run_rule, stages).iterdir()] == ["attempt.json"]
    status = write(run_rule, stages)
    assert status["status"] == "rejected"
    assert "body" in status["reason"]


def test_a_simulation_that_was_cut_short_is_refused_and_not_left_behind(run_rule, stages):
    make(run_rule, stages)
    cache = simulate(run_rule, stages) / "Skirt.f32"
    cache.write_bytes(cache.read_bytes()[:-5])
    with pytest.raises(SystemExit, match=r"drapeline: .*Skirt.f32"):
        write(run_rule, stages)
    assert not (stages / "samples").exists()
