"""The rules that make static outfits, register them and collect them, from end to end."""

from dataclasses import asdict

import numpy as np
import pytest
from PIL import Image

from drapeline.bodies.model import load_body, save_body
from drapeline.generation.settled import settle_static
from drapeline.learning_data.static import StaticData, collect_static
from drapeline.outfits.static import load_static
from drapeline.outfits.static_plan import plan_static
from drapeline.outfits.templates import build_templates
from drapeline.simulation.settings import SimulationSettings
from drapeline.xpbd.solver import cloth_solver
from toys.bounds import NO_BOUNDS

OUTFIT_TYPES = ["Tshirt+Trousers", "Top+Skirt", "Dress", "Jumpsuit"]


@pytest.fixture(scope="module")
def stages(toy_body, tmp_path_factory):
    """Toy bodies and templates of both genders."""
    folder = tmp_path_factory.mktemp("static")
    templates = build_templates(toy_body)
    for gender in ("female", "male"):
        save_body(folder / f"{gender}.npz", toy_body)
        templates.save(folder / f"{gender}_templates.npz")
    return folder


@pytest.fixture(scope="module")
def supers(run_rule, stages):
    """Files of the finer bodies that garments are registered to, by gender, and their topology."""
    genders = ("female", "male")
    made = {name: stages / f"super_{name}.npz" for name in (*genders, "topology")}
    run_rule(
        "build_super_body",
        input={gender: stages / f"{gender}.npz" for gender in genders},
        output=made,
        params={"vertices": 4000},
    )
    return made


@pytest.fixture(scope="module")
def plans():
    shares = {"val": 0.25, "test": 0.25}
    return plan_static(3, 4, 4, shares, 1.0, OUTFIT_TYPES, male_skirts=False)["000"]


def make(run_rule, stages, plans, name="000", settling=None, elastics=0.5):
    run_rule(
        "make_static_outfits",
        input={
            f"{gender}_{what}": stages / f"{gender}{end}.npz"
            for gender in ("female", "male")
            for what, end in (("body", ""), ("templates", "_templates"))
        },
        output={"arrays": stages / f"{name}.npz", "parameters": stages / f"{name}.json"},
        params={
            "seed": 3,
            "plans": [asdict(plan) for plan in plans],
            "shape_range": 1.0,
            "edge_length_m": 0.035,
            "tightness_range": [-0.5, 0.5],
            "elastic_probability": elastics,
            "settling": settling or {},
        },
        wildcards={"shard": name},
    )


def settling(**bounds):
    return {
        "modules": [settle_static.__module__, cloth_solver.__module__],
        "accelerator": "cpu",
        "frames": 12,
        "settings": SimulationSettings(
            steps_min=8, steps_max=8, shape_frames=2, pose_frames=1
        ).plain(),
        "bounds": NO_BOUNDS.replace(**bounds).plain(),
    }


def test_outfits_become_offsets_and_arrays(run_rule, stages, supers, plans):
    make(run_rule, stages, plans)
    outfits = load_static(stages / "000.npz")
    assert [(o.name, o.split) for o in outfits] == [(p.name, p.split) for p in plans]
    run_rule(
        "register_static",
        input={"outfits": stages / "000.npz", **supers},
        output={"offsets": stages / "offsets.npz", "errors": stages / "offsets.tsv"},
        wildcards={"shard": "000"},
    )
    rows = [line.split("\t") for line in (stages / "offsets.tsv").read_text().splitlines()]
    assert rows[0] == ["garment", "name", "metric", "value", "unit"]
    values = {(r[0], r[2]): float(r[3]) for r in rows[1:]}
    garments = {name for outfit_type in OUTFIT_TYPES for name in outfit_type.split("+")}
    assert {garment for garment, _ in values} == garments
    for garment in garments:
        assert values[garment, "garment_to_rebuilt_mean_mm"] < 3
        assert values[garment, "rebuilt_to_garment_mean_mm"] < 3
        assert values[garment, "area_lost_percent"] < 3
        assert values[garment, "holes_after"] == values[garment, "islands_after"] == 0
    bodies = {gender: load_body(supers[gender]) for gender in ("female", "male")}
    collect_static(stages / "data", [stages / "offsets.npz"], bodies)
    data = StaticData(stages / "data")
    assert len(data) == 6
    assert data.offsets.shape == (6, 4000, 3)
    splits = {
        s: {tuple(shape) for shape in np.round(data.shape[data.rows(s)], 6).tolist()}
        for s in ("train", "val", "test")
    }
    assert not splits["train"] & splits["test"]
    assert not splits["train"] & splits["val"]
    run_rule(
        "plot_registration",
        input={"outfits": [stages / "000.npz"], **supers},
        output=[stages / "registration.png"],
        params={"rays": 0.02},
    )
    with Image.open(stages / "registration.png") as image:
        assert image.height > 340 * len(garments)
        # Garments of three colours and errors stand beside one another.
        assert np.ptp(np.asarray(image.convert("RGB")), axis=2).max() > 60


@pytest.mark.parametrize("chance", [0.0, 1.0])
def test_ends_are_gathered_as_often_as_asked(run_rule, stages, plans, chance):
    make(run_rule, stages, plans, f"elastic{chance}", elastics=chance)
    garments = [g for o in load_static(stages / f"elastic{chance}.npz") for g in o.outfit.garments]
    gathered = [on for garment in garments for on in garment.about["elastic"].values()]
    assert gathered
    assert set(gathered) == {chance > 0}


def test_outfits_that_settle_sag_and_those_that_do_it_badly_stay(run_rule, stages, plans):
    """Without bounds all of them do; none is within bounds that let no edge change its length.

    The garments sink together: a wide skirt that swings may be higher than it was at this moment.
    """
    make(run_rule, stages, plans, "made")
    make(run_rule, stages, plans, "sagged", settling())
    make(run_rule, stages, plans, "kept", settling(stretch_low=1, stretch_high=1))
    made, sagged, kept = (load_static(stages / f"{n}.npz") for n in ("made", "sagged", "kept"))
    sunk = []
    for one, hung, same in zip(made, sagged, kept, strict=True):
        for a, b, c in zip(
            one.outfit.garments, hung.outfit.garments, same.outfit.garments, strict=True
        ):
            np.testing.assert_array_equal(a.faces, b.faces)
            np.testing.assert_array_equal(a.vertices, c.vertices)
            assert a.about == b.about
            moved = a.vertices - b.vertices
            assert np.linalg.norm(moved, axis=1).max() > 0.01
            sunk.append(moved[:, 2].mean())
    assert 0 < np.mean(sunk) < 0.2, sunk


def test_a_shard_without_its_parameters_ends_in_one_sentence(run_rule, stages, supers, plans):
    make(run_rule, stages, plans, "alone")
    (stages / "alone.json").unlink()
    with pytest.raises(SystemExit, match=r"drapeline: .*alone.json: no such file"):
        run_rule(
            "register_static",
            input={"outfits": stages / "alone.npz", **supers},
            output={"offsets": stages / "new.npz", "errors": stages / "new.tsv"},
        )
    assert not (stages / "new.npz").exists()
