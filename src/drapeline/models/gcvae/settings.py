"""Settings of the garment VAEs: from a config or a checkpoint to dataclasses."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drapeline.models.gcvae.loss import GcvaeLoss
from drapeline.models.gcvae.networks import GcvaeNetwork
from drapeline.models.training.module import Training


@dataclass(frozen=True)
class GcvaeTraining(Training):
    """How a garment VAE is trained; the numbers are CLOTH3D's where it prints any.

    Attributes:
        normal_parts: faces are split into so many parts; each step compares the normals of one.
        mask: whether the decoder predicts the mask.
        version: what a DVAE's offsets are measured from: "posed", the posed body, or "unposed",
            the static garment. An SVAE has "rest".
    """

    normal_parts: int = 4
    mask: bool = True
    version: str = "rest"


@dataclass(frozen=True)
class VaeSettings:
    """Everything that a garment VAE is built from besides its body template."""

    network: GcvaeNetwork = field(default_factory=GcvaeNetwork)
    loss: GcvaeLoss = field(default_factory=GcvaeLoss)
    training: GcvaeTraining = field(default_factory=GcvaeTraining)

    @classmethod
    def of(cls, values: Mapping[str, Mapping[str, Any]]) -> "VaeSettings":
        """From nested mappings, as in a config or a checkpoint."""
        network = {k: tuple(v) if k == "widths" else v for k, v in values["network"].items()}
        return cls(
            GcvaeNetwork(**network),
            GcvaeLoss(**values["loss"]),
            GcvaeTraining(**values["training"]),
        )
