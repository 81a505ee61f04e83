"""Outfits and their files."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.outfits.outfit import load_outfit
from drapeline.storage import save_npz

ARRAYS = ("vertices", "faces", "uv", "uv_faces", "pin", "elastic")


def test_files_give_back_the_outfit(outfits, tmp_path):
    for outfit in outfits.values():
        outfit.save(tmp_path / "o.npz", tmp_path / "o.json")
        back = load_outfit(tmp_path / "o.npz", tmp_path / "o.json")
        np.testing.assert_array_equal(back.shape, outfit.shape)
        np.testing.assert_array_equal(back.tightness, outfit.tightness)
        assert [g.name for g in back.garments] == [g.name for g in outfit.garments]
        for a, b in zip(back.garments, outfit.garments, strict=True):
            assert a.attributes == b.attributes
            for key in ARRAYS:
                np.testing.assert_array_equal(getattr(a, key), getattr(b, key))
                assert getattr(a, key).dtype == getattr(b, key).dtype


def test_an_outfit_file_without_a_garment_is_refused(outfits, tmp_path):
    outfits["Dress"].save(tmp_path / "o.npz", tmp_path / "o.json")
    save_npz(tmp_path / "o.npz", other=np.zeros(3))
    with pytest.raises(InputError, match="Dress/vertices"):
        load_outfit(tmp_path / "o.npz", tmp_path / "o.json")


def test_arrays_that_do_not_fit_one_another_are_refused(outfits, tmp_path):
    outfits["Dress"].save(tmp_path / "o.npz", tmp_path / "o.json")
    arrays = dict(np.load(tmp_path / "o.npz"))
    arrays["Dress/uv_faces"] = arrays["Dress/uv_faces"][1:]
    save_npz(tmp_path / "o.npz", **arrays)
    with pytest.raises(InputError, match=r"o\.npz: .*Dress/uv_faces"):
        load_outfit(tmp_path / "o.npz", tmp_path / "o.json")


@pytest.mark.parametrize("key", ["fabric", "texture"])
def test_a_garment_without_a_fabric_or_a_texture_is_refused(outfits, tmp_path, key):
    outfits["Dress"].save(tmp_path / "o.npz", tmp_path / "o.json")
    text = (tmp_path / "o.json").read_text()
    (tmp_path / "o.json").write_text(text.replace(f'"{key}"', '"other"'))
    with pytest.raises(InputError, match=rf"o\.json: .* lacks '{key}'"):
        load_outfit(tmp_path / "o.npz", tmp_path / "o.json")
