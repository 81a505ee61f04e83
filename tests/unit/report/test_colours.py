"""The colours of garments and the gloss of fabrics."""

import numpy as np
from matplotlib.colors import to_rgb

from drapeline.outfits.garment_types import GARMENTS
from drapeline.report.colours import GARMENT_COLOURS, fabric_gloss, garment_colour


def test_garment_types_have_colours_that_can_be_told_apart():
    colours = np.array([garment_colour(garment) for garment in GARMENTS])
    apart = np.abs(colours[:, None] - colours).max(axis=2)
    assert apart[~np.eye(len(GARMENTS), dtype=bool)].min() > 0.2


def test_colours_are_as_matplotlib_reads_them():
    assert all(garment_colour(name) == to_rgb(colour) for name, colour in GARMENT_COLOURS.items())


def test_only_some_fabrics_are_glossy():
    assert fabric_gloss("silk") > 0
    assert fabric_gloss("denim") == fabric_gloss(None) == 0
