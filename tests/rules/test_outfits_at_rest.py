"""The rules that make outfits at rest, register them and collect them, from end to end."""

from dataclasses import asdict

import numpy as np
import pytest
from PIL import Image

from drapeline.bodies.model import save_body
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import GENDERS
from drapeline.generation.hung_outfits import Hanger
from drapeline.learning_data.static import StaticData
from drapeline.outfits.garment_types import FITS
from drapeline.outfits.static import load_static
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


PLANS = [
    SamplePlan(f"s{number:05d}", "female", outfit_type, split)
    for number, (outfit_type, split) in enumerate(
        zip(OUTFIT_TYPES, ("train", "val", "train", "test"), strict=True), 1
    )
]


def make(run_rule, stages, name="made", hanging=None, elastics=0.5, fits=FITS):
    run_rule(
        "make_outfits",
        input={
            f"{gender}_{what}": stages / f"{gender}{end}.npz"
            for gender in GENDERS
            for what, end in (("body", ""), ("templates", "_templates"))
        },
        output=[stages / name],
        params={
            "seed": 3,
            "plans": [asdict(plan) for plan in PLANS],
            "bodies": {"shape_range": 1.0, "bmi_range": None},
            "settings": {
                "edge_length_m": 0.035,
                "vertices_min": 0,
                "tightness_range": [-0.5, 0.5],
                "elastic_probability": elastics,
                "fits": fits,
            },
            "own_garments": {gender: {} for gender in GENDERS},
            "hanging": hanging or {},
        },
    )
    return load_static(stages / name)


def hanging(**bounds):
    return {
        "modules": [Hanger.__module__, cloth_solver.__module__],
        "accelerator": "cpu",
        "how": {
            "frames": 12,
            "settings": SimulationSettings(steps_min=8, steps_max=8, shape_frames=2).plain(),
            "bounds": NO_BOUNDS.replace(**bounds).plain(),
        },
    }


def test_no_two_outfits_share_a_body_or_parameters(run_rule, stages):
    outfits = make(run_rule, stages, "unlike")
    shapes = np.array([one.outfit.shape for one in outfits])
    apart = np.abs(shapes[:, None] - shapes[None]).sum(-1)[~np.eye(len(shapes), dtype=bool)]
    assert apart.min() > 0.1
    seeds = [
        g.attributes["parameters"]["fold_seed"] for one in outfits for g in one.outfit.garments
    ]
    assert len(set(seeds)) == len(seeds)


def test_outfits_become_offsets_and_arrays(run_rule, stages, supers):
    outfits = make(run_rule, stages)
    assert [(o.name, o.split) for o in outfits] == [(p.sample, p.split) for p in PLANS]
    run_rule(
        "register_outfits",
        input={"outfits": stages / "made", **supers},
        output=[stages / "registered"],
    )
    table = stages / "registered" / "metrics.tsv"
    rows = [line.split("\t") for line in table.read_text().splitlines()]
    assert rows[0] == ["garment", "name", "metric", "value", "unit"]
    values = {(r[0], r[2]): float(r[3]) for r in rows[1:]}
    garments = {name for outfit_type in OUTFIT_TYPES for name in outfit_type.split("+")}
    assert {garment for garment, _ in values} == garments
    for garment in garments:
        assert values[garment, "garment_to_rebuilt_mean_mm"] < 3
        assert values[garment, "rebuilt_to_garment_mean_mm"] < 3
        assert values[garment, "area_lost_percent"] < 3
        assert values[garment, "holes_after"] == values[garment, "islands_after"] == 0
    run_rule(
        "collect_static",
        input={"registrations": [stages / "registered"], **supers},
        output=[stages / "data"],
    )
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
        input={"outfits": [stages / "made"], **supers},
        output=[stages / "registration.png"],
        params={"rays": 0.02, "garments": sorted(garments)},
    )
    with Image.open(stages / "registration.png") as image:
        assert image.height > 340 * len(garments)
        # Garments of three colours and errors stand beside one another.
        assert np.ptp(np.asarray(image.convert("RGB")), axis=2).max() > 60


@pytest.mark.parametrize("chance", [0.0, 1.0])
def test_ends_are_gathered_as_often_as_asked(run_rule, stages, chance):
    outfits = make(run_rule, stages, f"elastic{chance}", elastics=chance, fits=("regular",))
    garments = [garment for one in outfits for garment in one.outfit.garments]
    gathered = [on for garment in garments for on in garment.attributes["elastic"].values()]
    assert gathered
    assert set(gathered) == {chance > 0}


def test_outfits_that_hang_sag_and_those_that_do_it_badly_stay(run_rule, stages):
    """Without bounds all of them do; none is within bounds that let no edge stretch.

    The garments sink together: a wide skirt that swings may be higher than it was at this moment.
    """
    made = make(run_rule, stages, "as_made")
    sagged = make(run_rule, stages, "sagged", hanging())
    kept = make(run_rule, stages, "kept", hanging(stretch_high=1))
    sunk = []
    for one, hung, same in zip(made, sagged, kept, strict=True):
        for a, b, c in zip(
            one.outfit.garments, hung.outfit.garments, same.outfit.garments, strict=True
        ):
            np.testing.assert_array_equal(a.faces, b.faces)
            np.testing.assert_array_equal(a.vertices, c.vertices)
            assert a.attributes == b.attributes
            moved = a.vertices - b.vertices
            assert np.linalg.norm(moved, axis=1).max() > 0.01
            sunk.append(moved[:, 2].mean())
    assert 0 < np.mean(sunk) < 0.2, sunk


def test_a_shard_without_its_parameters_ends_in_one_sentence(run_rule, stages, supers):
    make(run_rule, stages, "alone")
    (stages / "alone" / "s00002.json").unlink()
    with pytest.raises(SystemExit, match=r"drapeline: .*s00002.json: no such file"):
        run_rule(
            "register_outfits",
            input={"outfits": stages / "alone", **supers},
            output=[stages / "new"],
        )
    assert not (stages / "new").exists()
