"""Seams, hems, bands, buttons and pockets on texture maps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import label
from scipy.spatial import KDTree

from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.finish import draw_cloth
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.outfit import Garment
from drapeline.seeding import rng_for

GREY, RED = [0.6, 0.6, 0.6], [0.8, 0.1, 0.1]
SIZE = 1000


def plain(colour, kind="plain"):
    told = {"kind": kind, "size_m": 0.003, "colours": [colour, colour, colour], "seed": 1}
    return {"type": "pattern", "data": colour, "print": told}


def square(fabric="cotton", colour=GREY, **parameters):
    """A sheet of a metre each way that fills its map but for a margin of a tenth."""
    line = np.linspace(-0.5, 0.5, 11)
    x, z = np.meshgrid(line, line)
    points = np.stack([x, np.full_like(x, -0.1), z], -1).reshape(-1, 3).astype(np.float32)
    grid = np.arange(121).reshape(11, 11)
    faces = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], -1)
    faces = faces.reshape(-1, 4).astype(np.int32)
    uv = (0.5 + 0.8 * points[:, [0, 2]]).astype(np.float32)
    attributes = {"fabric": fabric, "texture": plain(colour), "parameters": parameters}
    return Garment("Top", points, faces, uv, faces, *3 * [np.zeros(121)], attributes=attributes)


def changed(picture, colour=GREY):
    """Pixels that are not of the cloth's colour."""
    return (picture != np.round(255 * np.array(colour))).any(axis=-1)


def test_a_hem_is_stitched_two_centimetres_from_the_edge_within_the_panel():
    drawn = changed(draw_cloth(square(), SIZE))
    column = np.flatnonzero(drawn[:, SIZE // 2])
    # The sheet's lower edge is at 900 of 1000 pixels, 800 of which are a metre.
    assert np.abs(column - (900 - 16)).max() <= 2
    assert not drawn[:100].any()
    assert not drawn[901:].any()


def made(toy_body, templates, outfit_type, fabric, seed=3, **changes):
    ranges = replace(OutfitRanges(), elastic_chance=0.0, **changes)
    outfit = sample_outfit(
        rng_for(seed, "finish"),
        templates,
        toy_body,
        gender="female",
        shape=np.zeros(10),
        outfit_type=outfit_type,
        edge_length_m=0.025,
        ranges=ranges,
        fabrics=(fabric,),
    )
    return {garment.name: garment for garment in outfit.garments}


def in_colour(garment, colour, kind="plain"):
    texture = plain(colour, kind)
    return replace(garment, attributes=garment.attributes | {"texture": texture})


def discs(picture, colour):
    near = np.abs(picture / 255 - colour).max(axis=-1) < 0.02
    return label(near)[1]


def test_buttons_run_down_the_front_of_a_shirt_and_end_with_a_polos_opening(toy_body, templates):
    dark, ivory = [0.1, 0.1, 0.25], (0.92, 0.89, 0.82)
    counts = {}
    for front, chances in (
        ("buttoned", {"buttoned_chance": 1.0}),
        ("polo", {"buttoned_chance": 0.0, "polo_chance": 1.0}),
        ("closed", {"buttoned_chance": 0.0, "polo_chance": 0.0}),
    ):
        worn = made(toy_body, templates, "Tshirt+Skirt", "linen", **chances)
        assert worn["Tshirt"].attributes["parameters"]["upper"]["front"] == front
        picture = draw_cloth(in_colour(worn["Tshirt"], dark), 2048)
        counts[front] = discs(picture, ivory)
    assert counts["closed"] == 0
    assert 1 <= counts["polo"] < counts["buttoned"]


def test_a_polo_jumpsuit_has_its_buttons_on_the_chest(toy_body, templates):
    dark, ivory = [0.1, 0.1, 0.25], (0.92, 0.89, 0.82)
    polo = {"buttoned_chance": 0.0, "polo_chance": 1.0, "collar_chance": 1.0}
    for seed in range(20):
        suit = made(toy_body, templates, "Jumpsuit", "linen", seed, **polo)["Jumpsuit"]
        if suit.attributes["parameters"]["upper"]["front"] == "polo":
            break
    picture = draw_cloth(in_colour(suit, dark), 2048)
    near = np.argwhere(np.abs(picture / 255 - ivory).max(axis=-1) < 0.02)
    assert len(near)
    places = suit.uv * [2047, -2047] + [0, 2047]
    corner = np.zeros(len(suit.uv), dtype=int)
    corner[suit.uv_faces.ravel()] = suit.faces.ravel()
    _, row = KDTree(places[:, ::-1]).query(near)
    assert (suit.vertices[corner[row], 2] > suit.vertices[:, 2].max() - 0.35).all()


def test_jeans_are_stitched_in_orange_and_have_pockets_that_sweatpants_lack(toy_body, templates):
    orange = (0.8, 0.58, 0.3)
    pixels = {}
    for fabric in ("denim", "fleece", "linen"):
        worn = made(toy_body, templates, "Top+Trousers", "linen")["Trousers"]
        worn = replace(worn, attributes=worn.attributes | {"fabric": fabric})
        picture = draw_cloth(in_colour(worn, GREY), 2048)
        pixels[fabric] = changed(picture).sum()
        near = (np.abs(picture / 255 - orange).max(axis=-1) < 0.1).sum()
        assert (near > 5000) == (fabric == "denim")
    assert pixels["fleece"] < pixels["linen"] < pixels["denim"]


def test_the_same_garment_has_the_same_picture(toy_body, templates):
    shirt = made(toy_body, templates, "Tshirt+Trousers", "cotton", buttoned_chance=1.0)["Tshirt"]
    np.testing.assert_array_equal(draw_cloth(shirt, 512), draw_cloth(shirt, 512))


@pytest.mark.parametrize("colour", [GREY, [0.05, 0.05, 0.05]])
def test_lines_are_seen_on_light_and_on_dark_cloth(colour):
    picture = draw_cloth(square(colour=colour), SIZE)
    lines = picture[changed(picture, colour)] / 255
    assert np.abs(lines - colour).mean() > 0.15
