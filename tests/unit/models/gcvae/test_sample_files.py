import csv
import json
import struct

import numpy as np

from drapeline.frames import GENDERS
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import load_obj
from drapeline.models.gcvae.sample import (
    hang_samples,
    load_samples,
    sample_garments,
    save_samples,
)
from drapeline.outfits.worn import DrapedSheet
from toys.gcvae_files import requests


def test_saved_samples_can_be_opened(model, types, toy_body, tmp_path):
    bodies = dict.fromkeys(GENDERS, toy_body)
    sampled = sample_garments(model, types, requests(3), seed=0, settle=False)
    mesh = sampled[1].mesh
    hung = {sampled[1].name: Mesh(mesh.vertices - np.float32([0, 0, 0.1]), mesh.faces)}
    save_samples(tmp_path / "out", sampled, bodies, model.body_template.faces["body"], hung)
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {f"0000{i}.{e}" for i in (1, 2, 3) for e in ("obj", "glb")} | {
        "samples.tsv",
        "codes.npz",
        "hung",
    }
    with open(tmp_path / "out/samples.tsv") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    for sample, row in zip(sampled, rows, strict=True):
        mesh = load_obj(tmp_path / "out" / f"{sample.name}.obj")
        np.testing.assert_allclose(mesh.vertices, sample.mesh.vertices, atol=1e-6)
        assert int(row["vertices"]) == len(mesh.vertices)
    data = (tmp_path / "out/00001.glb").read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    meshes = json.loads(data[20 : 20 + length])["meshes"]
    assert [m["name"] for m in meshes] == ["Body", sampled[0].garment]
    loaded = load_samples(tmp_path / "out")
    for sample, saved in zip(sampled, loaded, strict=True):
        assert (saved.name, saved.garment) == (sample.name, sample.garment)
        assert saved.asked == (sample.request.garment != "prior")
        np.testing.assert_array_equal(saved.cvar, sample.request.cvar)
        np.testing.assert_allclose(saved.mesh.vertices, sample.mesh.vertices, atol=1e-6)
        hanging = hung.get(sample.name, sample.mesh)
        np.testing.assert_allclose(saved.hung.vertices, hanging.vertices, atol=1e-6)


def test_garments_that_fall_off_are_shown_as_they_were_decoded(model, types, toy_body):
    sampled = sample_garments(model, types, requests(3), seed=0, settle=False)
    sinks = dict(zip((one.name for one in sampled), (0.02, 0.3, None), strict=True))
    asked = iter(sinks.values())

    def draper(sheets, body, gender, shape, pose, trans, up):
        sink = next(asked)
        return {
            name: DrapedSheet(mesh, Mesh(mesh.vertices - np.float32([0, 0, sink]), mesh.faces))
            for name, mesh in sheets.items()
            if sink is not None
        }

    hung = hang_samples(sampled, dict.fromkeys(GENDERS, toy_body), draper)
    assert list(hung) == [sampled[0].name]
