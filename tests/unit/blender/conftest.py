from functools import partial

import pytest

from toys.blender import drop


@pytest.fixture
def run(tmp_path):
    """run(garments, frames, ...) -> vertices (frames, V, 3) of each garment."""
    return partial(drop, tmp_path)
