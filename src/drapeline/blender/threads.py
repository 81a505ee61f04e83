"""How many cores Blender's solvers take."""

import ctypes
import logging
import os

import bpy  # noqa: F401 - brings oneTBB into the process

LOGGER = logging.getLogger("drapeline")
# oneTBB's own entry points; Blender's setting for threads covers rendering only.
_CREATE = "_ZN3tbb6detail2r16createERNS0_2d114global_controlE"
_DESTROY = "_ZN3tbb6detail2r17destroyERNS0_2d114global_controlE"
_MAX_PARALLELISM = 0


class _GlobalControl(ctypes.Structure):
    """oneTBB's `tbb::global_control`."""

    _fields_ = (
        ("value", ctypes.c_size_t),
        ("reserved", ctypes.c_ssize_t),
        ("parameter", ctypes.c_int),
    )


class limited_threads:
    """Context in which Blender uses at most `threads` cores.

    Cloth would otherwise take all of the machine's for a gain of a third, and jobs side by side
    would fight for them. Where `bpy` does not bring oneTBB, nothing is limited and the log
    says so.
    """

    def __init__(self, threads: int) -> None:
        """Name the limit."""
        self._control = _GlobalControl(threads, 0, _MAX_PARALLELISM)
        self._library: ctypes.CDLL | None = None

    def __enter__(self) -> None:
        try:
            library = ctypes.CDLL("libtbb.so.12", mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
        except OSError:
            LOGGER.warning("oneTBB is not in bpy: Blender takes all cores")
            return
        self._library = library
        getattr(library, _CREATE)(ctypes.byref(self._control))

    def __exit__(self, *exception: object) -> None:
        if self._library is not None:
            getattr(self._library, _DESTROY)(ctypes.byref(self._control))
