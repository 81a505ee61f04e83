import ctypes
import os

import pytest

from drapeline.blender.threads import limited_threads


def allowed():
    """How many threads oneTBB may take now."""
    library = ctypes.CDLL("libtbb.so.12", mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
    ask = library._ZN3tbb6detail2r127global_control_active_valueEi
    ask.restype = ctypes.c_size_t
    return ask(0)


@pytest.mark.parametrize("threads", [1, 3])
def test_blender_is_held_to_its_threads_and_let_go_again(threads):
    before = allowed()
    with limited_threads(threads):
        assert allowed() == threads
    assert allowed() == before


def test_the_limit_ends_with_an_error_too():
    before = allowed()
    with pytest.raises(RuntimeError, match="stop"), limited_threads(1):
        raise RuntimeError("stop")
    assert allowed() == before
