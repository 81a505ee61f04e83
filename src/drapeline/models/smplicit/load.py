"""Models before their training, and from the folders that trainings left."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from drapeline.bodies.model import BodyModel
from drapeline.errors import InputError
from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.smplicit.clusters import BASIS_ROWS, cluster_basis
from drapeline.models.smplicit.network import GarmentField
from drapeline.models.smplicit.settings import FieldSettings
from drapeline.models.smplicit.variants import FIELD_MODELS
from drapeline.models.training.checkpoints import load_network
from drapeline.models.training.module import BEST


def load_field(folder: str | Path) -> GarmentField:
    """A trained model, ready to predict.

    Args:
        folder: of the training.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another model.
    """

    def build(metadata: Mapping[str, Any]) -> GarmentField:
        name = metadata["name"]
        if name not in list(FIELD_MODELS):
            raise InputError(
                f"the model is named {name!r:.100}, expected {' or '.join(FIELD_MODELS)}"
            )
        settings = FieldSettings(**metadata["settings"])
        basis = torch.zeros(BASIS_ROWS, metadata["clusters"], 3)
        return GarmentField(name, settings, basis, metadata["rows"], start=False)

    return load_network(Path(folder) / BEST, GarmentField.checkpoint_type, build)


def new_field(
    name: str, data: FieldData, bodies: Mapping[str, BodyModel], settings: FieldSettings
) -> GarmentField:
    """An untrained model.

    Args:
        name: of `FIELD_MODELS`.
        data: of its garments.
        bodies: by gender.
        settings: sizes, losses and training.
    """
    return GarmentField(name, settings, cluster_basis(bodies, data.clusters), len(data))
