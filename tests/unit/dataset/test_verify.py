import numpy as np
import pytest

from drapeline.dataset.verify import verify_results
from drapeline.errors import InputError
from drapeline.manifest import write_manifest
from toys.tiny_sample import write_tiny_sample


@pytest.fixture
def results(tmp_path, toy_body):
    """A sample as Snakemake leaves it, and a trained model."""
    sample = write_tiny_sample(tmp_path, toy_body).folder
    model = tmp_path / "gcvae" / "svae"
    model.mkdir(parents=True)
    (model / "best.safetensors").write_text("weights")
    write_manifest(model)
    for folder in (sample, model):
        (folder / ".snakemake_timestamp").touch()
    return tmp_path


def test_what_is_as_it_was_written_is_counted(results):
    sample = [p for p in (results / "samples" / "00001").rglob("[!.]*") if p.is_file()]
    assert verify_results(results).compared == len(sample) - 1 + 1  # all but the manifests
    # Of the stages before, which have no sums: arrays and JSON that lie beside.
    stages = [
        p for n in ("bodies", "outfits", "simulation") for p in (results / n).rglob("*.[nj]*")
    ]
    assert verify_results(results).read == len(stages) > 2


@pytest.mark.parametrize(("name", "cut"), [("bodies", False), ("outfits", True)])
def test_damage_is_found_in_files_without_sums(results, name, cut):
    path = next((results / name).rglob("*.npz"))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data[: len(data) // 3] if cut else data)
    with pytest.raises(InputError, match=rf"1 file is damaged \({path}: .*delete "):
        verify_results(results)


def test_arrays_and_records_without_sums_are_whole(results):
    np.save(results / "a.npy", np.zeros(9))
    (results / "a.npy").write_bytes((results / "a.npy").read_bytes()[:-1])
    (results / "b.json").write_text("{")
    with pytest.raises(
        InputError, match=r"2 files are damaged \(.*a\.npy: .*b\.json: not readable"
    ):
        verify_results(results)


def test_damage_is_named_with_what_to_delete(results):
    (results / "gcvae" / "svae" / "best.safetensors").write_text("Weights")
    cache = results / "samples" / "00001" / "extras" / "Body.pc16"
    cache.write_bytes(cache.read_bytes()[:100])
    with pytest.raises(InputError) as caught:
        verify_results(results)
    message = str(caught.value)
    assert message.startswith(
        f"2 files are damaged ({results}/gcvae/svae/best.safetensors: its SHA-256"
    )
    assert f"{cache}: 100 bytes, expected " in message
    model, sample = results / "gcvae" / "svae", results / "samples" / "00001"
    assert f"; delete {model}, {sample} and give the command again" in message


def test_a_damaged_manifest_is_damage_too(results):
    (results / "gcvae" / "svae" / "manifest.tsv").write_bytes(b"\xff")
    with pytest.raises(InputError, match=r"1 file is damaged \(.*manifest\.tsv: line 1 is not UTF"):
        verify_results(results)


def test_many_damaged_files_are_counted_and_not_all_shown(results):
    for path in (results / "samples" / "00001").rglob("*.*"):
        if path.suffix in (".obj", ".pc16", ".f32"):
            path.unlink()
    with pytest.raises(InputError, match=r"^8 files are damaged .*; \.\.\.\); delete"):
        verify_results(results)


def test_nothing_to_verify_is_said(tmp_path):
    with pytest.raises(InputError, match=r"no manifest\.tsv below it, expected a dataset"):
        verify_results(tmp_path)
