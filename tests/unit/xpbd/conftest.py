from functools import partial

import pytest
import warp as wp

from drapeline.xpbd.solver import cloth_solver
from sheet_toys import drop


@pytest.fixture(autouse=True)
def _on_the_processor():
    """Where there is a GPU, Warp would put arrays there."""
    with wp.ScopedDevice("cpu"):
        yield


@pytest.fixture
def run(tmp_path):
    """run(garments, frames, ...) -> vertices (frames, V, 3) of each garment."""
    return partial(drop, tmp_path, cloth_solver(1))
