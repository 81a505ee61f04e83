from dataclasses import replace

import numpy as np
import pytest

from drapeline.motions.floor import floor_report, set_on_floor
from toys.motion_files import standing_motion

UPRIGHT = np.concatenate([[np.pi / 2], np.zeros(71)])


def test_report_of_standing_still_is_clean():
    report = floor_report(set_on_floor(standing_motion()))
    assert report.sliding_mm_per_frame == 0
    assert report.penetration_max_mm < 1e-6
    assert report.supported == 1.0


def test_sliding_is_the_travel_per_frame():
    rested = set_on_floor(standing_motion(speed_m=0.005), feet=False, hands=False)
    report = floor_report(rested)
    assert report.sliding_mm_per_frame == pytest.approx(5.0)
    assert report.near_floor_mm_per_frame == pytest.approx(5.0)
    assert report.resting == 1.0


def test_penetration_and_floating_are_measured():
    rested = set_on_floor(standing_motion())
    sunk = floor_report(replace(rested, trans=rested.trans - [0, 0, 0.02]))
    assert sunk.penetration_mean_mm == pytest.approx(20)
    assert sunk.penetration_max_mm == pytest.approx(20)
    raised = floor_report(replace(rested, trans=rested.trans - [0, 0, -0.03]))
    assert raised.floating_mean_mm == pytest.approx(30)
