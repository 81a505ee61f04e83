"""Static outfits, written to a shard and read from it."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static import StaticOutfit, load_static
from toys.outfits_at_rest import save_static
from toys.tiny_sample import tube


def garment(name, radius):
    mesh = tube(radius, -0.5, 0.0)
    attributes = {
        "fabric": "silk",
        "texture": {"type": "pattern"},
        "parameters": {"fold_seed": round(100 * radius)},
    }
    ends = np.ones(len(mesh.vertices), np.float32)
    masks = ends, ends / 2, ends / 4
    return Garment(name, mesh.vertices, mesh.faces, mesh.uv, mesh.uv_faces, *masks, attributes)


@pytest.fixture
def outfits():
    worn = [
        (garment("Top", 0.2), garment("Skirt", 0.25)),
        (garment("Jumpsuit", 0.3),),
    ]
    return [
        StaticOutfit(
            f"s{index}",
            split,
            Outfit(garments, np.arange(10) + index, np.array([0.5, -1]), np.array([2, 3]), gender),
        )
        for index, (split, gender, garments) in enumerate(
            zip(("train", "test"), ("female", "male"), worn, strict=True)
        )
    ]


def test_a_shard_comes_back_as_it_was(outfits, tmp_path):
    save_static(tmp_path, outfits)
    for before, after in zip(outfits, load_static(tmp_path), strict=True):
        assert (before.name, before.split) == (after.name, after.split)
        assert before.outfit.gender == after.outfit.gender
        for key in ("shape", "tightness", "signed_tightness"):
            np.testing.assert_array_equal(getattr(before.outfit, key), getattr(after.outfit, key))
        for one, other in zip(before.outfit.garments, after.outfit.garments, strict=True):
            assert (one.name, one.attributes) == (other.name, other.attributes)
            np.testing.assert_array_equal(one.vertices, other.vertices)
            np.testing.assert_array_equal(one.faces, other.faces)


@pytest.mark.parametrize("lost", ["s1.npz", "s1.json"])
def test_an_outfit_without_one_of_its_files_is_refused(outfits, tmp_path, lost):
    save_static(tmp_path, outfits)
    (tmp_path / lost).unlink()
    with pytest.raises(InputError, match=f"{lost}: no such file"):
        load_static(tmp_path)


def test_a_folder_without_outfits_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds no outfit"):
        load_static(tmp_path / "missing")
