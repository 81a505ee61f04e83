"""Which scans hold a garment."""

import logging

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.models.garment4d.scans import check_labels


def taken(*shares):
    """(F, 1000) of which these shares are taken for the garment."""
    return np.arange(1000) < 1000 * np.array(shares)[:, None]


def test_scans_without_the_garment_are_refused_by_their_share_over_all_frames():
    with pytest.raises(InputError, match=r"^walk: 1\.9% of the points are taken for Skirt, exp"):
        check_labels("walk", taken(0.0, 0.038), "Skirt")
    check_labels("walk", taken(0.0, 0.040), "Skirt")


def test_single_frames_without_it_are_named(caplog):
    with caplog.at_level(logging.WARNING, logger="drapeline"):
        check_labels("walk", taken(0.3, 0.019, 0.02, 0.3), "Skirt")
    (record,) = caplog.records
    assert record.getMessage() == (
        "walk: frame 2: 1.9 % of the points are taken for Skirt; it follows other frames there"
    )
