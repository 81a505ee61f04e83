import numpy as np
from PIL import Image

from drapeline.frames import JOINT_NAMES
from drapeline.metrics.predictions import BODY, TRUE
from drapeline.report.models.gcvae.pictures import (
    FITTED,
    SegmentedPicture,
    plot_pictures,
    segment_colours,
)
from toys.smplicit import tube


def test_segments_are_told_apart_and_what_is_none_is_white():
    colours = segment_colours()
    assert len(np.unique(colours, axis=0)) == len(colours) == 1 + len(JOINT_NAMES)
    assert (colours[0] == 255).all()


def test_what_nobody_found_leaves_its_place_empty(tmp_path):
    labels = np.zeros((20, 20), np.uint8)
    labels[5:15, 5:15] = 1
    picture = SegmentedPicture("00001_003", labels, np.where(labels == 1, 4, 0).astype(np.uint8))
    wearer = {BODY: {BODY: tube(0.15, -0.9, 0.6)}}
    garments = {"Skirt": tube(0.3, -0.4, 0.0)}

    def ink(**found):
        plot_pictures(tmp_path / "sheet.png", [(picture, wearer | found)])
        with Image.open(tmp_path / "sheet.png") as image:
            return np.asarray(image.convert("L")) < 200

    some = ink(**{TRUE: garments})
    more = ink(**{TRUE: garments, FITTED: garments})
    assert some.shape == more.shape
    last = some.shape[1] * 4 // 5
    assert not some[60:, last + 10 :].any()
    assert more[60:, last + 10 :].any()
