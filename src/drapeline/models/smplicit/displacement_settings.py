"""Settings of the pose-dependent displacement: from a config or a checkpoint to dataclasses."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drapeline.models.training.module import Training


@dataclass(frozen=True)
class DisplacementNetwork:
    """Sizes of P(p, theta, z_theta).

    Attributes:
        code: numbers of z_theta.
        width: of the hidden layers, as a share of the released decoder's.
    """

    code: int = 128
    width: float = 0.5


@dataclass(frozen=True)
class DisplacementLoss:
    """Losses of SMPLicit 3.5, and what it leaves open.

    Attributes:
        edge: weight of the mean square relative error of edge lengths in the pose.
        latent: weight of the codes' mean square.
        unknown: share of the garments of a step whose code is replaced by zero, so that zero
            comes to stand for a garment that was not trained on.
        pose_dropout: share of the frames of a step whose joints are taken for those of the pose of
            rest, so that points go by their own skinning first of all.
    """

    edge: float = 30.0
    latent: float = 1e-3
    unknown: float = 0.5
    pose_dropout: float = 0.5


@dataclass(frozen=True)
class DisplacementTraining(Training):
    """How a displacement is trained.

    Attributes:
        edges: of the cloth per frame and step, whose ends are its points.
        code_rate: learning rate of the garments' codes, as a multiple of the others'.
    """

    edges: int = 128
    code_rate: float = 5.0


@dataclass(frozen=True)
class DisplacementSettings:
    """Everything that a displacement is built from besides its data."""

    network: DisplacementNetwork = field(default_factory=DisplacementNetwork)
    loss: DisplacementLoss = field(default_factory=DisplacementLoss)
    training: DisplacementTraining = field(default_factory=DisplacementTraining)

    @classmethod
    def of(cls, values: Mapping[str, Mapping[str, Any]]) -> "DisplacementSettings":
        """From nested mappings, as in a config or a checkpoint."""
        return cls(
            DisplacementNetwork(**values["network"]),
            DisplacementLoss(**values["loss"]),
            DisplacementTraining(**values["training"]),
        )
