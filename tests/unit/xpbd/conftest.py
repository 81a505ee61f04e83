from functools import partial

import pytest

from drapeline.xpbd.solver import cloth_solver
from sheet_toys import drop


@pytest.fixture
def run(tmp_path):
    """run(garments, frames, ...) -> vertices (frames, V, 3) of each garment."""
    return partial(drop, tmp_path, cloth_solver(1))
