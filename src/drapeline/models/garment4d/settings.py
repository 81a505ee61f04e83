"""Settings of Garment4D: what a stage is built from, and settings from plain values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from drapeline.errors import InputError
from drapeline.learning_data.sequences import KINDS
from drapeline.models.garment4d.canonical import Abstraction
from drapeline.models.training.module import Training


@dataclass(frozen=True)
class Garment4dTraining(Training):
    """How a network of either stage is trained on windows; numbers of the released code.

    Its batch is that of the canonical stage; the posed stage has 4 there.

    Attributes:
        frames: T of a window.
        stride: frames from one training window to the next.
        sources: of the sequences, of `KINDS`.
    """

    batch: int = 20
    frames: int = 10
    stride: int = 10
    sources: tuple[str, ...] = KINDS


@dataclass(frozen=True)
class SkinningSettings:
    """How proposals get their skinning weights (equation 2).

    Attributes:
        neighbours: K, body vertices that weights are interpolated from.
        passes: of Laplacian smoothing.
        power: of the inverse distance, 1 or 2.
        coincident: "vertex", a body vertex at no distance counts alone; "released", not at all.
    """

    neighbours: int = 256
    passes: int = 100
    power: int = 1
    coincident: str = "vertex"


@dataclass(frozen=True)
class StageSettings:
    """All that a network of a stage is built from besides the garment space.

    Attributes:
        network: sizes.
        loss: weights.
        training: how long, and on what.
        skinning: of proposals, which the posed stage alone has.
    """

    network: Any
    loss: Any
    training: Garment4dTraining = field(default_factory=Garment4dTraining)
    skinning: SkinningSettings = field(default_factory=SkinningSettings)


def parse_settings(cls: type, values: Mapping[str, Any]) -> Any:
    """A settings dataclass from nested mappings and lists as they stand in a config or checkpoint.

    Raises:
        InputError: a name is none of the dataclass's.
    """
    known = [one.name for one in fields(cls)]
    unknown = [name for name in values if name not in known]
    if unknown:
        raise InputError(
            f"{cls.__name__}: no setting '{unknown[0]}', expected one of {', '.join(known)}"
        )
    return cls(**{name: _parse_value(value) for name, value in values.items()})


def _parse_value(value: Any) -> Any:
    """Lists as tuples; the only mappings within settings are abstractions."""
    if isinstance(value, Mapping):
        return parse_settings(Abstraction, value)
    return tuple(map(_parse_value, value)) if isinstance(value, list | tuple) else value
