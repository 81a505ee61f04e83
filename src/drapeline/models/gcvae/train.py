"""Whole trainings: from data and settings to a finished folder."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from drapeline.models.gcvae.body_template import BodyTemplate
from drapeline.models.gcvae.conditioning_training import load_conditioning
from drapeline.models.gcvae.ppca_vae import LinearDynamicVae, LinearVae
from drapeline.models.gcvae.vae import DynamicVae, GarmentVae, StaticVae, VaeSettings
from drapeline.models.training.batches import GarmentData, Garments
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.digests import tensors_digest
from drapeline.models.training.lightning import fit
from drapeline.models.training.module import BEST, plain

MODELS: dict[str, type[GarmentVae]] = {
    "gcvae": StaticVae,
    "linear": LinearVae,
    "dynamic": DynamicVae,
    "linear_dynamic": LinearDynamicVae,
}


def train_vae(
    folder: str | Path,
    garments: Garments,
    body_template: BodyTemplate,
    settings: VaeSettings,
    *,
    conditioning: str | Path | None,
    code: str,
    progress: str | Path,
    trainer: dict[str, Any],
    threads: int,
) -> None:
    """Train a garment VAE and leave a folder as `fit` does; see there for the arguments.

    Args:
        conditioning: folder of the trained conditioning autoencoder, for networks that have one.
        code: digest of the code; a training is taken up again by the same code alone.
    """
    training = settings.training
    about = {
        **plain(asdict(settings)),
        "body_template": tensors_digest(body_template.tensors()),
        "code": code,
    }
    model = MODELS[training.model](settings, body_template)
    if hasattr(model, "conditioning"):
        path = Path(conditioning) / BEST
        load_conditioning(read_checkpoint(path), model.conditioning, path)
        about["conditioning"] = tensors_digest(model.conditioning.state_dict())
    model.prepare(garments)
    fit(
        model,
        GarmentData(garments, batch=training.batch, seed=training.seed),
        folder,
        progress=progress,
        epochs=training.epochs,
        monitor="val_selection",
        settings=about,
        trainer=trainer,
        threads=threads,
    )
