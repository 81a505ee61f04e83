"""Settings that all models have."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from drapeline.settings import Field, Settings, SkipJsonSchema


class Training(Settings):
    """How long and how fast a network is trained; each model has its own defaults and ranges."""

    epochs: int
    batch: int
    learning_rate: float
    schedule: str
    seed: SkipJsonSchema[int] = Field(0, description="Seed of weights, order and noise.")


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
