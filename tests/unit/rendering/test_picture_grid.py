"""Sheets of pictures and the colours of errors."""

import numpy as np
from PIL import Image

from drapeline.rendering.picture_grid import Cell, heat_colour, heat_parts, save_sheet
from gcvae_toys import tube, tube_faces

SPAN_MM = 50.0
TUBE, FACES = 2 * tube() - [0, 0, 0.6], tube_faces(False)


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
    rows = [[Cell(red), Cell(green)], [Cell(red)]]
    save_sheet(path, rows, columns=["a", "b"], labels=["one\ntwo", "x"])
    sheet = np.asarray(Image.open(path))
    assert (sheet == [255, 0, 0]).all(-1).sum() == 2 * 1200
    assert (sheet == [0, 255, 0]).all(-1).sum() == 1200
    left = np.flatnonzero((sheet == [255, 0, 0]).all(-1).any(axis=0))[0]
    assert (sheet[:, :left] < 100).any()  # the labels
    save_sheet(path, [[Cell(red)] * 5], heat_mm=SPAN_MM)
    heated = np.asarray(Image.open(path)).astype(int)
    for end in (0, 1):
        colour = np.round(255 * heat_colour(end))
        assert (np.abs(heated - colour).max(-1) <= 2).sum() >= 16


def test_sheet_holds_pictures_titles_labels_captions_and_the_bar(tmp_path):
    red = np.full((40, 60, 3), (255, 0, 0), np.uint8)
    path = tmp_path / "sheet.png"
    save_sheet(path, [[Cell(red), None], [None, Cell(red)]])
    plain = np.asarray(Image.open(path))
    assert (plain == [255, 0, 0]).all(-1).sum() == 2 * 2400
    rows = [[Cell(red, "x"), Cell(red)]]
    save_sheet(path, rows, columns=["a\nb", "c"], labels=["one\ntwo"], heat_mm=SPAN_MM)
    sheet = np.asarray(Image.open(path)).astype(int)
    red_at = np.argwhere((sheet == [255, 0, 0]).all(-1))
    assert 2 * 2400 - 120 < len(red_at) < 2 * 2400  # one caption covers some of it
    top, left = red_at.min(axis=0)
    assert (sheet[:top, left:] < 100).any()
    assert (sheet[top:, :left] < 100).any()
    below = sheet[red_at.max(axis=0)[0] + 1 :]
    for colour in ((68, 1, 84), (253, 231, 37)):
        assert (np.abs(below - colour).max(-1) <= 2).sum() >= 16
