"""The rules that write samples, bring them together and export them."""

import numpy as np
import pytest

from drapeline.bodies.bake import save_body
from drapeline.dataset.reader import Cloth3D
from tiny_sample import write_stages, write_tiny_sample


def test_write_sample_makes_a_readable_sample(run_rule, toy_body, tmp_path):
    tiny = write_stages(tmp_path, "00001")
    save_body(tmp_path / "body.npz", toy_body)
    run_rule(
        "write_sample",
        input={
            "body": tmp_path / "body.npz",
            "animation": tmp_path / "bodies/00001.npz",
            "outfit": tmp_path / "outfits/00001.npz",
            "parameters": tmp_path / "outfits/00001.json",
            "simulation": tmp_path / "simulation/00001",
        },
        output=[tiny.folder],
        params={"seed": 3, "partition": "val"},
        wildcards={"sample": "00001"},
    )
    sequence = Cloth3D(tmp_path / "samples")["00001"]
    assert (sequence.meta["split"], sequence.meta["seed"]) == ("val", 3)
    assert sequence.meta["body"]["model"] == "toy-1"
    np.testing.assert_array_equal(sequence.vertices("Skirt", frame="root"), tiny.vertices["Skirt"])


def test_collect_dataset_takes_the_accepted_samples(run_rule, toy_body, tmp_path):
    folders = [
        write_tiny_sample(tmp_path, toy_body, name, status=status).folder
        for name, status in (("00001", "accepted"), ("00002", "rejected"))
    ]
    run_rule("collect_dataset", input=folders, output={"dataset": tmp_path / "dataset"})
    assert Cloth3D(tmp_path / "dataset").ids == ["00001"]
    assert "1 of 2 samples accepted" in (tmp_path / "log/collect_dataset.log").read_text()


def test_export_sample_writes_the_wildcards_format(run_rule, toy_body, tmp_path):
    tiny = write_tiny_sample(tmp_path, toy_body)
    job = {"input": [tiny.folder], "output": [tmp_path / "pc2"]}
    run_rule("export_sample", **job, wildcards={"format": "pc2"})
    assert (tmp_path / "pc2" / "Skirt.pc2").is_file()
    with pytest.raises(SystemExit, match="drapeline: format 'fbx' is unknown"):
        run_rule("export_sample", **job, wildcards={"format": "fbx"})
