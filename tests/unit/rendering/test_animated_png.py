import numpy as np
from PIL import Image

from drapeline.rendering.animated_png import save_animation


def test_a_moving_picture_shows_its_pictures_in_turn_and_loops(tmp_path):
    shades = [0, 80, 160, 240]
    save_animation(tmp_path / "m.png", [np.full((20, 20, 3), s, np.uint8) for s in shades], 50)
    with Image.open(tmp_path / "m.png") as image:
        assert image.n_frames == len(shades)
        assert image.info["loop"] == 0
        seen = []
        for frame in range(len(shades)):
            image.seek(frame)
            seen.append(int(np.asarray(image.convert("RGB"))[0, 0, 0]))
    np.testing.assert_allclose(seen, shades, atol=4)
