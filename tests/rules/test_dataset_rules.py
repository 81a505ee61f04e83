"""The rules that write samples, collect and export them."""

import numpy as np
import pytest

from drapeline.dataset.reader import Cloth3D
from toys.tiny_sample import write_tiny_sample


@pytest.fixture
def write(toy_body, tmp_path):
    """Write one tiny sample into a shard of its own."""

    def run(sample, split="train", **changes):
        return write_tiny_sample(tmp_path / sample, toy_body, sample, split, **changes)

    return run


def test_samples_become_a_dataset_that_the_reader_opens(run_rule, write, tmp_path, capsys):
    truth = {name: write(name, split) for name, split in (("00001", "train"), ("00002", "test"))}
    write("00003", status="rejected")
    run_rule(
        "collect_dataset",
        input=[tmp_path / f"0000{k}" / "samples" for k in (1, 2, 3)],
        output={"dataset": tmp_path / "dataset"},
    )
    said = capsys.readouterr().out
    assert said.startswith("drapeline: 2 of 3 samples accepted (1 rejected: 1.20 % of the vertices")
    dataset = Cloth3D(tmp_path / "dataset")
    assert sorted(s.id for s in dataset) == ["00001", "00002"]
    for sequence in dataset:
        expected = truth[sequence.id].vertices["Skirt"]
        np.testing.assert_allclose(sequence.vertices("Skirt", frame="root"), expected, atol=1e-6)
    rows = (tmp_path / "dataset" / "status.tsv").read_text().splitlines()
    assert len(rows) == 4
    assert "rejected" in rows[3]
    assert "1.20 %" in rows[3]


def test_a_run_in_which_no_sample_is_accepted_fails_with_the_reasons(run_rule, write, tmp_path):
    for name in ("00001", "00002"):
        write(name, status="rejected")
    with pytest.raises(SystemExit, match="0 of 2 samples accepted .2 rejected by 1.20 % of the"):
        run_rule(
            "collect_dataset",
            input=[tmp_path / f"0000{k}" / "samples" for k in (1, 2)],
            output={"dataset": tmp_path / "dataset"},
        )


def test_export_sample_writes_the_format_it_is_asked_for(run_rule, write, tmp_path):
    tiny = write("00001")
    output = tmp_path / "exports"
    wanted = {"sample": "00001", "format": "pc2"}
    run_rule("export_sample", input=[tiny.folder.parent], output=[output], wildcards=wanted)
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
