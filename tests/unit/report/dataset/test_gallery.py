"""Gallery pictures of samples."""

import numpy as np
import pytest
from PIL import Image

from drapeline.errors import InputError
from drapeline.report.dataset.gallery import plot_group, render_gallery, write_index
from toys.tiny_sample import write_tiny_sample


def render(tiny, folder):
    still, moving = folder / "still.png", folder / "moving.png"
    render_gallery(
        tiny.folder,
        still,
        moving,
        still_size=(90, 120),
        moving_size=(48, 64),
        frame_step=2,
    )
    return still, moving


def test_still_and_moving_picture_show_the_sample_in_the_middle(toy_body, tmp_path):
    still, moving = render(write_tiny_sample(tmp_path, toy_body), tmp_path)
    with Image.open(still) as image:
        assert image.size == (90, 120)
        picture = np.asarray(image.convert("RGB"), dtype=int)
    rows, columns = np.nonzero(picture.min(axis=2) < 200)
    assert max(np.ptp(rows) / 120, np.ptp(columns) / 90) > 0.85  # the figure fills the picture
    assert min(rows.min(), columns.min(), 119 - rows.max(), 89 - columns.max()) > 0
    assert (picture[[0, -1]] == 255).all()  # as white as the page around it
    assert (picture[:, [0, -1]] == 255).all()
    with Image.open(moving) as image:
        assert (image.n_frames, image.size) == (3, (48, 64))
        assert image.info["loop"] == 0  # for ever
        # Six frames at 30 fps are shown in their own time.
        assert image.info["duration"] * 3 == pytest.approx(200, abs=4)


def test_equal_samples_give_equal_files(toy_body, tmp_path):
    tiny = write_tiny_sample(tmp_path, toy_body)
    first, second = (render(tiny, tmp_path / name) for name in ("a", "b"))
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


@pytest.mark.parametrize("simulated", [True, False])
def test_a_rejected_sample_gets_a_card_below_its_worst_frame(toy_body, tmp_path, simulated):
    tiny = write_tiny_sample(tmp_path, toy_body, status="rejected")
    if not simulated:
        (tiny.folder / "extras/worst_frame.npz").unlink()
    still, moving = render(tiny, tmp_path)
    with Image.open(still) as image:
        corner = np.asarray(image.convert("RGB"))[2, 2]
        assert (corner > 250).all() == simulated  # the paper of a picture, or that of a card
    for path, size in ((still, (90, 120)), (moving, (48, 64))):
        with Image.open(path) as image:
            assert image.size == size
            assert np.ptp(np.asarray(image.convert("RGB"))) > 50  # there is writing on it


def test_accepted_samples_are_shown_and_no_more_than_asked_for(toy_body, tmp_path):
    samples = [
        write_tiny_sample(
            tmp_path, toy_body, f"L0000{k}", status="rejected" if k == 2 else "accepted"
        ).folder
        for k in range(1, 5)
    ]
    assert plot_group(tmp_path / "all.png", samples, most=9) == 3
    assert plot_group(tmp_path / "two.png", samples, most=2) == 2
    sizes = [Image.open(tmp_path / name).size for name in ("all.png", "two.png")]
    assert sizes[0][1] == sizes[1][1]
    assert sizes[0][0] > sizes[1][0]
    assert np.ptp(np.asarray(Image.open(tmp_path / "two.png"))) > 50


def test_a_group_without_an_accepted_sample_is_named(toy_body, tmp_path):
    one = write_tiny_sample(tmp_path, toy_body, "L00001", status="rejected")
    with pytest.raises(InputError, match="none of 1 samples was accepted"):
        plot_group(tmp_path / "sheet.png", [one.folder], most=4)


def test_the_index_shows_what_there_is_by_now(tmp_path):
    for name in ("dataset/00001/00001_moving.png", "fast/f00001/f00001_moving.png"):
        write_index(tmp_path)
        path = tmp_path / name
        path.parent.mkdir(parents=True)
        path.touch()
        write_index(tmp_path)
        assert f'src="{name}"' in (tmp_path / "index.html").read_text()
    assert "2 so far" in (tmp_path / "index.html").read_text()
