import numpy as np
import pytest
from PIL import Image

from drapeline.blender.picture import picture

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float32)
CUBE_FACES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
RED, GREEN = (0.9, 0.1, 0.1), (0.1, 0.9, 0.1)


def rendered(path, meshes, **options):
    picture(path, meshes, size=(60, 80), **options)
    return np.asarray(Image.open(path).convert("RGB"), dtype=int)


def test_subject_fills_the_frame_in_its_colour_on_white(tmp_path):
    image = rendered(
        tmp_path / "a.png", [(CUBE + np.array([3, 0, 7]), CUBE_FACES, RED)], view=(0, -1, 0)
    )
    assert image.shape == (80, 60, 3)
    red, green, _ = image[40, 30]
    assert red > 2 * green
    assert image[[0, 0, -1, -1], [0, -1, 0, -1]].min() > 250
    columns = np.flatnonzero((image.min(axis=2) < 200).any(axis=0))
    assert columns[0] == pytest.approx(59 - columns[-1], abs=1)  # centred
    assert np.ptp(columns) + 1 == pytest.approx(60 / 1.08, abs=2)


@pytest.mark.parametrize(("view", "near"), [((0, -1, 0), 0), ((0, 1, 0), 1)])
def test_view_points_from_the_subject_to_the_camera(tmp_path, view, near):
    meshes = [
        (CUBE - np.array([0, 3, 0]), CUBE_FACES, RED),
        (CUBE + np.array([0, 3, 0]), CUBE_FACES, GREEN),
    ]
    image = rendered(tmp_path / "a.png", meshes, view=view)
    assert image[40, 30].argmax() == near
