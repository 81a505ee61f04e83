"""Equation 1 and the outlines it is applied to."""

import numpy as np
import pytest

from drapeline.outfits.patterns.width_profile import WidthLine


@pytest.mark.parametrize(("x", "width"), [(0.0, 0.2), (0.1, 0.19), (0.3, 0.17), (0.5, 0.25)])
def test_width_falls_up_to_the_offset_and_rises_after_it(x, width):
    line = WidthLine(alpha1=-0.1, alpha2=0.5, x_offset_m=0.3, w0_m=0.2)
    assert line(x) == pytest.approx(width)


def test_skirts_only_widen():
    line = WidthLine(alpha1=0.5, alpha2=0.0, x_offset_m=0.0, w0_m=0.3)
    np.testing.assert_allclose(line(np.array([0.0, 0.4])), [0.3, 0.5])
