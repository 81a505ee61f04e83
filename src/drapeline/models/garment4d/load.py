"""Trained stages from the folders that their trainings left."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drapeline.errors import InputError
from drapeline.models.garment4d.canonical_stage import CanonicalStage, PointNetStage
from drapeline.models.garment4d.posed_stage import MgnStage, PosedStage
from drapeline.models.garment4d.stage import Stage
from drapeline.models.training.checkpoints import building, load_state, read_checkpoint
from drapeline.models.training.module import BEST
from drapeline.npy import check_arrays
from drapeline.registration.to_template.garment_space import SPACE_ARRAYS, GarmentSpace

_STAGES: dict[str, type[Stage]] = {
    cls.checkpoint_type: cls for cls in (CanonicalStage, PointNetStage, PosedStage, MgnStage)
}


def load_stage(folder: str | Path, *expected: type[Stage]) -> Any:
    """A trained stage from the folder that its training left, ready to predict.

    Args:
        folder: of the training.
        expected: the stages that it may hold.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another stage.
    """
    path = Path(folder) / BEST
    checkpoint = read_checkpoint(path)
    found = checkpoint.metadata["checkpoint_type"]
    types = [cls.checkpoint_type for cls in expected]
    if found not in types:
        raise InputError(f"{path}: holds a '{found}' network, expected {' or '.join(types)}")
    with building(path):
        stage = _build(checkpoint.metadata)
    load_state(stage, checkpoint, path)
    return stage.eval()


def _build(metadata: Mapping[str, Any]) -> Stage:
    cls = _STAGES[metadata["checkpoint_type"]]
    settings = cls.SETTINGS(**metadata["settings"])
    if "canonical" in metadata:
        return cls(settings, _build(metadata["canonical"]))
    arrays = {key: value.numpy() for key, value in metadata["space"].items()}
    check_arrays(arrays, SPACE_ARRAYS)
    stage = cls(settings, GarmentSpace(**arrays), metadata["label"])
    stage.out_of_fold_alpha = metadata.get("out_of_fold_alpha", {})
    return stage
