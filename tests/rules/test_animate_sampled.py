"""The rule that sets sampled outfits in motion, on a toy body."""

import csv
import json
import re
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

import drapeline
from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.model import save_body
from drapeline.dataset.moving_meshes import read_moving_meshes
from drapeline.dataset.reader import Sample
from drapeline.dataset.scene_part import to_y_up
from drapeline.errors import InputError
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import GENDERS, REST_POSE
from drapeline.generation.settings import BodySettings
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.moving_surface import MovingSheet
from drapeline.models.gcvae.animate import draw_outfit
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.movers import WornSheet, load_mover, move_by_model
from drapeline.models.gcvae.ppca import DynamicPpca, save_fit
from drapeline.models.gcvae.sample import load_types
from drapeline.models.gcvae.settings import DvaeSettings, PpcaSettings, WrinkleMlpSettings
from drapeline.models.gcvae.vae import DynamicVae
from drapeline.models.gcvae.wrinkle_mlp import WrinkleMlp
from drapeline.models.training.checkpoints import write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.models.training.settings import override_settings
from drapeline.motions.motion import Motion, save_motion
from drapeline.simulation.settings import SimulationSettings
from toys.gcvae_files import save_model, shaken
from toys.gcvae_stages import SETTINGS, train_static, write_stages

FRAMES, OUTFITS, MOVERS = 4, ("Tshirt+Trousers", "Dress"), ("mlp", "ppca", "solver")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("animated")


@pytest.fixture(scope="module")
def given(run_rule, folder, toy_body):
    """What the rule reads: bodies, a motion, a fitted model, and one that knows no change."""
    static = train_static(run_rule, write_stages(folder, toy_body), folder, "static_ppca")
    template = load_codec(static / BEST).body_template
    conditions = np.ones(13 + 4 * 72 + 6, dtype=np.float32)
    still = replace(
        template,
        offset_mean=0 * template.offset_mean,
        cvar_mean=0 * conditions,
        cvar_std=conditions,
    )
    save_fit(folder / "ppca", DynamicPpca(PpcaSettings(latent=6), still))
    known = np.ones(13 + 2 * 72 + 6, dtype=np.float32)
    still = replace(still, cvar_mean=0 * known, cvar_std=known)
    save_model(folder / "mlp", WrinkleMlp(WrinkleMlpSettings(latent=6, width=4), still))
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
        "mlp": folder / "mlp",
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
        assert (body["name"], len(body["at"])) == ("Body", len(MOVERS))
        told = {f"{garment} ({mover})" for garment in kind.split("+") for mover in MOVERS}
        assert {part["name"] for part in garments} == told
        assert header["frames"] == FRAMES


def test_sampled_garments_are_compared_with_real_ones(run_rule, folder, given, tmp_path):
    hanging = {
        "solver": "drapeline.xpbd.solver",
        "hanging": {"edge_length_m": 0.04, "simulation": {}},
        "hang_frames": 0,
    }
    bodies = {gender: given[gender] for gender in GENDERS}
    conditions = {"count": 4, "garments": ["Tshirt", "Dress"], "female_share": 1, "shape": None}
    conditions |= {"shape_range": 1.0, "tightness": None, "tightness_range": [-1.5, 0.5]}
    run_rule(
        "drapeline.models.gcvae.sample:sample_garments_of_codes",
        input={"model": given["model"], **bodies},
        output=[tmp_path / "sampled"],
        params={"seed": 0, "conditions": conditions, "settle": True, **hanging},
    )
    run_rule(
        "drapeline.models.gcvae.likeness:compare_with_real",
        input={
            "samples": tmp_path / "sampled",
            "model": given["model"],
            "data": folder / "data",
            "outfits": [],
            **bodies,
        },
        output={"page": tmp_path / "page.html", "table": tmp_path / "table.tsv"},
        params={"seed": 0, "split": "test", **hanging},
    )
    with open(tmp_path / "table.tsv") as stream:
        rows = {row["set"]: row for row in csv.DictReader(stream, delimiter="\t")}
    assert [row["garments"] for row in rows.values()] == ["4", "4", "1", "0"]
    assert 0 <= float(rows["sampled, hung"]["covered_share"]) <= 1
    assert float(rows["real, hung"]["nearest_mm"]) > 0
    assert float(rows["real, as registered"]["folds_2cm_mm"]) > 0
    assert "garments covered" in (tmp_path / "page.html").read_text()


@pytest.fixture(scope="module")
def outfit(given):
    """A model, and sampled garments of one wearer."""
    model = drapeline.load(given["static"])
    wearer = {"gender": "female", "shape": np.zeros(10), "tightness": [0.0, 0.0]}
    return model, [*model.sample(1, "Tshirt", **wearer), *model.sample(1, "Trousers", **wearer)]


@pytest.fixture(scope="module")
def still(given):
    return drapeline.import_motion(given["motion"])


@pytest.fixture(scope="module")
def moved(outfit, still, given, toy_body):
    model, garments = outfit
    return model.animate(
        garments, still, toy_body, mover=given["ppca"], settle=False, hang_frames=2
    )


def test_in_a_still_pose_no_change_is_what_hangs(given, toy_body):
    static, types = load_codec(given["static"] / BEST), load_types(given["static"])
    plan = SamplePlan("drawn1", "female", "Tshirt+Trousers")
    none = np.zeros(2)
    drawn = draw_outfit(static, types, plan, np.zeros(10), 0, none, none, settle=True)
    assert list(drawn) == ["Trousers", "Tshirt"]  # from the innermost to the outermost
    put_on = {name: Mesh(one.mesh.vertices + 0.5, one.mesh.faces) for name, one in drawn.items()}
    worn = {
        name: WornSheet(put_on[name], one.mesh, one.offsets, one.mask, one.request.cvar)
        for name, one in drawn.items()
    }
    poses = np.tile(REST_POSE, (FRAMES, 1))
    record = make_body_sequence(
        toy_body, np.zeros(10), poses, np.zeros((FRAMES, 3)), gender="female"
    )
    model = load_mover(given["ppca"])
    moved = move_by_model(model, static, worn, toy_body, record, settle=False)
    for name, sheet in moved.items():
        assert sheet.rest is put_on[name]  # and not what hangs, which is stretched
        assert len(sheet.frames) == FRAMES
        for frame in sheet.frames:
            np.testing.assert_allclose(frame.vertices, drawn[name].mesh.vertices, atol=1e-5)
    bent = replace(record, poses=poses + 0.2)
    again = move_by_model(model, static, worn, toy_body, bent, settle=False)
    assert np.abs(again["Tshirt"].frames[0].vertices - drawn["Tshirt"].mesh.vertices).max() > 0.05


@pytest.fixture(scope="module")
def networks(given, folder):
    """networks("unposed") -> folder of an untrained network of garments in motion."""

    def save(version):
        template = load_codec(given["ppca"] / BEST).body_template
        settings = override_settings(SETTINGS, {"training": {"version": version, "mask": False}})
        model = shaken(DynamicVae(DvaeSettings(**settings), template))
        (folder / version).mkdir()
        weights = model.state_dict()
        write_checkpoint(folder / version / BEST, weights, model.checkpoint_metadata())
        return folder / version

    return save


def test_a_network_moves_garments_by_what_it_decodes_and_a_posed_one_is_refused(
    given, networks, outfit, still, toy_body
):
    model, garments = outfit
    moved, again = (
        model.animate(garments, still, toy_body, mover=mover, settle=False, hang_frames=0)
        for mover in (networks("unposed"), given["ppca"])
    )
    for name, sheet in moved.garments.items():
        # The other one knows no change.
        change = sheet.frames[1].vertices - again.garments[name].frames[1].vertices
        assert np.isfinite(change).all()
        assert 1e-4 < np.abs(change).max() < 1
    with pytest.raises(InputError, match="its offsets are posed, expected unposed ones"):
        model.animate(garments, still, mover=networks("posed"))


@pytest.mark.parametrize("mover", ["ppca", "solver"])
def test_layers_keep_their_order(outfit, still, given, toy_body, mover):
    model, garments = outfit
    worn = model.animate(garments, still, toy_body, mover=given.get(mover, mover))
    for inner, outer in zip(
        *(worn.garments[k].frames for k in ("Trousers", "Tshirt")), strict=True
    ):
        beneath = MovingSheet(inner.vertices, inner.faces).beneath(outer.vertices, 0.03)
        assert beneath.mean() < 0.05


def test_each_garment_is_moved_by_its_own_tightness_whatever_stands_first(
    outfit, still, given, toy_body
):
    model, garments = outfit
    first, second = (
        one._replace(tightness=np.full(2, tightness))
        for one, tightness in zip(garments, (-1.0, 0.5), strict=True)
    )
    one, other = (
        model.animate(order, still, toy_body, mover=given["ppca"], settle=False, hang_frames=2)
        for order in ([first, second], [second, first])
    )
    for name, sheet in one.garments.items():
        frame, again = sheet.frames[-1].vertices, other.garments[name].frames[-1].vertices
        np.testing.assert_allclose(frame, again, atol=1e-6)


def test_what_was_moved_is_written_and_read_back(moved, tmp_path):
    for name in ("walk.glb", "walk.html", "sample"):
        drapeline.save_outfit(tmp_path / name, moved)
    drapeline.save_outfit(tmp_path / "objs", moved, folder_format="obj")
    assert (tmp_path / "walk.html").stat().st_size > 10_000
    with drapeline.Sample(tmp_path / "sample") as sample:
        assert sample.garments == ("Trousers", "Tshirt")
        for name, sheet in moved.garments.items():
            expected = np.stack([one.vertices for one in sheet.frames])
            np.testing.assert_allclose(sample.vertices(name, frame="root"), expected, atol=1e-6)
        expected = np.stack([one.vertices for one in moved.body]) + moved.trans[:, None]
        np.testing.assert_allclose(sample.body_vertices(), expected, atol=2e-3)
    with ExitStack() as opened:
        for file in ("walk.glb", "objs"):
            names = {part.name for part in read_moving_meshes(tmp_path / file, opened)}
            assert names == {"Body", "Tshirt", "Trousers"}
    with pytest.raises(InputError, match=r"'\.vox' is unknown, expected \.glb"):
        drapeline.save_outfit(tmp_path / "walk.vox", moved)
    with pytest.raises(InputError, match="folder_format: 'fbx', expected one of cloth3d"):
        drapeline.save_outfit(tmp_path / "walk", moved, folder_format="fbx")


def test_movers_that_cannot_be_used_are_refused_before_anything_moves(outfit, still, given):
    model, garments = outfit
    with pytest.raises(InputError, match="missing: no trained model, expected a folder such as"):
        model.animate(garments, still, mover=given["static"].parent / "missing")
    with pytest.raises(InputError, match="of garments at rest, expected one of garments in motion"):
        model.animate(garments, still, mover=given["static"])


def test_garments_that_nobody_wears_together_are_refused(outfit, still):
    model, (shirt, trousers) = outfit
    empty = shirt._replace(mesh=drapeline.Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)))
    for garments, sentence in (
        ([], "garments: none, expected one or more"),
        ([shirt, shirt], "garments: Tshirt, Tshirt, expected each type once"),
        ([shirt, trousers._replace(gender="male")], "the Trousers is made for another body"),
        ([empty], "the Tshirt has no faces, expected cloth"),
    ):
        with pytest.raises(InputError, match=sentence):
            model.animate(garments, still)
