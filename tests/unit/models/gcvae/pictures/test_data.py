import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.models.gcvae.pictures.data import PictureData, PictureRows, collect_pictures
from drapeline.models.gcvae.pictures.views import CHANNELS
from drapeline.models.gcvae.settings import PictureViews
from drapeline.models.pictures.read import CLASSES
from toys.pictured import VIEWS, save_registered, toy_motions
from toys.smplicit import toy_bodies, toy_outfits

SKIRT = CLASSES.index("skirt")


@pytest.fixture(scope="module")
def data(tmp_path_factory, toy_body):
    return save_registered(tmp_path_factory.mktemp("registered") / "data", toy_body)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, data, toy_body):
    folder = tmp_path_factory.mktemp("pictures") / "pictures"
    collect_pictures(folder, toy_outfits(), toy_motions(), data, toy_bodies(toy_body), VIEWS)
    return folder


def test_every_outfit_of_a_split_with_motions_is_pictured(folder, data):
    pictures = PictureData(folder, len(data))
    assert pictures.size_px == VIEWS.size_px
    assert pictures.views.classes.shape[0] == 6 * VIEWS.per_outfit  # none of the test split
    assert len(pictures.rows("test")) == 0
    for split in ("train", "val"):
        own = pictures.garment[pictures.rows(split)]
        assert set(own) == set(data.rows(split))
    assert set(pictures.kind) == {SKIRT}
    # Of other frames, from other sides.
    assert (pictures.views.classes[0] != pictures.views.classes[1]).any()


def test_an_outfit_is_pictured_alike_whoever_else_is(tmp_path, folder, data, toy_body):
    other = tmp_path / "pictures"
    bodies = toy_bodies(toy_body)
    collect_pictures(other, toy_outfits()[1:2], toy_motions(), data, bodies, VIEWS)
    alone, all_ = (PictureData(path, len(data)).views for path in (other, folder))
    part = slice(VIEWS.per_outfit, 2 * VIEWS.per_outfit)
    np.testing.assert_array_equal(alone.body, all_.body[part])
    np.testing.assert_array_equal(alone.classes, all_.classes[part])


def test_rows_are_images_with_the_codes_of_their_garments(folder, data):
    pictures = PictureData(folder, len(data))
    codes = np.arange(2.0 * len(data), dtype=np.float32).reshape(-1, 2)
    rows = PictureRows(pictures, codes, data)
    chosen = rows.rows("val")[:3]
    batch = rows.batch(chosen)
    assert batch["images"].shape == (3, CHANNELS, VIEWS.size_px, VIEWS.size_px)
    assert (batch["images"][:, 5].sum(axis=(1, 2)) > 0).all()
    np.testing.assert_array_equal(batch["z"], codes[pictures.garment[chosen]])
    assert batch["names"] == data.names(pictures.garment[chosen])


def test_garments_that_are_not_registered_or_hardly_seen_have_no_row(tmp_path, data, toy_body):
    outfits = [one._replace(name=f"x{one.name}") for one in toy_outfits()[:1]] + toy_outfits()[1:2]
    bodies = toy_bodies(toy_body)
    count = collect_pictures(tmp_path / "p", outfits, toy_motions(), data, bodies, VIEWS)
    pictures = PictureData(tmp_path / "p", len(data))
    assert count == len(pictures.garment) == VIEWS.per_outfit
    assert set(pictures.garment) == {1}


def test_without_motions_there_are_no_pictures(tmp_path, data, toy_body):
    size = PictureViews(size_px=16)
    assert not collect_pictures(tmp_path / "p", toy_outfits(), [], data, toy_bodies(toy_body), size)
    assert len(PictureData(tmp_path / "p", len(data)).rows("train")) == 0


def test_pictures_of_other_garments_are_refused(folder):
    with pytest.raises(InputError, match=r"rows\.npz"):
        PictureData(folder, 2)
    with pytest.raises(InputError, match="no such file"):
        PictureData(folder / "nothing", 2)
