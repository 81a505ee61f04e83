"""The rule that registers simulated samples."""

import json

import numpy as np
import pytest

from drapeline.bodies.model import load_body, save_body
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import SAMPLE_MANIFEST
from drapeline.manifest import write_manifest
from drapeline.registration.to_body.dynamic_offsets import (
    dynamic_offsets,
    load_sample_garment,
    points_from_offsets,
)
from toys.tiny_sample import write_tiny_sample


@pytest.fixture(scope="module")
def supers(tmp_path_factory, toy_body):
    from drapeline.registration.to_body.super_body import build_super_body
    from drapeline.registration.to_body.topology import build_topology, save_topology

    folder = tmp_path_factory.mktemp("super")
    refined = build_super_body({"female": toy_body, "male": toy_body}, 3000)
    save_topology(folder / "topology.npz", build_topology(refined))
    for gender, body in refined.bodies.items():
        save_body(folder / f"{gender}.npz", body)
    save_body(folder / "body.npz", toy_body)
    return {name: folder / f"{name}.npz" for name in ("female", "male", "topology")}


def register(run_rule, tiny, supers, output):
    run_rule(
        "register_samples",
        input={"samples": tiny.folder.parent, **supers},
        output=[output],
    )


def test_a_sample_is_registered_and_its_frames_come_back(run_rule, supers, tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body)
    output = tmp_path / "registration"
    register(run_rule, tiny, supers, output)
    assert {p.name for p in (output / "00001").iterdir()} == {
        "Tshirt.npz",
        "Skirt.npz",
        "metrics.tsv",
        "status.json",
    }
    assert json.loads((output / "00001" / "status.json").read_text())["status"] == "accepted"
    body = load_body(supers["female"])
    with Sample(tiny.folder) as sequence:
        for name in sequence.garments:
            garment = load_sample_garment(output / "00001" / f"{name}.npz")
            assert garment.mask.sum() == len(garment.vertex) > 100
            assert garment.corner.max() < len(sequence.mesh(name).vertices)
            np.testing.assert_allclose(garment.weights.sum(1), 1, atol=1e-5)
            cloth = sequence.vertices(name, frame="root")
            for version in ("posed", "unposed"):
                arguments = (body, sequence.info.shape, sequence.info.poses, version)
                offsets = dynamic_offsets(garment, cloth, *arguments)
                back = points_from_offsets(garment, offsets, *arguments)
                np.testing.assert_allclose(back, garment.points(cloth), atol=1e-5)


def test_skirts_follow_both_legs_everywhere(run_rule, supers, tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body)
    register(run_rule, tiny, supers, tmp_path / "registration")
    skirt = load_sample_garment(tmp_path / "registration" / "00001" / "Skirt.npz")
    legs = skirt.weights[:, [1, 4]].sum(1), skirt.weights[:, [2, 5]].sum(1)  # left, right
    hem = sum(legs) > 0.5
    assert hem.sum() > 50
    assert np.minimum(*legs)[hem].min() > 0.02


def test_a_rejected_sample_leaves_its_status_only(run_rule, supers, tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body, status="rejected")
    register(run_rule, tiny, supers, tmp_path / "registration")
    assert [p.name for p in (tmp_path / "registration" / "00001").iterdir()] == ["status.json"]
    status = json.loads((tmp_path / "registration" / "00001" / "status.json").read_text())
    assert status["status"] == "rejected"
    assert "inside the body" in status["reason"]


def test_a_garment_elsewhere_ends_in_one_sentence(run_rule, supers, tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body)
    path = tiny.folder / "Tshirt.obj"
    lines = [
        f"v {float(x) + 50} {y} {z}" if head == "v" else " ".join([head, x, y, z, *rest])
        for head, x, y, z, *rest in (
            [*line.split(), "", "", ""][: max(4, len(line.split()))]
            for line in path.read_text().splitlines()
        )
    ]
    path.write_text("\n".join(line.strip() for line in lines) + "\n")
    write_manifest(tiny.folder, SAMPLE_MANIFEST)
    with pytest.raises(SystemExit, match="drapeline: .*Tshirt.*covers no part of the body"):
        register(run_rule, tiny, supers, tmp_path / "registration")
    assert not (tmp_path / "registration").exists()
