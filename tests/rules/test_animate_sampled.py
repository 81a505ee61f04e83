"""The rule that sets sampled outfits in motion, on a toy body."""

import csv
import json
import re
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from drapeline.bodies.model import save_body
from drapeline.dataset.moving_meshes import read_moving_meshes
from drapeline.dataset.reader import Sample
from drapeline.dataset.scene_part import to_y_up
from drapeline.frames import GENDERS, REST_POSE
from drapeline.generation.settings import BodySettings
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.ppca import DynamicPpca, save_fit
from drapeline.models.gcvae.settings import PpcaSettings
from drapeline.motions.motion import Motion, save_motion
from drapeline.simulation.settings import SimulationSettings
from toys.gcvae_stages import train_static, write_stages

FRAMES, OUTFITS, MOVERS = 4, ("Tshirt+Trousers", "Dress"), ("ppca", "solver")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("animated")


@pytest.fixture(scope="module")
def given(run_rule, folder, toy_body):
    """What the rule reads: bodies, a motion, a fitted model, and one that knows no change."""
    static = train_static(run_rule, write_stages(folder, toy_body), folder, "static_ppca")
    template = load_codec(static / "best.safetensors").body_template
    conditions = np.ones(13 + 4 * 72 + 6, dtype=np.float32)
    still = replace(
        template,
        offset_mean=0 * template.offset_mean,
        cvar_mean=0 * conditions,
        cvar_std=conditions,
    )
    save_fit(folder / "ppca", DynamicPpca(PpcaSettings(latent=6), still))
    for gender in GENDERS:
        save_body(folder / f"whole_{gender}.npz", toy_body)
    poses = np.tile(REST_POSE, (FRAMES, 1))
    save_motion(
        folder / "clip.npz", Motion(poses, np.zeros((FRAMES, 3)), 30.0, "", "", "", "stand")
    )
    return {
        **{gender: folder / f"whole_{gender}.npz" for gender in GENDERS},
        "model": static,
        "static": static,
        "motion": folder / "clip.npz",
        "ppca": folder / "ppca",
    }


@pytest.fixture(scope="module")
def animated(run_rule, folder, given):
    plan = {"gender": "female", "sequence": "stand", "start": 0, "stop": FRAMES}
    run_rule(
        "drapeline.models.gcvae.animate:animate_outfits",
        input=given,
        output=[folder / "animated"],
        params={
            "seed": 0,
            "plans": [
                {**plan, "sample": f"drawn{k}", "outfit_type": kind}
                for k, kind in enumerate(OUTFITS)
            ],
            "bodies": BodySettings(bmi_range=None, shape_range=0.0).plain(),
            "tightness": [0.0, 0.0],
            "tightness_range": [-1.5, 0.5],
            "movers": list(MOVERS),
            "settle": True,
            "hang_frames": 2,
            "solver": "drapeline.xpbd.solver",
            "hanging": {
                "edge_length_m": 0.04,
                "simulation": SimulationSettings(steps_min=6, steps_max=6).plain(),
            },
        },
    )
    return folder / "animated"


def test_every_mover_moves_the_same_garments(animated):
    with open(animated / "outfits.tsv") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    told = [(row["name"], row["mover"], row["outfit"]) for row in rows]
    assert told == [
        (f"drawn{k}", mover, kind) for k, kind in enumerate(OUTFITS) for mover in MOVERS
    ]
    for row in rows:
        folder = animated / f"{row['name']}_{row['mover']}"
        with Sample(folder) as sample, Sample(animated / f"{row['name']}_ppca") as other:
            assert set(sample.garments) == set(row["outfit"].split("+"))
            assert len(sample) == FRAMES
            for name in sample.garments:
                assert sample.mesh(name).faces.tolist() == other.mesh(name).faces.tolist()
                assert np.isfinite(sample.vertices(name)).all()


def test_files_are_read_back(animated):
    with ExitStack() as opened, Sample(animated / "drawn0_solver") as sample:
        parts = read_moving_meshes(animated / "drawn0_solver.glb", opened)
        assert {part.name for part in parts} == {"Body", "Tshirt", "Trousers"}
        for part in parts:
            if part.name != "Body":
                for points, cloth in zip(part.frames(), sample.vertices(part.name), strict=True):
                    assert KDTree(points).query(to_y_up(cloth))[0].max() < 1e-3


def test_a_page_has_all_movers_side_by_side(run_rule, animated, tmp_path):
    pages = {f"drawn{k}": tmp_path / f"{k}.html" for k in range(2)}
    run_rule(
        "drapeline.models.gcvae.animate:show_animated",
        input={"animated": animated},
        output=pages,
        params={"names": list(pages)},
    )
    for name, kind in zip(pages, OUTFITS, strict=True):
        text = pages[name].read_text()
        header = json.loads(re.search(r'id="header">(.*?)</script>', text, re.DOTALL)[1])
        assert [label["text"] for label in header["labels"]] == list(MOVERS)
        body, *garments = header["parts"]
        assert (body["name"], len(body["at"])) == ("Body", 2)
        told = {f"{garment} ({mover})" for garment in kind.split("+") for mover in MOVERS}
        assert {part["name"] for part in garments} == told
        assert header["frames"] == FRAMES
