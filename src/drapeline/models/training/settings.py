"""Settings that all models have."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from drapeline.settings import Field, Settings, SkipJsonSchema


class Training(Settings):
    """How long and how fast a network is trained; each model has its own defaults and ranges."""

    batch: int
    learning_rate: float
    schedule: str
    seed: SkipJsonSchema[int] = Field(0, description="Seed of weights, order and noise.")

    @abstractmethod
    def epochs_of(self, batches: int) -> int:
        """Epochs to train for, given that one has so many batches."""


class EpochTraining(Training):
    """A training whose length is told in passes over its rows."""

    epochs: int

    def epochs_of(self, batches: int) -> int:
        """As many as were asked for."""
        return self.epochs


class StepTraining(Training):
    """A training whose length is told in steps, and does not depend on how many rows it has."""

    steps: int

    def epochs_of(self, batches: int) -> int:
        """The number of whole passes that is nearest to the steps, at least one."""
        return max(1, round(self.steps / batches))


class Trainer(Settings):
    """Options of Lightning's Trainer."""

    accelerator: Literal["auto", "cpu", "gpu"] = Field("auto", description="Device to train on.")
    devices: Literal["auto", -1] | Annotated[int, Field(ge=1)] = Field(
        1, description="Number of devices; auto and -1 take all. Each sees its own batches."
    )
    precision: Literal["32-true", "bf16-mixed", "16-mixed"] = Field(
        "32-true", description="Floating-point precision."
    )
    strategy: Literal["auto", "ddp"] = Field(
        "auto", description="How several devices share the work."
    )


def override_settings(
    settings: Mapping[str, Mapping[str, Any]], changes: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Settings, group -> name -> value, with some of them replaced; other groups are ignored."""
    return {group: {**values, **changes.get(group, {})} for group, values in settings.items()}
