"""Tests of the fast solver run on the processor, and on a GPU as well where there is one."""

from functools import partial

import pytest
import warp as wp

from drapeline.geometry.warp_mesh import start_warp
from drapeline.xpbd.solver import cloth_solver
from toys.sheets import drop


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Choose devices, and for those who ask whether constraints act `parallel`: on a GPU always."""
    start_warp()
    in_turn = metafunc.definition.get_closest_marker("processor_only")
    ways = [("cpu", False), ("cpu", True), ("cuda", True)]
    ways = ways if wp.is_cuda_available() and not in_turn else ways[:2]
    if "parallel" in metafunc.fixturenames:
        metafunc.parametrize(("device", "parallel"), ways, indirect=["device"])
    elif len(ways) > 2:
        metafunc.parametrize("device", ["cpu", "cuda"], indirect=True)


@pytest.fixture(autouse=True)
def device(request):
    """Warp's name of where arrays are put and kernels run."""
    name = getattr(request, "param", "cpu")
    with wp.ScopedDevice(name):
        yield name


@pytest.fixture
def accelerator(device):
    """What the config calls it."""
    return {"cpu": "cpu", "cuda": "gpu"}[device]


@pytest.fixture
def run(tmp_path, accelerator):
    """run(garments, frames, ...) -> vertices (frames, V, 3) of each garment."""
    return partial(drop, tmp_path, cloth_solver(1, accelerator))
