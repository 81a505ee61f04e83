"""Trained models, ready to be used without the data that they were trained on.

    skirts = drapeline.load("gcvae").sample(8, "Skirt")  # a model that comes with drapeline
    skirts = drapeline.load("results/gcvae/svae").sample(8, "Skirt")
    moving = drapeline.load("results/garment4d/Skirt").reconstruct(points, poses, shape)
    upper = drapeline.load("results/smplicit/upper")
    garment = upper.decode(upper.mean_code, gender="female", shape=[0.0] * 10)

docs/reference/api.md shows more of it. Loading executes nothing that is in the files.
"""

from pathlib import Path
from typing import Any

from drapeline.errors import InputError
from drapeline.job import resolve
from drapeline.models.registry import models
from drapeline.models.start import package_root
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST

_USED = "ours"  # the one to use of the models of a garment type, in its folder


def packaged(name: str) -> Path:
    """The folder of a model that comes with drapeline.

    Raises:
        InputError: there is none of that name.
    """
    root = package_root()
    names = sorted(path.parent.relative_to(root).as_posix() for path in root.rglob(BEST))
    if name not in names:
        known = f"or one of {', '.join(names)}" if names else "and this copy comes with no models"
        raise InputError(f"{name}: no such folder, expected that of a trained model, {known}")
    return root / name


def load(folder: str | Path) -> Any:
    """A trained model from the folder that its rule left.

    Args:
        folder: name of a model that comes with drapeline, "gcvae", "labels", or such as
            "garment4d/Skirt"; or the folder of a model of garments at rest, such as
            `results/gcvae/svae`; of a garment type of Garment4D, such as `results/garment4d/Skirt`
            for our model, or the paper's networks in its folder `posed`; of labels,
            `results/garment4d/labels`; or of SMPLicit, such as `results/smplicit/upper`.

    Returns:
        A `StaticModel` with `sample`, `encode` and `decode`, a `ReconstructionModel` with
        `reconstruct`, a `LabelModel` with `label`, or SMPLicit's `SmplicitModel` with `field` and
        `decode`.

    Raises:
        InputError: a file is missing or damaged, or the model is of another kind.
    """
    folder = Path(folder) if Path(folder).is_dir() else packaged(str(folder))
    if (folder / _USED).is_dir() and not (folder / BEST).is_file():
        folder = folder / _USED
    path = folder / BEST
    kind = read_checkpoint(path).metadata["checkpoint_type"]
    loaders = {
        name: loader for model in models().values() for name, loader in model.loaders.items()
    }
    if kind not in loaders:
        raise InputError(f"{path}: holds a '{kind}' network, expected {' or '.join(loaders)}")
    return resolve(loaders[kind])(folder)
