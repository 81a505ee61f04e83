"""Trained stages from the folders that their trainings left."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drapeline.errors import InputError
from drapeline.models.garment4d.canonical_stage import CanonicalStage, PointNetStage
from drapeline.models.garment4d.posed_stage import MgnStage, PosedStage
from drapeline.models.garment4d.stage import Stage
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST
from drapeline.registration.to_template.garment_space import GarmentSpace

_KINDS: dict[str, type[Stage]] = {
    cls.kind: cls for cls in (CanonicalStage, PointNetStage, PosedStage, MgnStage)
}


def load_stage(folder: str | Path, *kinds: type[Stage]) -> Any:
    """A trained stage from the folder that its training left, ready to predict.

    Args:
        folder: of the training.
        kinds: what it may be.

    Raises:
        InputError: the checkpoint is missing, damaged, or of another kind.
    """
    path = Path(folder) / BEST
    checkpoint = read_checkpoint(path)
    about = checkpoint["drapeline"]
    wanted = [cls.kind for cls in kinds]
    if about["kind"] not in wanted:
        raise InputError(
            f"{path}: holds a '{about['kind']}' network, expected {' or '.join(wanted)}"
        )
    stage = _built(about)
    stage.load_state_dict(checkpoint["state_dict"])
    return stage.eval()


def _built(about: Mapping[str, Any]) -> Stage:
    cls = _KINDS[about["kind"]]
    settings = cls.settings_of(about["settings"])
    if "canonical" in about:
        return cls(settings, _built(about["canonical"]))
    space = GarmentSpace(**{key: value.numpy() for key, value in about["space"].items()})
    stage = cls(settings, space, about["label"])
    stage.out_of_fold_alpha = about.get("out_of_fold_alpha", {})
    return stage
