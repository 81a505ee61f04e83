"""Moving pictures."""

import numpy as np
import pytest
from PIL import Image

from drapeline.rendering.animation import save_animation

SHADES = [0, 80, 160, 240]


@pytest.mark.parametrize(("name", "most"), [("m.png", 0), ("m.webp", 4)])
def test_a_moving_picture_shows_its_pictures_in_turn_and_loops(tmp_path, name, most):
    ramps = np.meshgrid(*[np.linspace(50, 200, 64, dtype=np.uint8)] * 2)  # 4096 colours
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
