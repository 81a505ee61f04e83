"""The comparison of two results folders sees every change of an array, and no other."""

import json

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import save_file

from compare_results import array_hashes, differences, main


@pytest.fixture
def folders(tmp_path):
    for name in ("before", "after"):
        folder = tmp_path / name
        (folder / "logs").mkdir(parents=True)
        (folder / "logs" / "noise.npy").write_bytes(name.encode())
        np.savez(folder / "garment.npz", x=np.arange(6.0).reshape(2, 3), f=np.arange(3))
        np.save(folder / "rows.npy", np.ones((4, 2), np.float32))
        (folder / "Skirt.pc16").write_bytes(bytes(range(20)))
        torch.save(
            {"state_dict": {"w": torch.ones(3)}, "callbacks": {name: torch.zeros(1)}},
            folder / "last.ckpt",
        )
        save_file({"w": torch.ones(3)}, folder / "best.safetensors")
        Image.new("RGB", (4, 4), (255, 0, 0)).save(folder / "still.png")
        (folder / "about.json").write_text(json.dumps({"made": name}))
    return tmp_path / "before", tmp_path / "after"


def test_equal_arrays_are_counted_and_other_files_do_not_matter(folders, capsys):
    assert main(list(map(str, folders))) == 0
    assert "7 arrays are the same to the bit, 0 are not" in capsys.readouterr().out


def change_npz(folder):
    np.savez(folder / "garment.npz", x=np.arange(6.0).reshape(3, 2), f=np.arange(3))


def change_npy(folder):
    np.save(folder / "rows.npy", np.ones((4, 2), np.float64))


def change_cache(folder):
    (folder / "Skirt.pc16").write_bytes(bytes(range(1, 21)))


def change_weights(folder):
    save_file({"w": torch.tensor([1, 1, 1 + 1e-7])}, folder / "best.safetensors")


def change_state(folder):
    torch.save({"state_dict": {"w": torch.tensor([1, 1, 1 + 1e-7])}}, folder / "last.ckpt")


def change_picture(folder):
    Image.new("RGB", (4, 4), (254, 0, 0)).save(folder / "still.png")


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (change_npz, "garment.npz:x"),
        (change_npy, "rows.npy:"),
        (change_cache, "Skirt.pc16:"),
        (change_weights, "best.safetensors:/w"),
        (change_state, "last.ckpt:/state_dict/w"),
        (change_picture, "still.png:0"),
    ],
)
def test_one_changed_bit_shape_or_type_is_named(folders, change, name):
    before, after = folders
    change(after)
    assert differences(array_hashes(before), array_hashes(after)) == [f"differs: {name}"]
    assert main(list(map(str, folders))) == 1


def test_what_is_missing_is_named_on_its_side_and_moved_files_can_be_matched(folders, capsys):
    before, after = folders
    (after / "rows.npy").rename(after / "lines.npy")
    assert main([str(before), str(after)]) == 1
    out = capsys.readouterr().out
    assert "only before: rows.npy:" in out
    assert "only after: lines.npy:" in out
    assert main([str(before), str(after), "--renamed", "rows=lines"]) == 0


def test_weights_are_the_same_in_whichever_form_they_are_stored(folders):
    before, after = folders
    (before / "best.safetensors").unlink()
    (after / "last.ckpt").unlink()
    renamed = ["--renamed", "last.ckpt:/state_dict/=best.safetensors:/"]
    assert main([str(before), str(after), *renamed]) == 0


def test_empty_folders_are_no_success(tmp_path):
    assert main([str(tmp_path), str(tmp_path)]) == 1
