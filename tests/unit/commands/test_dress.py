"""Somebody dressed from the command line, with all that is written."""

import json
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import drapeline as library
from drapeline.bodies.model import free_body, load_body
from drapeline.commands.dress import outfit_type
from drapeline.dataset.animated_gltf import read_gltf
from drapeline.dataset.reader import Sample
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import load_obj, save_obj
from drapeline.outfits.user_garment import garment_type

ROOT = Path(__file__).parents[3]
JUMP, DRESS, SKIRT = (ROOT / "examples/data" / n for n in ("jump.bvh", "dress.obj", "skirt.obj"))
FAST = ("--frames", 3, "--edge-length", 0.05)


def test_a_dress_of_ones_own_moves_in_every_format(tmp_path, drapeline):
    mesh = load_obj(DRESS)
    lying = Rotation.from_euler("x", 90, degrees=True).apply(mesh.vertices)
    save_obj(tmp_path / "mine.obj", Mesh(lying.astype(np.float32), mesh.faces))
    outputs = [tmp_path / name for name in ("a.glb", "a.html", "a.usdc", "sample")]
    words = [word for path in outputs for word in ("-o", path)]
    garment = ("--garment", tmp_path / "mine.obj", "--fabric", "denim")
    _, status = drapeline("dress", JUMP, *FAST, *words, *garment)
    assert "it fits if turned by" in str(status)
    assert not any(path.exists() for path in outputs)
    _, status = drapeline("dress", JUMP, *FAST, *words, *garment, "--mend")
    assert status == 0, status
    with Sample(tmp_path / "sample") as sample:
        assert len(sample) == 3
        assert list(sample.garments) == ["Dress"]
        assert sample.fabrics == {"Dress": "denim"}
        assert len(sample.mesh("Dress").vertices) == len(mesh.vertices)
        body, cloth = read_gltf(tmp_path / "a.glb")
        assert (body.name, cloth.name, cloth.frame_count) == ("Body", "Dress", 3)
        moved = sample.vertices("Dress", 2, 3)[0]
        assert cloth.read(2, 3)[0][:, 1].max() == pytest.approx(moved[:, 2].max(), abs=1e-3)
    assert b"<canvas" in (tmp_path / "a.html").read_bytes()
    assert (tmp_path / "a.usdc").read_bytes()[:8] == b"PXR-USDC"
    out, status = drapeline("check", tmp_path / "a.glb", "--json", "-")
    assert status == 0
    assert json.loads(out[out.index("{") :])["Dress"]["inside_share_mean"] < 0.05


class Drawing:
    """A model that draws one mesh, and remembers what it was asked."""

    def __init__(self, mesh):
        self.mesh, self.asked = mesh, []

    def load(self, folder):
        self.folder = folder
        return self

    def sample(self, count, garment, **about):
        self.asked.append((count, garment, about))
        return [SimpleNamespace(garment=garment, mesh=self.mesh)]


@pytest.fixture
def drawing(monkeypatch):
    """Every trained model draws the example's dress, cut into triangles."""
    mesh = load_obj(DRESS)
    model = Drawing(Mesh(mesh.vertices, mesh.triangles))
    monkeypatch.setitem(vars(library), "load", model.load)
    monkeypatch.setitem(vars(library), "StaticModel", Drawing)
    return model


def test_a_garment_that_a_model_draws_is_what_moves(tmp_path, drapeline, drawing):
    words = ("--outfit", "dress", "--fabric", "denim", "--gender", "male", "--seed", 7)
    _, status = drapeline(
        "dress", JUMP, *FAST, *words, "--model", "results/mine", "-o", tmp_path / "sample"
    )
    assert status == 0, status
    assert drawing.folder == "results/mine"
    ((count, garment, about),) = drawing.asked
    assert (count, garment, about["gender"], about["seed"]) == (1, "Dress", "male", 7)
    assert not np.any(about["shape"])  # garments of one's own lie on the mean body
    with Sample(tmp_path / "sample") as sample:
        assert sample.fabrics == {"Dress": "denim"}
        mesh = sample.mesh("Dress")
        np.testing.assert_array_equal(mesh.faces, drawing.mesh.faces)
        assert len(mesh.vertices) == len(drawing.mesh.vertices)


def test_ones_own_garments_come_before_those_that_a_model_draws(
    tmp_path, monkeypatch, drapeline, drawing
):
    """What is drawn is worn with them, and by default the model is that of drapeline."""
    worn = {}

    def dress_clip(folder, motion, body, *, outfit_type, own, **others):
        worn.update({name: load_obj(garment.path) for name, garment in own.items()})
        raise InputError(f"nobody is dressed in {outfit_type}")

    monkeypatch.setattr("drapeline.commands.dress.dress_clip", dress_clip)
    words = ("--outfit", "skirt+tshirt", "--garment", f"skirt={SKIRT}", "--model")
    _, status = drapeline("dress", JUMP, *FAST, "-o", tmp_path / "a.glb", *words)
    assert "nobody is dressed in Tshirt+Skirt" in str(status)
    assert drawing.folder == "gcvae"
    assert [garment for _, garment, _ in drawing.asked] == ["Tshirt"]
    for name, mesh in {"Skirt": load_obj(SKIRT), "Tshirt": drawing.mesh}.items():
        np.testing.assert_array_equal(worn.pop(name).faces, mesh.faces)
    assert not worn


def test_a_model_that_there_is_not_is_one_sentence(tmp_path, drapeline):
    pytest.importorskip("torch")
    words = ("--model", tmp_path / "none", "-o", tmp_path / "a.glb")
    _, status = drapeline("dress", JUMP, *FAST, *words)
    assert re.match("drapeline: .*none: no such folder, expected that of a train", str(status))
    assert not list(tmp_path.iterdir())


def test_a_model_that_draws_no_garments_is_one_sentence(tmp_path, drapeline, toy_body):
    pytest.importorskip("torch")
    from toys.gallery import save_toy_model, training_codes

    save_toy_model(tmp_path / "skirt", toy_body, training_codes())
    words = ("--model", tmp_path / "skirt", "-o", tmp_path / "a.glb")
    _, status = drapeline("dress", JUMP, *FAST, *words)
    sentence = "skirt: a SmplicitModel, expected a model that draws garments at rest, such as gcv"
    assert re.match(f"drapeline: .*{sentence}", str(status)), status
    assert {path.name for path in tmp_path.iterdir()} == {"skirt"}


def test_models_without_torch_are_refused_with_what_brings_it(tmp_path):
    words = ["drapeline", "dress", str(JUMP), *map(str, FAST), "--model", "-o", "a.glb"]
    code = (
        "import sys\n"
        "class Without:\n"
        "    def find_spec(name, *others):\n"
        "        if name == 'torch': raise ModuleNotFoundError('no torch', name=name)\n"
        "sys.meta_path.insert(0, Without)\n"
        f"sys.argv = {words}\n"
        "from drapeline.__main__ import main\n"
        "main()\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 1
    assert "drapeline: drapeline.load needs torch, which is" in run.stderr.splitlines()[-1]
    assert run.stderr.endswith("pip install 'drapeline[torch]'\n")
    assert not list(tmp_path.iterdir())


def test_it_needs_no_torch_no_pipeline_and_no_blender():
    banned = ("torch", "snakemake", "bpy", "anny", "pandas", "matplotlib", "sklearn", "skimage")
    code = (
        "import sys\n"
        f"for name in {banned}: sys.modules[name] = None\n"
        "import drapeline.commands.dress, drapeline.commands.check\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env={"PYTHONPATH": str(ROOT / "src")})


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--outfit", "dres"], "--outfit dres: expected one of Tshirt+Trousers"),
        (["-o", "a.fbx"], "'.fbx' is unknown, expected .glb, .html"),
        (["--start", "900"], "--start 900: expected 0 to"),
        (["--frames", "0"], "--frames 0: expected at least 1"),
        (["--frames", "20", "-o", "a.webp"], "a.webp: a moving picture of 20 frames, expected 48"),
        (["--garment", "none.obj"], "none.obj"),
        (["--outfit", "dress", "--garment", f"skirt={SKIRT}"], "a Skirt, but --outfit is dress"),
        (["--bmi", "500"], "--bmi 500: expected 10 to 60"),
        (["--edge-length", "2"], "--edge-length 2: expected 0.005 to 0.06"),
    ],
)
def test_what_cannot_be_asked_for_is_one_sentence(drapeline, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    _, status = drapeline("dress", JUMP, *words)
    assert re.match("drapeline: .*" + re.escape(message), str(status)), status
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("wanted", "own", "expected"),
    [
        (None, [], "Tshirt+Trousers"),
        (None, ["Skirt"], "Tshirt+Skirt"),
        (None, ["Dress"], "Dress"),
        ("trousers+top", [], "Top+Trousers"),
        ("DRESS", ["Dress"], "Dress"),
    ],
)
def test_outfits_are_named_in_any_order_and_case(wanted, own, expected):
    assert outfit_type(wanted, own) == expected


def test_garments_that_nobody_wears_together_are_refused():
    with pytest.raises(InputError, match="nobody wears Dress and Skirt"):
        outfit_type(None, ["Dress", "Skirt"])


@pytest.mark.parametrize(("path", "kind"), [(DRESS, "Dress"), (SKIRT, "Skirt")])
def test_the_type_of_a_garment_is_found_out(path, kind):
    assert garment_type(path, load_body(free_body("female"))) == kind
