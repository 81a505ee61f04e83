"""Train a garment VAE: from data and settings to a finished folder."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from drapeline.models.gcvae.codec import Garments
from drapeline.models.gcvae.conditioning import load_conditioning
from drapeline.models.gcvae.vae import GarmentVae
from drapeline.models.training.batches import TrainingBatches
from drapeline.models.training.checkpoints import read_checkpoint, tensors_digest
from drapeline.models.training.lightning import fit
from drapeline.models.training.module import BEST


def train_vae(
    folder: str | Path,
    model: GarmentVae,
    garments: Garments,
    *,
    conditioning: str | Path,
    code: str,
    progress: str | Path,
    trainer: dict[str, Any],
    threads: int,
    complete: Callable[[Path], None] | None = None,
) -> None:
    """Train a garment VAE and leave a folder as `fit` does.

    Args:
        folder, progress, trainer, threads, complete: see `fit`.
        model: untrained.
        garments: of training and validation rows.
        conditioning: folder of the trained conditioning autoencoder.
        code: digest of the code; only the same code resumes a training.

    Raises:
        InputError: a checkpoint is unusable, or an offset or the loss is not finite.
    """
    training = model.settings.training
    about = {
        "checkpoint_type": model.checkpoint_type,
        **model.settings.plain(),
        "body_template": tensors_digest(model.body_template.tensors()),
        "code": code,
    }
    path = Path(conditioning) / BEST
    load_conditioning(read_checkpoint(path), model.conditioning, path)
    about["conditioning"] = tensors_digest(model.conditioning.state_dict())
    model.prepare(garments)
    fit(
        model,
        TrainingBatches(garments, batch=training.batch, seed=training.seed),
        folder,
        progress=progress,
        epochs=training.epochs,
        monitor="val_selection",
        settings=about,
        trainer=trainer,
        threads=threads,
        complete=complete,
    )
