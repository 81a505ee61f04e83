"""What models are compared by, and what of theirs can be.

`models.registry` says what else a model brings.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from time import process_time
from typing import NamedTuple, Protocol

import numpy as np

from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.segmented_scans import SegmentedScan
from drapeline.geometry.mesh import Mesh


class HeldOutGarment(NamedTuple):
    """A static garment that no model was trained on."""

    row: int  # its row in the static dataset
    outfit: str  # name of its outfit
    garment: str  # its type, one of `GARMENTS`
    mesh: Mesh  # as it was made, before any registration: triangles, root-relative metres


class Representation(Protocol):
    """A way to hold a garment, such as a code, from which its mesh can be rebuilt.

    Attributes:
        variant: names the representation in the table of metrics; no other model has the name.
    """

    variant: str

    def rebuild(self, garments: Sequence[HeldOutGarment]) -> Iterator[Mesh]:
        """Hold each garment in this way and give it back, in the same frame.

        Returns:
            A triangle mesh per garment, in any topology; without faces if nothing is left of it,
            which leaves the garment out of the means.
        """

    def code_numbers(self, garment: str) -> int | None:
        """Size of the code of a garment of this type; None if there is no code."""


class Stopwatch:
    """Time that variants take, in seconds of a core.

    Attributes:
        seconds: variant -> its time since the last `reset`.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)

    def reset(self) -> None:
        """Begin anew."""
        self.seconds.clear()

    @contextmanager
    def of(self, *variants: str) -> Iterator[None]:
        """Count the time within for each of these, which share what is done."""
        start = process_time()
        yield
        seconds = process_time() - start
        for variant in variants:
            self.seconds[variant] += seconds


class MovingPerson(NamedTuple):
    """A dressed person up to a frame, as those are told who are to say where the cloth is."""

    sample: str  # its id
    gender: str
    shape: np.ndarray  # (10,)
    poses: np.ndarray  # (F, 72) rad, the frame's own last
    trans: np.ndarray  # (F, 3) of the root joint, metres above the floor
    rest: Mapping[str, Mesh]  # garment -> triangles at rest, from the innermost to the outermost
    tightness: np.ndarray | None = None  # (2,) of the outfit as CLOTH3D draws it, where it is known


class Mover(Protocol):
    """Moves true garments at rest by the motion of their wearer.

    Attributes:
        watch: counts what each variant takes.
    """

    watch: Stopwatch

    def move(self, person: MovingPerson) -> Mapping[str, Mapping[str, Mesh]]:
        """The garments in the last frame, in each of the ways that the model has.

        Returns:
            Variant, which no other model has -> garment type -> triangles, relative to the root
            joint; only garments that the model knows.
        """


class ScanFitter(Protocol):
    """Finds the garments in segmented scans, whose bodies are known by then.

    Attributes:
        watch: counts what each variant takes.
    """

    watch: Stopwatch

    def fit(self, scan: SegmentedScan, body: BodyState) -> Mapping[str, Mapping[str, Mesh]]:
        """The garments in a scan, in each of the ways that the model has.

        Returns:
            Variant, which no other model has -> garment type -> posed triangles in the scan's
            world; only garments of the scan that the model knows.
        """
