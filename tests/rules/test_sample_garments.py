"""The rules that sample garments and draw them."""

import csv

import pytest

from drapeline.bodies.model import save_body
from drapeline.frames import GENDERS
from drapeline.geometry.obj import load_obj
from drapeline.simulation.settings import SimulationSettings
from toys.gcvae_files import TypedGarments, save_model


@pytest.fixture
def sampled(run_rule, tmp_path, toy_body):
    garments = TypedGarments()
    save_model(tmp_path / "model", garments=garments)
    for gender in GENDERS:
        save_body(tmp_path / f"{gender}.npz", toy_body)
    bodies = {gender: tmp_path / f"{gender}.npz" for gender in GENDERS}
    run_rule(
        "drapeline.models.gcvae.sample:sample_garments_of_codes",
        input={"model": tmp_path / "model", **bodies},
        output=[tmp_path / "samples"],
        params={
            "seed": 0,
            "conditions": {
                "count": 5,
                "garments": ["prior", "Dress"],
                "female_share": 1,
                "shape": None,
                "shape_range": 2.0,
                "tightness": [0.0, 0.0],
                "tightness_range": [-1.5, 0.5],
            },
            "settle": True,
            "hang_frames": 2,
            "solver": "drapeline.xpbd.solver",
            "hanging": {
                "edge_length_m": 0.04,
                "simulation": SimulationSettings(steps_min=6, steps_max=6).plain(),
            },
        },
    )
    return tmp_path / "samples", bodies


def test_samples_are_files_with_a_table(sampled):
    folder, _ = sampled
    with open(folder / "samples.tsv") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    assert [row["asked"] for row in rows] == ["prior", "Dress", "prior", "Dress", "prior"]
    assert {row["gender"] for row in rows} == {"female"}
    for row in rows:
        assert len(load_obj(folder / f"{row['name']}.obj").vertices) == int(row["vertices"])
        assert (folder / f"{row['name']}.glb").read_bytes()[:4] == b"glTF"
        assert 0 <= float(row["inside_1cm_share"]) <= float(row["inside_share"]) <= 1


def test_samples_are_drawn(run_rule, sampled, tmp_path):
    folder, bodies = sampled
    run_rule(
        "drapeline.models.gcvae.figures:plot_sampled",
        input={"samples": folder, **bodies},
        output=[tmp_path / "samples.png"],
        params={"shown": 3, "rays": 0.02},
    )
    assert (tmp_path / "samples.png").stat().st_size > 1000
