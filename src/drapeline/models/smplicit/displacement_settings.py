"""Settings of pose displacements."""

from typing import Annotated, Literal

from drapeline.models.training.settings import Training
from drapeline.settings import Field, Settings

_Weight = Annotated[float, Field(ge=0, le=1000)]
_RateShare = Annotated[float, Field(ge=0, le=10_000)]


class DisplacementNetwork(Settings):
    """Sizes of the network."""

    code: int = Field(128, ge=1, le=512, description="Numbers of z_theta.")
    width: float = Field(
        0.5,
        gt=0,
        le=8,
        description=(
            "Factor on the sizes of the hidden layers, which are those of the decoder of distances."
        ),
    )


class DisplacementLoss(Settings):
    """Losses beside the displacements themselves."""

    edge: float = Field(
        30,
        ge=0,
        le=1000,
        description=(
            "Weight of the mean square relative error of edge lengths in the pose. Smooth "
            "displacements cannot fold cloth, and shrink it without this."
        ),
    )
    latent: float = Field(0.001, ge=0, le=1000, description="Weight of the codes' mean square.")
    unknown: float = Field(
        0.5,
        ge=0,
        le=1,
        description=(
            "Share of the garments of a step whose code is replaced by zero, which comes to stand "
            "for garments that were not trained on."
        ),
    )
    pose_dropout: float = Field(
        0.5,
        ge=0,
        le=1,
        description=(
            "Share of the frames of a step whose joints are taken for those of the pose of rest, "
            "so that points go by their own skinning first of all. With one, other joints do not "
            "count."
        ),
    )


class DisplacementTraining(Training):
    """How a displacement is trained."""

    epochs: int = Field(
        20,
        ge=1,
        le=10_000_000,
        description="Passes over the training frames; schedules are relative to this number.",
    )
    batch: int = Field(8, ge=2, le=4096, description="Frames of garments per step.")
    edges: int = Field(
        128,
        ge=1,
        le=100_000,
        description="Edges of the cloth per frame, whose ends are the points that are learned.",
    )
    learning_rate: float = Field(0.001, gt=0, le=1, description="Learning rate of Adam.")
    schedule: Literal["constant", "late_decay", "one_cycle"] = Field(
        "one_cycle", description="Schedule of the learning rates."
    )
    code_rate: float = Field(
        5,
        ge=0,
        le=10_000,
        description="Learning rate of the garments' codes as a multiple of learning_rate.",
    )


class DisplacementSettings(Settings):
    """Everything that a displacement is built from besides its data."""

    network: DisplacementNetwork = DisplacementNetwork()
    loss: DisplacementLoss = DisplacementLoss()
    training: DisplacementTraining = DisplacementTraining()


class Displacement(DisplacementSettings):
    """What poses do to garments beside the skinning, learned from simulated samples; `snakemake
    smplicit_displacement` makes it.
    """

    in_all: bool = Field(
        False,
        description="Whether `snakemake` without a target trains and evaluates displacements too.",
    )
    frame_step: int = Field(
        2,
        ge=1,
        le=300,
        description="Frames from one that is learned from to the next in a simulated sample.",
    )
    evaluated_frame_step: int = Field(
        10,
        ge=1,
        le=300,
        description="Frames from one that is evaluated to the next in a held-out sample.",
    )
