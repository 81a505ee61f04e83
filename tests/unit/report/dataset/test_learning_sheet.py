"""The sheet of samples to learn from."""

import numpy as np
import pytest
from PIL import Image

from drapeline.errors import InputError
from drapeline.report.dataset.learning_sheet import plot_learning
from toys.tiny_sample import write_tiny_sample


def test_accepted_samples_are_shown_and_no_more_than_asked_for(toy_body, tmp_path):
    samples = [
        write_tiny_sample(
            tmp_path, toy_body, f"L0000{k}", status="rejected" if k == 2 else "accepted"
        ).folder
        for k in range(1, 5)
    ]
    assert plot_learning(tmp_path / "all.png", samples, most=9) == 3
    assert plot_learning(tmp_path / "two.png", samples, most=2) == 2
    sizes = [Image.open(tmp_path / name).size for name in ("all.png", "two.png")]
    assert sizes[0][1] == sizes[1][1]
    assert sizes[0][0] > sizes[1][0]
    assert np.ptp(np.asarray(Image.open(tmp_path / "two.png"))) > 50


def test_a_group_without_an_accepted_sample_is_named(toy_body, tmp_path):
    one = write_tiny_sample(tmp_path, toy_body, "L00001", status="rejected")
    with pytest.raises(InputError, match="none of 1 samples was accepted"):
        plot_learning(tmp_path / "sheet.png", [one.folder], most=4)
