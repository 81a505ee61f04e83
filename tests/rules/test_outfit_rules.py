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
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.obj import load_obj
from drapeline.outfits.outfit import load_outfit

PLAN = SamplePlan("00001", "walk", 0, 0, 3, "female", "Top+Skirt")
PARAMS = {
    "seed": 5,
    "plan": asdict(PLAN),
    "settings": {
        "edge_length_m": 0.05,
        "vertices_min": 0,
        "tightness_range": [-0.5, 0.5],
        "elastic_probability": 1.0,
    },
    "own_garments": {},
}


@pytest.fixture(scope="module")
def made(run_rule, toy_body, tmp_path_factory):
    """A toy body standing still, and its templates."""
    folder = tmp_path_factory.mktemp("made")
    save_body(folder / "body.npz", toy_body)
    poses, trans = np.repeat(REST_POSE[None], 3, 0), np.tile([0.0, 0.0, 0.9], (3, 1))
    record = make_body_sequence(toy_body, np.zeros(10), poses, trans, gender=0)
    save_body_sequence(folder / "animation.npz", record)
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
    run_rule(
        "make_outfit",
        input={
            "body": stages / "body.npz",
            "animation": stages / "animation.npz",
            "templates": stages / "templates.npz",
        },
        output={"arrays": stages / "outfit.npz", "parameters": stages / "outfit.json"},
        params={**PARAMS, **changes},
        wildcards={"sample": "00001"},
    )
    return load_outfit(stages / "outfit.npz", stages / "outfit.json")


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
        make(run_rule, stages, own_garments={"Skirt": {"path": str(path)}})
    assert not (stages / "outfit.npz").exists()
    assert not (stages / "outfit.json").exists()


def test_the_body_to_model_on_is_the_one_that_garments_are_checked_against(
    run_rule, stages, toy_body
):
    paths = {gender: stages / f"{gender}.obj" for gender in GENDERS}
    run_rule("body_obj", input=dict.fromkeys(GENDERS, stages / "body.npz"), output=paths)
    for path in paths.values():
        body = load_obj(path)
        np.testing.assert_allclose(body.vertices, rest_body(toy_body, np.zeros(10)), atol=1e-5)
        np.testing.assert_array_equal(body.faces, toy_body.faces)


def simulate(run_rule, stages, **params):
    run_rule(
        "simulate_outfit",
        input={
            "body": stages / "body.npz",
            "animation": stages / "animation.npz",
            "outfit": stages / "outfit.npz",
            "parameters": stages / "outfit.json",
        },
        output=[stages / "simulation"],
        params={"solver": "toys.cloth", "accelerator": "cpu", "settings": {}, "bounds": {}}
        | params,
    )
    return json.loads((stages / "simulation" / "status.json").read_text())


def test_the_solver_settings_and_bounds_are_those_of_the_rule(run_rule, stages):
    make(run_rule, stages)
    settings = {"steps_min": 7, "steps_max": 7, "attempts": 1, "collider_share": 0.5}
    bounds = {"stretch_low": 0, "stretch_high": 9, "layer_share_mean": 1}
    status = simulate(run_rule, stages, settings=settings, bounds=bounds)
    assert status["status"] == "accepted", status["reason"]
    assert status["solver"]["name"] == "follower"
    assert [attempt["steps"] for attempt in status["attempts"]] == [7]
    names = {"Skirt.f32", "Top.f32", "health.npz", "status.json"}
    assert {path.name for path in (stages / "simulation").iterdir()} == names
    refused = simulate(run_rule, stages, settings=settings, bounds=bounds | {"stretch_low": 1})
    assert refused["status"] == "rejected"
    assert "stretch_low" in refused["reason"]


def test_a_rejected_body_is_a_rejected_sample_with_its_reason(run_rule, stages, toy_body):
    make(run_rule, stages)
    poses, trans = np.repeat(REST_POSE[None], 3, 0), np.tile([0.0, 0.0, 0.9], (3, 1))
    poses[:, 3 * 1 + 2], poses[:, 3 * 2 + 2] = -0.6, 0.6  # legs crossed through one another
    record = make_body_sequence(toy_body, np.zeros(10), poses, trans, gender=0)
    assert record.outcome == "rejected"
    save_body_sequence(stages / "animation.npz", record)
    status = simulate(run_rule, stages)
    assert status["status"] == "rejected"
    assert "body" in status["reason"]
    assert [p.name for p in (stages / "simulation").iterdir()] == ["status.json"]
