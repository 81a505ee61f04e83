"""What models are compared by, and what of theirs can be.

`models.registry` says what else a model brings.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, Protocol

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


class ScanFitter(Protocol):
    """Finds the garments in segmented scans, whose bodies are known by then."""

    def fit(self, scan: SegmentedScan, body: BodyState) -> Mapping[str, Mapping[str, Mesh]]:
        """The garments in a scan, in each of the ways that the model has.

        Returns:
            Variant, which no other model has -> garment type -> posed triangles in the scan's
            world; only garments of the scan that the model knows.
        """
