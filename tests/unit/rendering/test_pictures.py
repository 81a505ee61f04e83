"""Grids, contact sheets, cards and animations."""

import numpy as np
import pytest
from PIL import Image

from drapeline.rendering.pictures import (
    GridCell,
    heat_colour,
    heat_parts,
    join_pictures,
    save_animation,
    save_contact_sheet,
    save_grid,
    text_card,
)
from toys.gcvae import tube, tube_faces

SPAN_MM = 50.0
TUBE, FACES = 2 * tube() - [0, 0, 0.6], tube_faces(False)
SHADES = [0, 80, 160, 240]


def test_heat_goes_from_dark_blue_to_yellow_and_stays_there():
    low, high = heat_colour(0), heat_colour(1)
    assert low[2] > low[1]
    assert (high[:2] > 0.8).all()
    assert high[2] < 0.3
    np.testing.assert_array_equal(heat_colour(10), high)


def test_heat_paints_every_face_once_from_dark_to_yellow():
    error = SPAN_MM * np.linspace(-0.5, 2, len(TUBE)).clip(0)
    parts = heat_parts(TUBE, FACES, error[FACES].mean(axis=1), SPAN_MM)
    faces = np.concatenate([p.faces for p in parts])
    assert sorted(map(tuple, faces.tolist())) == sorted(map(tuple, FACES.tolist()))
    low, high = parts[0], parts[-1]
    assert error[low.faces].mean(axis=1).max() < SPAN_MM / 30
    assert sum(low.colour) < 1 < 1.5 < sum(high.colour)
    assert error[high.faces].mean(axis=1).min() > 0.97 * SPAN_MM


def test_sheet_holds_every_picture_titles_labels_and_the_bar(tmp_path):
    red, green = (np.full((40, 30, 3), c, np.uint8) for c in ((255, 0, 0), (0, 255, 0)))
    path = tmp_path / "sheet.png"
    rows = [[GridCell(red), GridCell(green)], [GridCell(red)]]
    save_grid(path, rows, columns=["a", "b"], labels=["one\ntwo", "x"])
    sheet = np.asarray(Image.open(path).convert("RGB"))
    assert (sheet == [255, 0, 0]).all(-1).sum() == 2 * 1200
    assert (sheet == [0, 255, 0]).all(-1).sum() == 1200
    left = np.flatnonzero((sheet == [255, 0, 0]).all(-1).any(axis=0))[0]
    assert (sheet[:, :left] < 100).any()  # the labels
    save_grid(path, [[GridCell(red)] * 5], heat_mm=SPAN_MM)
    heated = np.asarray(Image.open(path).convert("RGB")).astype(int)
    for end in (0, 1):
        colour = np.round(255 * heat_colour(end))
        assert (np.abs(heated - colour).max(-1) <= 2).sum() >= 16


def test_sheet_holds_pictures_titles_labels_captions_and_the_bar(tmp_path):
    red = np.full((40, 60, 3), (255, 0, 0), np.uint8)
    path = tmp_path / "sheet.png"
    save_grid(path, [[GridCell(red), None], [None, GridCell(red)]])
    plain = np.asarray(Image.open(path).convert("RGB"))
    assert (plain == [255, 0, 0]).all(-1).sum() == 2 * 2400
    rows = [[GridCell(red, "x"), GridCell(red)]]
    save_grid(path, rows, columns=["a\nb", "c"], labels=["one\ntwo"], heat_mm=SPAN_MM)
    sheet = np.asarray(Image.open(path).convert("RGB")).astype(int)
    red_at = np.argwhere((sheet == [255, 0, 0]).all(-1))
    assert 2 * 2400 - 120 < len(red_at) < 2 * 2400  # one caption covers some of it
    top, left = red_at.min(axis=0)
    assert (sheet[:top, left:] < 100).any()
    assert (sheet[top:, :left] < 100).any()
    below = sheet[red_at.max(axis=0)[0] + 1 :]
    for colour in ((68, 1, 84), (253, 231, 37)):
        assert (np.abs(below - colour).max(-1) <= 2).sum() >= 16


def test_contact_sheet_has_a_place_for_every_picture(tmp_path):
    red, green = (np.full((20, 10, 3), colour, np.uint8) for colour in ((255, 0, 0), (0, 255, 0)))
    save_contact_sheet(tmp_path / "sheet.png", [(red, "1"), (green, "2"), (red, "3")], 2)
    with Image.open(tmp_path / "sheet.png") as image:
        sheet = np.asarray(image.convert("RGB"))
    assert (sheet == [255, 0, 0]).all(-1).sum() == 2 * 200
    assert (sheet == [0, 255, 0]).all(-1).sum() == 200


def test_long_captions_keep_off_their_neighbours_and_off_the_row_below(tmp_path):
    white = np.full((30, 120, 3), 255, np.uint8)
    cells = [(white, "L00182: getup_facedown at 0.95, mirrored"), (white, "short")] * 2
    save_contact_sheet(tmp_path / "sheet.png", cells, 2, letter=11)
    with Image.open(tmp_path / "sheet.png") as image:
        ink = (np.asarray(image.convert("L")) < 128).any
    assert not ink(0)[130:136].any()  # between the columns
    height = 8 + (len(ink(1)) - 8) // 2
    assert ink(1)[:height].any()
    np.testing.assert_array_equal(ink(1)[8:height], ink(1)[height:])


@pytest.mark.parametrize("size", [(240, 320), (480, 640)])
def test_long_texts_stay_on_their_card(size):
    card = text_card("00001: rejected", "a long reason " * 100, size)
    assert card.shape == (size[1], size[0], 3)
    assert (card[-8:] == card[0, 0]).all()
    assert (card[:, -8:] == card[0, 0]).all()


def test_joined_pictures_stand_side_by_side_under_their_titles():
    red, green = (np.full((20, 60, 3), colour, np.uint8) for colour in ((255, 0, 0), (0, 255, 0)))
    joined = join_pictures([red, green], ["one", "two"])
    assert joined.shape[1] == 120
    np.testing.assert_array_equal(joined[-20:], np.concatenate([red, green], axis=1))
    for half in (joined[:-20, :60], joined[:-20, 60:]):
        assert (half < 100).any()


# 144 colours in all, which a palette can hold, and 16,384, which only full colour can.
@pytest.mark.parametrize(("name", "steps", "most"), [("m.png", 6, 0), ("m.webp", 64, 4)])
def test_a_moving_picture_shows_its_pictures_in_turn_and_loops(tmp_path, name, steps, most):
    ramps = np.meshgrid(*[np.linspace(50, 200, steps, dtype=np.uint8)] * 2)
    pictures = [np.dstack([np.full_like(ramps[0], shade), *ramps]) for shade in SHADES]
    save_animation(tmp_path / name, pictures, 1000 / 15)
    with Image.open(tmp_path / name) as image:
        assert image.n_frames == len(SHADES)
        assert image.info["loop"] == 0
        for frame, picture in enumerate(pictures):
            image.seek(frame)
            image.load()
            assert image.info["duration"] == 67
            seen = np.asarray(image.convert("RGB"), dtype=int)
            assert np.abs(seen - picture).mean() <= most


def test_shadows_fade_out_into_white_without_dithering(tmp_path):
    rng = np.random.default_rng(0)
    grey = np.broadcast_to(np.linspace(225, 255, 300).astype(np.uint8)[None, :, None], (40, 300, 3))
    cloth = rng.integers(225, size=(40, 300, 3)).astype(np.uint8)
    picture = np.concatenate([grey, cloth])
    save_animation(tmp_path / "m.png", [picture, picture[::-1]], 40)
    with Image.open(tmp_path / "m.png") as image:
        seen = np.asarray(image.convert("RGB"), dtype=int)
    assert np.abs(seen[:40] - grey).max() <= 1
    assert (seen[:40][grey == 255] == 255).all()
    # Pixels of one colour stay of one colour.
    assert (seen[:40] == seen[:1]).all()


def test_pale_cloth_keeps_its_colour(tmp_path):
    cream = np.full((8, 8, 3), (250, 244, 228), dtype=np.uint8)
    save_animation(tmp_path / "m.png", [cream, cream // 2], 40)
    with Image.open(tmp_path / "m.png") as image:
        np.testing.assert_array_equal(np.asarray(image.convert("RGB")), cream)


def test_an_empty_picture_is_white(tmp_path):
    save_animation(tmp_path / "m.png", [np.full((4, 4, 3), 255, dtype=np.uint8)] * 2, 40)
    with Image.open(tmp_path / "m.png") as image:
        assert (np.asarray(image.convert("RGB")) == 255).all()
