import numpy as np
import pytest

from drapeline.outfits import prints
from drapeline.outfits.fabrics import FABRICS
from drapeline.outfits.prints import draw_print, draw_texture, metres_per_unit
from toys.sheets import sheet

RED, WHITE, BLUE = [0.8, 0.0, 0.0], [1.0, 1.0, 1.0], [0.0, 0.0, 1.0]


def about(kind, size_m=0.1, seed=3):
    return {"kind": kind, "size_m": size_m, "colours": [RED, WHITE, BLUE], "seed": seed}


def test_a_seed_has_one_texture_and_other_seeds_have_others():
    first = [draw_texture(seed, "cotton", RED) for seed in range(40)]
    assert first == [draw_texture(seed, "cotton", RED) for seed in range(40)]
    kinds = {texture.get("print", {}).get("kind", "plain") for texture in first}
    assert {"plain", "stripes", "gingham", "dots"} <= kinds
    for texture in first:
        assert (texture["type"] == "pattern") == ("print" in texture)


@pytest.mark.parametrize("fabric", FABRICS)
def test_cloth_of_each_fabric_can_be_drawn(fabric):
    for seed in range(12):
        texture = draw_texture(seed, fabric, [0.6, 0.4, 0.2])
        assert len(texture["data"]) == 3
        if told := texture.get("print"):
            picture = draw_print(told, 1.5, 64)
            assert picture.shape == (64, 64, 3)
            assert picture.dtype == np.uint8
            np.testing.assert_array_equal(picture, draw_print(told, 1.5, 64))


def test_leather_is_plain_and_denim_is_blue():
    assert {draw_texture(seed, "leather", RED)["print"]["kind"] for seed in range(20)} == {"plain"}
    for seed in range(20):
        texture = draw_texture(seed, "denim", RED)
        assert texture["print"]["kind"] == "twill"
        assert texture["data"][2] >= texture["data"][0]


@pytest.mark.parametrize("kind", prints._KINDS)
def test_every_kind_repeats_after_its_repeat(kind):
    """A picture of one metre at 1 mm a pixel, of prints whose repeats are whole pixels."""
    picture = draw_print(about(kind, size_m=0.03), 1.0, 1000)
    assert picture.std() > 0
    drawn = prints._KINDS[kind](np.array([RED, WHITE, BLUE]), 0.03, np.random.default_rng(1))
    across, up = (round(1000 * length) for length in drawn.repeat_m)
    if across < 500:
        np.testing.assert_array_equal(picture[:, across:], picture[:, :-across])
    if up < 500:
        np.testing.assert_array_equal(picture[up:], picture[:-up])


def test_stripes_of_ten_centimetres_are_ten_on_a_metre():
    picture = draw_print(about("breton"), 1.0, 500)
    assert (picture == picture[:, :1]).all()
    white = picture[:, 0, 2] > 127
    assert (white[1:] & ~white[:-1]).sum() in (9, 10)
    upright = draw_print(about("pinstripe"), 1.0, 500)
    assert (upright == upright[:1]).all()


def test_a_gingham_is_half_mixed_and_a_quarter_each():
    told = about("gingham", size_m=0.05) | {"colours": [[0.8, 0, 0], [0.4, 0.4, 0.8]]}
    picture = draw_print(told, 1.0, 200)
    colours, counts = np.unique(picture.reshape(-1, 3), axis=0, return_counts=True)
    shares = dict(zip(map(tuple, colours.tolist()), (counts / counts.sum()).tolist(), strict=True))
    assert shares == {
        (204, 0, 0): pytest.approx(0.25),
        (153, 51, 102): pytest.approx(0.5),
        (102, 102, 204): pytest.approx(0.25),
    }


def test_a_side_of_the_texture_map_is_as_long_as_the_cloth_on_it():
    cloth = sheet(0.0, rows=5, edge_m=0.1)
    flat = cloth.vertices[:, :2] - cloth.vertices[:, :2].min(axis=0)
    side = metres_per_unit(cloth.vertices, cloth.faces, flat / 0.8, cloth.faces)
    assert side == pytest.approx(0.8, rel=1e-5)
