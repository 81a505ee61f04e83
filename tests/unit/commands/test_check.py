"""Clothes in motion from files of all kinds, measured."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

from drapeline.dataset.gltf import write_glb
from drapeline.dataset.mesh_files import write_caches, write_obj_sequence
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from toys.tiny_sample import write_tiny_sample

FRAMES = 5


@pytest.fixture
def numbers(drapeline, tmp_path):
    def run(*words):
        out, status = drapeline("check", *words, "--json", tmp_path / "numbers.json")
        assert status == 0, status
        return out, json.loads((tmp_path / "numbers.json").read_text())

    return run


@pytest.fixture
def tiny(tmp_path, toy_body):
    return write_tiny_sample(tmp_path / "tiny", toy_body, frames=FRAMES)


@pytest.fixture
def parts(tiny):
    return scene_parts(Sample(tiny.folder))


def test_all_formats_of_a_sample_measure_alike(tmp_path, tiny, parts, numbers):
    table, expected = numbers(tiny.folder)
    assert set(expected) == {"Tshirt", "Skirt"}
    assert "on Body, 5 frames at 30 per second" in table
    write_glb(tmp_path / "a.glb", parts)
    for name in ("obj", "pc2"):
        (tmp_path / name).mkdir()
    write_obj_sequence(tmp_path / "obj", parts)
    write_caches(tmp_path / "pc2", parts, ".pc2")
    for path in ("a.glb", "obj", "pc2"):
        _, found = numbers(tmp_path / path)
        assert set(found) == set(expected)
        for garment, measures in expected.items():
            assert set(found[garment]) == set(measures)
            for name in ("inside_share_mean", "slip_m", "acceleration_m_s2"):
                assert found[garment][name] == pytest.approx(measures[name], abs=0.02), name


def test_a_garment_without_a_body_has_no_contact(tmp_path, parts, numbers):
    write_obj_sequence(tmp_path, [part for part in parts if part.name == "Skirt"])
    table, found = numbers(tmp_path / "Skirt")
    assert "without a body" in table
    assert set(found) == {"Skirt"}
    assert not {"inside_share_mean", "slip_m", "depth_m"} & set(found["Skirt"])
    assert {"stretch_high", "self_crossings_max"} <= set(found["Skirt"])


def test_arrays_are_measured_exactly(tmp_path, numbers):
    """A sheet that sinks into a box, lengthens and speeds up; frame rate and body of one's own."""
    grid = np.stack([*np.meshgrid([0, 0.1, 0.2], [0, 0.1, 0.2], indexing="ij")], -1).reshape(-1, 2)
    sheet = np.column_stack([grid, np.full(9, 0.3)])
    corner = np.array([0, 1, 3, 4])
    faces = np.array([[k, k + 1, k + 4, k + 3] for k in corner])
    frames = np.stack([sheet + [0, 0, -0.01 * k**2] for k in range(4)])
    box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 0.27)], dtype=float)
    sides = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
        + [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )
    path = tmp_path / "cape.npz"
    np.savez(path, vertices=frames, faces=faces, body_vertices=[box] * 4, body_faces=sides)
    _, found = numbers(path, "--fps", 10)
    cape = found["cape"]
    assert cape["inside_share_mean"] == pytest.approx(0.5)  # all of it in two of four frames
    assert cape["acceleration_m_s2"] == pytest.approx(0.02 * 10**2, rel=1e-4)
    assert cape["stretch_high"] == pytest.approx(1)
    np.savez(path, vertices=frames, faces=faces)
    np.savez(tmp_path / "box.npz", vertices=[box] * 4, faces=sides)
    _, beside = numbers(path, "--body", tmp_path / "box.npz", "--fps", 10)
    assert beside["cape"] == cape
    _, named = numbers(path, tmp_path / "box.npz", "--body", "BOX", "--fps", 10)
    assert named["cape"] == cape


def save(folder, name, frames=3, size=1.0):
    points = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) * size
    np.savez(folder / f"{name}.npz", vertices=[points] * frames, faces=[[0, 1, 2]])
    return folder / f"{name}.npz"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["missing.glb"], "missing.glb: no such file, expected a sample's folder"),
        (["a.txt"], r"a.txt: '.txt' is unknown"),
        (["."], "has neither OBJ files nor caches"),
        (["body.npz"], "has no garment beside Body"),
        (["a.npz", "long.npz"], r"different numbers of frames \(a 3, long 4\)"),
        (["huge.npz"], "the largest mesh is 100 m long, expected metres"),
        (["a.npz", "--body", "b"], "--body b: no file, expected one or one of a"),
        (["a.npz", "--fps", "0"], "--fps 0: expected more than 0"),
        (["lone.pc2"], "lacks lone.obj beside it"),
        (["a.npz", "a.npz"], "two meshes are called a, expected a name for each"),
        (["a.npz", "body.npz", "body.npz"], "--body: 2 meshes are called Body"),
    ],
)
def test_what_cannot_be_measured_is_one_sentence(tmp_path, monkeypatch, drapeline, words, message):
    monkeypatch.chdir(tmp_path)
    for name, more in (("a", {}), ("long", {"frames": 4}), ("huge", {"size": 100}), ("body", {})):
        save(tmp_path, name, **more)
    (tmp_path / "a.txt").touch()
    # Not among the caches of the folder itself, which a folder is searched for first.
    if "lone.pc2" in words:
        (tmp_path / "lone.pc2").touch()
    _, status = drapeline("check", *words)
    assert str(status).startswith("drapeline: ")
    assert re.search(message, str(status)), status


@pytest.mark.parametrize(
    ("command", "lacking", "extra"),
    [("check", "warp", "dress"), ("check-config", "jsonschema", "pipeline")],
)
def test_what_is_not_installed_is_named_with_its_extra(command, lacking, extra):
    code = f"import sys; sys.modules['{lacking}'] = None; sys.argv[1:] = ['{command}', 'a']\n"
    code += "from drapeline.__main__ import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert f"needs {lacking}" in done.stderr
    assert f"pip install 'drapeline[{extra}]'" in done.stderr


def test_the_command_alone_lists_what_it_can_do(drapeline):
    out, status = drapeline()
    assert status == 0
    assert all(word in out for word in ("dress", "check", "check-config"))
    assert "snakemake dataset --cores all" in " ".join(out.split())
