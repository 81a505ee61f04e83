"""The rules that write samples, collect and export them."""

import shutil

import numpy as np
import pytest

from drapeline.bodies.model import save_body
from drapeline.dataset.reader import Cloth3D
from toys.tiny_sample import write_stages


@pytest.fixture
def write(run_rule, toy_body, tmp_path):
    """Write one tiny sample by its rule; returns its stages."""
    body = tmp_path / "body.npz"
    save_body(body, toy_body)

    def run(sample, split="train", **changes):
        tiny = write_stages(tmp_path, sample, **changes)
        run_rule(
            "write_sample",
            input={
                "body": body,
                "animation": tmp_path / "bodies" / f"{sample}.npz",
                "outfit": tmp_path / "outfits" / f"{sample}.npz",
                "simulation": tmp_path / "simulation" / sample,
            },
            output=[tiny.folder],
            params={"seed": 0, "split": split},
            wildcards={"sample": sample},
        )
        return tiny

    return run


def test_samples_become_a_dataset_that_the_reader_opens(run_rule, write, tmp_path):
    truth = {name: write(name, split) for name, split in (("00001", "train"), ("00002", "test"))}
    write("00003", status="rejected")
    run_rule(
        "collect_dataset",
        input=[tmp_path / "samples" / f"0000{k}" for k in (1, 2, 3)],
        output={"dataset": tmp_path / "dataset"},
    )
    dataset = Cloth3D(tmp_path / "dataset")
    assert sorted(s.id for s in dataset) == ["00001", "00002"]
    for sequence in dataset:
        expected = truth[sequence.id].vertices["Skirt"]
        np.testing.assert_allclose(sequence.vertices("Skirt", frame="root"), expected, atol=1e-6)
    rows = (tmp_path / "dataset" / "status.tsv").read_text().splitlines()
    assert len(rows) == 4
    assert "rejected" in rows[3]
    assert "1.20 %" in rows[3]


def test_a_simulation_that_was_cut_short_is_refused_and_not_left_behind(run_rule, write, tmp_path):
    tiny = write("00001")
    cache = tmp_path / "simulation" / "00001" / "Skirt.f32"
    content = cache.read_bytes()
    cache.unlink()  # the written sample holds a link to it
    cache.write_bytes(content[:-5])
    shutil.rmtree(tiny.folder)
    with pytest.raises(SystemExit, match=r"drapeline: .*Skirt.f32"):
        run_rule(
            "write_sample",
            input={
                "body": tmp_path / "body.npz",
                "animation": tmp_path / "bodies" / "00001.npz",
                "outfit": tmp_path / "outfits" / "00001.npz",
                "simulation": tmp_path / "simulation" / "00001",
            },
            output=[tiny.folder],
            params={"seed": 0, "split": "train"},
            wildcards={"sample": "00001"},
        )
    assert not tiny.folder.exists()
    assert not [p for p in tiny.folder.parent.iterdir() if p.name.startswith(".")]


def test_export_sample_writes_the_format_it_is_asked_for(run_rule, write, tmp_path):
    tiny = write("00001")
    output = tmp_path / "exports"
    run_rule("export_sample", input=[tiny.folder], output=[output], wildcards={"format": "pc2"})
    assert {"Skirt.pc2", "Skirt.obj", "Tshirt.pc2", "Body.pc2"} <= {
        p.name for p in output.rglob("*")
    }


def test_verify_compares_what_is_there(tmp_path, write, run_rule, capsys):
    folder = write("00001").folder
    run_rule("verify", params={"results": str(tmp_path)})
    assert capsys.readouterr().out.startswith("drapeline: all files are as they were written (")
    (folder / "info.mat").write_bytes(b"")
    with pytest.raises(SystemExit, match=r"drapeline: 1 file is damaged .*info\.mat: 0 bytes"):
        run_rule("verify", params={"results": str(tmp_path)})
