"""Settings of SMPLicit: from a config or a checkpoint to dataclasses."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drapeline.models.training.module import Training


@dataclass(frozen=True)
class FieldNetwork:
    """Sizes of the decoder and of the image encoder; the decoder's are the released ones.

    Attributes:
        cut: numbers of z_cut.
        style: numbers of z_style.
        width: of the hidden layers, as a share of the released network's.
        encoder_width: channels of the image encoder's first block; 64 is a ResNet-18.
        encoder_weights: file with weights to start the image encoder from; "" starts at random.
    """

    cut: int = 6
    style: int = 12
    width: float = 1.0
    encoder_width: int = 16
    encoder_weights: str = ""


@dataclass(frozen=True)
class FieldLoss:
    """Losses of SMPLicit 3.3.

    Attributes:
        d_max_m: distances are clipped here, metres; 0.01 in the paper.
        latent: lambda_z, the weight of the codes' mean absolute value.
        noise: sigma_n, standard deviation of the noise added to codes.
    """

    d_max_m: float = 0.03
    latent: float = 1e-3
    noise: float = 1e-2


@dataclass(frozen=True)
class FieldTraining(Training):
    """How a field is trained.

    Attributes:
        visits: how often an epoch visits each garment.
        near, space: points per garment and step; see `drapeline.learning_data.garment_fields`.
        optimizer: "muon" for the matrices of the decoder, with Adam for the rest, or "adam".
        query_rate: learning rate of the first query layer, as a share of the others'. Its weights
            for all clusters move alike, so that its steps are larger than they look.
        style_rate: learning rate of the training garments' styles, likewise.
        muon_rate: learning rate of Muon, likewise.
    """

    visits: int = 1
    near: int = 128
    space: int = 64
    optimizer: str = "muon"
    query_rate: float = 0.05
    style_rate: float = 5.0
    muon_rate: float = 20.0


@dataclass(frozen=True)
class FieldSettings:
    """Everything that a model of SMPLicit is built from besides its data."""

    network: FieldNetwork = field(default_factory=FieldNetwork)
    loss: FieldLoss = field(default_factory=FieldLoss)
    training: FieldTraining = field(default_factory=FieldTraining)

    @classmethod
    def of(cls, values: Mapping[str, Mapping[str, Any]]) -> "FieldSettings":
        """From nested mappings, as in a config or a checkpoint."""
        return cls(
            FieldNetwork(**values["network"]),
            FieldLoss(**values["loss"]),
            FieldTraining(**values["training"]),
        )
