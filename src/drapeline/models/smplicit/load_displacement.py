"""Displacements before their training, and from the folders that trainings left."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from drapeline.bodies.model import BodyModel
from drapeline.learning_data.pose_displacements import DisplacementData
from drapeline.models.smplicit.clusters import BASIS_ROWS, cluster_basis
from drapeline.models.smplicit.displacement_network import DisplacementField
from drapeline.models.smplicit.displacement_settings import DisplacementSettings
from drapeline.models.training.checkpoints import load_network
from drapeline.models.training.module import BEST


def load_displacement(folder: str | Path) -> DisplacementField:
    """A trained network, ready to predict.

    Args:
        folder: of the training.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another model.
    """

    def build(metadata: Mapping[str, Any]) -> DisplacementField:
        settings = DisplacementSettings(**metadata["settings"])
        basis = torch.zeros(BASIS_ROWS, metadata["clusters"], 3)
        return DisplacementField(metadata["name"], settings, basis, metadata["garments"])

    return load_network(Path(folder) / BEST, DisplacementField.checkpoint_type, build)


def new_displacement(
    name: str,
    data: DisplacementData,
    bodies: Mapping[str, BodyModel],
    clusters: np.ndarray,
    settings: DisplacementSettings,
) -> DisplacementField:
    """An untrained network.

    Args:
        name: of `FIELD_MODELS`.
        data: of its garments.
        bodies: by gender.
        clusters: (K,) ids of the bodies' vertices.
        settings: sizes, losses and training.
    """
    return DisplacementField(name, settings, cluster_basis(bodies, clusters), len(data.garment))
