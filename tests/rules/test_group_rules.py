"""The rules that samples in motion go through, from the clip to what models read."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from drapeline.bodies.model import save_body
from drapeline.dataset.point_clouds import load_clouds
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_meta, solver_name
from drapeline.dataset.segmented_scans import load_scans
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.outfits.garment_types import LABELS
from drapeline.outfits.templates import build_templates
from drapeline.simulation.settings import SimulationSettings
from toys.bounds import NO_BOUNDS

CLIPS = Path(__file__).parents[2] / "workflow/resources/motions"
PLANS = [
    SamplePlan("L00001", "female", "Tshirt+Skirt", "train", "walk", 0, 7, 16, 1.1),
    SamplePlan("L00002", "male", "Top+Trousers", "test", "walk", 1, 3, 10, 0.9, True),
]


@pytest.fixture(scope="module")
def shard(tmp_path_factory, run_rule, baked_bodies):
    """The folder of a shard that the rules' own scripts have made."""
    folder = tmp_path_factory.mktemp("group")
    bodies, forms = {}, {}
    for gender, body in baked_bodies.items():
        bodies[gender] = forms[f"{gender}_body"] = folder / f"{gender}_body.npz"
        forms[f"{gender}_templates"] = folder / f"{gender}_templates.npz"
        save_body(bodies[gender], body)
        build_templates(body).save(forms[f"{gender}_templates"])
    run_rule(
        "import_motion",
        input={"motion": CLIPS / "walk.npz"},
        output=[folder / "walk.npz"],
        params={"motion": {"frames": 40, "lock_feet": True, "sequence": "walk"}, "sums": {}},
    )
    common = {"seed": 5, "plans": [asdict(plan) for plan in PLANS]}
    run_rule(
        "animate_bodies",
        input={**bodies, "motions": [folder / "walk.npz"]},
        output=[folder / "bodies"],
        params={
            **common,
            "settings": {
                "shape_range": 1.0,
                "bmi_range": None,
                "shape_draws": 2,
                "segment_gap_m": 0.004,
            },
        },
    )
    run_rule(
        "make_outfits",
        input={**forms, "bodies": folder / "bodies"},
        output=[folder / "outfits"],
        params={
            **common,
            "bodies": {},
            "settings": {
                "edge_length_m": 0.04,
                "vertices_min": 0,
                "tightness_range": [-1.0, 0.0],
                "elastic_probability": 0.5,
            },
            "own_garments": {"female": {}, "male": {}},
            "hanging": {},
        },
    )
    made = {**bodies, "bodies": folder / "bodies", "outfits": folder / "outfits"}
    solver = {"solver": "drapeline.xpbd.solver", "accelerator": "cpu"}
    settings = SimulationSettings(steps_min=6, steps_max=6, attempts=1).plain()
    run_rule(
        "simulate_outfits",
        input=made,
        output=[folder / "simulation"],
        params={"samples": [plan.sample for plan in PLANS], "settings": settings, **solver},
        threads=1,
    )
    run_rule(
        "write_samples",
        input={**made, "simulations": folder / "simulation"},
        output=[folder / "samples"],
        params={
            "seed": 5,
            "splits": {plan.sample: plan.split for plan in PLANS},
            "settings": settings,
            # Whatever a processor makes of so short a motion is taken.
            "bounds": NO_BOUNDS.plain(),
            **solver,
        },
        threads=1,
    )
    return folder / "samples"


def test_samples_are_cloth3d_folders_that_say_how_they_were_made(shard):
    assert [path.name for path in sorted(shard.iterdir())] == ["L00001", "L00002"]
    for plan in PLANS:
        meta = read_meta(shard / plan.sample)
        assert meta["status"] == "accepted"
        assert solver_name(meta) == "xpbd"
        assert meta["split"] == plan.split
        motion = meta["motion"]
        assert motion["sequence"] == plan.sub_sequence
        assert (motion["speed"], motion["mirrored"]) == (plan.speed, plan.mirrored)
        assert motion["start_frame"] == plan.start
        with Sample(shard / plan.sample) as sample:
            assert sample.frame_count == plan.frames
            assert {*sample.garments} == {*plan.outfit_type.split("+")}
            assert sample.gender == plan.gender
            for garment in sample.garments:
                assert np.isfinite(sample.vertices(garment)).all()


def test_bodies_and_outfits_are_their_own(shard):
    shapes = []
    for plan in PLANS:
        with Sample(shard / plan.sample) as sample:
            shapes.append(sample.info.shape)
    assert np.abs(shapes[0] - shapes[1]).max() > 0.1


def test_clouds_are_of_all_samples_whatever_is_worn_in_them(shard, run_rule, tmp_path):
    run_rule(
        "sample_clouds",
        input=[shard],
        output=[tmp_path / "clouds"],
        params={"settings": {"points": 64, "protocol": "surface", "seed": 0}},
    )
    for plan in PLANS:
        cloud = load_clouds(tmp_path / "clouds" / plan.sample)
        assert cloud.points.shape == (plan.frames, 64, 3)
        worn = {LABELS[label] for label in np.unique(cloud.labels)}
        assert worn == {"Body", *plan.outfit_type.split("+")}


def test_some_of_a_shards_samples_are_scanned(shard, run_rule, tmp_path, baked_bodies):
    for gender, body in baked_bodies.items():
        save_body(tmp_path / f"{gender}.npz", body)
    run_rule(
        "scan_samples",
        input={
            "samples": shard,
            **{gender: tmp_path / f"{gender}.npz" for gender in baked_bodies},
        },
        output=[tmp_path / "scans.npz"],
        params={
            "samples": ["L00002"],
            "scans": {"frames": 1, "points": 800},
            "body": {"steps": 1, "joint_steps": 1, "points": 200},
            "seed": 0,
        },
    )
    ((scan, _),) = load_scans(tmp_path / "scans.npz")
    assert scan.name.startswith("L00002_")
    assert {*scan.garments} == {"Top", "Trousers"}


def test_garments_are_registered_by_sample(shard, run_rule, tmp_path, baked_bodies):
    from drapeline.registration.to_body.super_body import build_super_body
    from drapeline.registration.to_body.topology import build_topology, save_topology

    refined = build_super_body(baked_bodies, 0)
    save_topology(tmp_path / "topology.npz", build_topology(refined))
    for gender, body in refined.bodies.items():
        save_body(tmp_path / f"{gender}.npz", body)
    run_rule(
        "register_samples",
        input={
            "samples": shard,
            "topology": tmp_path / "topology.npz",
            **{gender: tmp_path / f"{gender}.npz" for gender in refined.bodies},
        },
        output=[tmp_path / "registered"],
    )
    for plan in PLANS:
        files = {path.stem for path in (tmp_path / "registered" / plan.sample).glob("*.npz")}
        assert files == set(plan.outfit_type.split("+"))


def test_a_template_is_fitted_to_all_garments_of_its_type_in_a_shard(
    shard, run_rule, tmp_path, baked_bodies
):
    from drapeline.registration.to_template.garment_template import make_template
    from drapeline.registration.to_template.remesh import load_tables

    forms = {gender: build_templates(body) for gender, body in baked_bodies.items()}
    for garment, sample in (("Skirt", "L00001"), ("Top", "L00002")):
        make_template(garment, forms, baked_bodies, 0.06).save(tmp_path / f"{garment}.npz")
        run_rule(
            "fit_templates",
            input={"shard": shard, "template": tmp_path / f"{garment}.npz"},
            output=[tmp_path / "fits" / garment],
            params={"simulated": True, "settings": {"iterations": 1}},
            wildcards={"garment": garment},
        )
        assert list(load_tables([tmp_path / "fits" / garment])) == [sample]
