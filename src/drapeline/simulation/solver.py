"""What a cloth solver is given, and what it gives back."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from drapeline.outfits.fabrics import Fabric
from drapeline.simulation.attachments import Pins
from drapeline.simulation.attempts import Attempt
from drapeline.simulation.collider import MovingBody


@dataclass(frozen=True)
class ClothGarment:
    """A garment in frame 0: at rest, on the body that it was made for.

    Attributes:
        name: of its type, unique within an outfit.
        vertices: (V, 3) float32 world metres; lengths and angles at rest are those between them.
        faces: (F, 4) or (F, 3) int32, outward.
        edge_length_m: mean length of its edges.
        fabric: what it is made of.
        shrink: (V,) 0-1, share by which elastics shorten the rest lengths at a vertex.
        pins: vertices that are held, none where nothing but friction holds the garment.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    edge_length_m: float
    fabric: Fabric
    shrink: np.ndarray
    pins: Pins


class ClothSolver(Protocol):
    """Moves garments with a body. It knows nothing of attempts, health or files of the dataset.

    A solver lives in a package of its own, with a module that has
    `cloth_solver(threads, accelerator)`, which returns one that takes no more than so many cores,
    and a GPU where "auto" or "gpu" allow it and it can (see docs/how-to/extending.md).
    """

    @property
    def name(self) -> str:
        """What the config calls it."""
        ...

    @property
    def settings(self) -> Mapping[str, Any]:
        """Its own numbers, the same for all garments and attempts, for the record."""
        ...

    def versions(self) -> dict[str, str]:
        """Name -> version of the software that does the work."""
        ...

    def simulate(
        self,
        garments: Sequence[ClothGarment],
        body: MovingBody,
        attempt: Attempt,
        scratch: Path,
    ) -> Iterator[Sequence[np.ndarray]]:
        """Yield the vertices (V, 3) of every garment, world metres, for each frame of the body.

        There are 30 frames per second, the up axis is Z and gravity 9.81 m/s2. The first result is
        the state that was given. Through `attempt.lead_frames` frames the body takes its shape and
        its first pose; they are simulated and thrown away.

        Args:
            garments: from inner to outer; each collides with the body, the others and itself.
            body: what they collide with. It may have holes, as where hands are out of reach, and
                there may be a floor beneath it.
            attempt: how finely, and how far from the body.
            scratch: an empty folder for files, which goes when the attempt ends.

        Raises:
            RuntimeError, ValueError: the solver broke down. Vertices that are not finite need no
                exception: the caller looks for them.
        """
        ...
