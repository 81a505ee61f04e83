"""The parts of Lightning that trainings use, without what its import loads and never calls.

Lightning imports TorchMetrics for the base class of its metrics, and TorchMetrics imports SciPy's
signal processing and Matplotlib wherever they are installed, for metrics of sound and plots that no
training has. Together they take a third of a short training's start.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from lightning_utilities.core import imports

_UNUSED = ("scipy", "matplotlib")


@contextmanager
def _taken_for_missing(names: tuple[str, ...]) -> Iterator[None]:
    """TorchMetrics asks these two whether an optional package is installed."""
    installed, met = imports.package_available, imports.RequirementCache.__bool__

    def package_available(name: str) -> bool:
        return name not in names and installed(name)

    def requirement_met(self: Any) -> bool:
        return self.requirement not in names and met(self)

    imports.package_available = package_available
    imports.RequirementCache.__bool__ = requirement_met
    try:
        yield
    finally:
        imports.package_available, imports.RequirementCache.__bool__ = installed, met


with _taken_for_missing(_UNUSED):
    from pytorch_lightning import Callback, LightningModule, Trainer
    from pytorch_lightning.callbacks import ModelCheckpoint, TQDMProgressBar
    from pytorch_lightning.loggers import TensorBoardLogger
    from pytorch_lightning.plugins import TorchCheckpointIO
    from pytorch_lightning.plugins.environments import LightningEnvironment

__all__ = [
    "Callback",
    "LightningEnvironment",
    "LightningModule",
    "ModelCheckpoint",
    "TQDMProgressBar",
    "TensorBoardLogger",
    "TorchCheckpointIO",
    "Trainer",
]
