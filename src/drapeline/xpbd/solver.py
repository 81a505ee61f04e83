"""The fast cloth solver."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import warp as wp

from drapeline.errors import InputError
from drapeline.geometry.warp_mesh import start_warp
from drapeline.simulation.collider import MovingBody
from drapeline.simulation.solver import Attempt, ClothGarment, ClothSolver
from drapeline.xpbd.stepping import MovingCloth, XpbdSettings


def cloth_solver(threads: int, accelerator: str = "cpu") -> ClothSolver:
    """The fast solver; it takes one core, whatever the number of threads, and a GPU if asked to.

    Raises:
        InputError: there is no GPU, and the accelerator is "gpu".
    """
    if accelerator == "cpu":
        return XpbdCloth()
    start_warp()
    if wp.is_cuda_available():
        return XpbdCloth(device="cuda", parallel=True)
    if accelerator == "gpu":
        raise InputError(
            "simulation.accelerator is gpu, but Warp finds no CUDA device, expected auto or cpu"
        )
    return XpbdCloth()


@dataclass(frozen=True)
class XpbdCloth:
    """Small-step extended position-based dynamics as a `ClothSolver`.

    Attributes:
        method: its settings, the same for all garments and attempts.
        device: Warp's, that the work is done on.
        parallel: whether all constraints of a colour act at once, see `MovingCloth`; on a GPU they
            always do.
    """

    name: ClassVar[str] = "xpbd"

    method: XpbdSettings = field(default_factory=XpbdSettings)
    device: str = "cpu"
    parallel: bool = False

    @property
    def settings(self) -> dict[str, Any]:
        """All numbers of the method, and where and in which order it works."""
        return {**asdict(self.method), "device": self.device, "parallel": self.parallel}

    def versions(self) -> dict[str, str]:
        """Warp's version."""
        return {"warp": wp.config.version}

    def simulate(
        self, garments: Sequence[ClothGarment], body: MovingBody, attempt: Attempt, scratch: Path
    ) -> Iterator[list[np.ndarray]]:
        """Yield the vertices (V, 3) of every garment for each frame; see `ClothSolver`."""
        start_warp()
        cloth = MovingCloth(
            garments, body, attempt, self.method, device=self.device, parallel=self.parallel
        )
        vertices = [garment.vertices for garment in garments]
        for frame in range(1, len(body)):
            cloth.start(frame)
            yield vertices  # which are measured while a GPU is on its way to the next frame
            vertices = cloth.arrive()
        yield vertices
