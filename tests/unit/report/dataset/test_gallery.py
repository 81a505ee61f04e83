"""Gallery pictures, and the studio and the sheets that they are made with."""

import numpy as np
import pytest
from PIL import Image

from drapeline.rendering.camera import look_at
from drapeline.rendering.contact_sheet import contact_sheet, text_card
from drapeline.rendering.raytracer import ColouredMesh, raytrace
from drapeline.report.dataset.gallery import render_gallery
from tiny_sample import write_tiny_sample

BOX = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (0.5, 1.1)])
SIDES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
BACKDROP = round(255 * 0.93)


@pytest.fixture
def camera():
    target = np.array([0.0, 0.0, 0.8])
    return look_at(target + [0.0, -5.0, 1.0], target, focal_px=200, size=(96, 128))


def render(tiny, folder):
    still, moving = folder / "still.png", folder / "moving.png"
    render_gallery(
        tiny.folder,
        still,
        moving,
        still_size=(90, 120),
        moving_size=(48, 64),
        moving_frames=4,
    )
    return still, moving


def test_still_and_moving_picture_show_the_sample_in_the_middle(toy_body, tmp_path):
    still, moving = render(write_tiny_sample(tmp_path, toy_body), tmp_path)
    with Image.open(still) as image:
        assert image.size == (90, 120)
        picture = np.asarray(image.convert("RGB"), dtype=int)
    rows, columns = np.nonzero(np.ptp(picture, axis=2) > 20)  # skin and clothes have colours
    assert abs(columns.mean() - 45) < 9
    assert len(rows) > 0.03 * 90 * 120
    assert min(rows.min(), columns.min(), 119 - rows.max(), 89 - columns.max()) > 0
    with Image.open(moving) as image:
        assert (image.n_frames, image.size) == (4, (48, 64))
        assert image.info["loop"] == 0  # for ever
        # Six frames at 30 fps are shown in their own time.
        assert image.info["duration"] * 4 == pytest.approx(200, abs=4)


def test_equal_samples_give_equal_files(toy_body, tmp_path):
    tiny = write_tiny_sample(tmp_path, toy_body)
    first, second = (render(tiny, tmp_path / name) for name in ("a", "b"))
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


def test_a_rejected_sample_gets_a_card(toy_body, tmp_path):
    still, moving = render(write_tiny_sample(tmp_path, toy_body, status="rejected"), tmp_path)
    for path, size in ((still, (90, 120)), (moving, (48, 64))):
        with Image.open(path) as image:
            assert image.size == size
            assert np.ptp(np.asarray(image.convert("RGB"))) > 50  # there is writing on it


def test_empty_backdrop_is_even_and_things_stand_where_the_camera_sees_them(camera):
    picture = raytrace([ColouredMesh(BOX, SIDES, (0.1, 0.2, 0.9))], camera, samples=16)
    assert (picture[:10] == BACKDROP).all()
    blue = picture[..., 2].astype(int) - picture[..., 0] > 40
    where, _ = camera.project(BOX)
    rows, columns = np.nonzero(blue)
    assert columns.min() == pytest.approx(where[:, 0].min(), abs=1.5)
    assert columns.max() + 1 == pytest.approx(where[:, 0].max(), abs=1.5)
    assert rows.min() == pytest.approx(where[:, 1].min(), abs=1.5)


def test_shadow_lies_on_the_floor_and_away_from_the_lamp(camera):
    picture = raytrace([ColouredMesh(BOX, SIDES, (0.1, 0.2, 0.9))], camera, samples=16)
    grey = np.ptp(picture.astype(int), axis=2) <= 2
    rows, columns = np.nonzero(grey & (picture[..., 0] < BACKDROP - 15))
    (_, horizon), _ = camera.project(np.array([0.0, 1e6, 0.0]))
    assert rows.min() > horizon
    assert columns.mean() > 48  # the lamp stands to the left of the camera


def test_the_nearer_thing_hides_the_other(camera):
    near = ColouredMesh(BOX + [0, -1, 0], SIDES, (0.9, 0.1, 0.1))
    far = ColouredMesh(BOX + [0, 1, 0], SIDES, (0.1, 0.1, 0.9))
    for parts in ([near, far], [far, near]):
        middle = raytrace(parts, camera, samples=4)[60:66, 44:52].reshape(-1, 3).mean(0)
        assert middle[0] > middle[2] + 60


def test_contact_sheet_has_a_place_for_every_picture(tmp_path):
    red, green = (np.full((20, 10, 3), colour, np.uint8) for colour in ((255, 0, 0), (0, 255, 0)))
    contact_sheet(tmp_path / "sheet.png", [(red, "1"), (green, "2"), (red, "3")], 2, gap=4)
    with Image.open(tmp_path / "sheet.png") as image:
        sheet = np.asarray(image)
    assert (sheet == [255, 0, 0]).all(-1).sum() == 2 * 200
    assert (sheet == [0, 255, 0]).all(-1).sum() == 200


@pytest.mark.parametrize("size", [(240, 320), (480, 640)])
def test_long_texts_stay_on_their_card(size):
    card = text_card("00001: rejected", "a long reason " * 100, size)
    assert card.shape == (size[1], size[0], 3)
    assert (card[-8:] == card[0, 0]).all()
    assert (card[:, -8:] == card[0, 0]).all()
