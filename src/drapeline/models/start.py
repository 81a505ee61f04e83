"""What trainings begin with: random weights, or those of models that come with drapeline.

For planning, so it imports little.
"""

from collections.abc import Mapping
from importlib.resources import files as package_files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drapeline.storage import read_json

if TYPE_CHECKING:
    from drapeline.experiment.files import ExperimentFiles

PACKAGE = "package"
ABOUT = "about.json"  # of the folder of models, beside them
AT_RANDOM = {"folder": "", "reason": ""}  # where nothing else is asked for
# seed: of the experiment that they were trained in. clips, samples: of its training split.
_ABOUT = {"seed": int, "clips": [str], "samples": [str]}


def package_root() -> Path:
    """Folder of the models that come with drapeline."""
    return Path(str(package_files("drapeline"))) / "weights"


def start_of(files: "ExperimentFiles", name: str) -> dict[str, str]:
    """What a training begins with.

    Nothing that the experiment chooses by or tests on may have been learned from before.

    Args:
        name: of the model that comes with drapeline.

    Returns:
        The `folder` of that model, or none and the `reason`; nothing of both where the experiment
        does not ask for it.
    """
    if files.config["init"] != PACKAGE:
        return dict(AT_RANDOM)
    root = package_root()
    if not (root / name).is_dir():
        return {"folder": "", "reason": f"no {name} comes with drapeline"}
    reason = _overlap(files, read_json(root / ABOUT, _ABOUT))
    return {"folder": "" if reason else str(root / name), "reason": reason}


def _overlap(files: "ExperimentFiles", learned: Mapping[str, Any]) -> str:
    """What is held out here and was learned from there, in words; nothing if there is nothing."""
    held_out = [
        plan
        for plan in (*files.moving_plans.values(), *files.resting_plans.values())
        if plan.split != "train"
    ]
    clips = sorted({plan.sequence for plan in held_out} & set(learned["clips"]))
    if clips:
        return f"it has learned from the clip {clips[0]}, which is held out here"
    samples = sorted({plan.sample for plan in held_out} & set(learned["samples"]))
    if samples and files.config["seed"] == learned["seed"]:
        return (
            f"it has learned from the sample {samples[0]} of this seed, which is held out here;"
            " another seed would do"
        )
    return ""
