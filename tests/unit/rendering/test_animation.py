"""Moving pictures."""

import numpy as np
import pytest
from PIL import Image

from drapeline.rendering.pictures import save_animation

SHADES = [0, 80, 160, 240]


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
