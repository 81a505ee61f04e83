"""Somebody dressed from the command line, with all that is written."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

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
