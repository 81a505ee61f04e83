"""Whole trainings: from data and settings to a finished folder."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from drapeline.nets.checkpoints import read_checkpoint
from drapeline.nets.conditioning_training import load_conditioning
from drapeline.nets.digests import tensors_digest
from drapeline.nets.domain import Domain
from drapeline.nets.fitting import fit
from drapeline.nets.gcvae_data import GarmentData, Garments
from drapeline.nets.gcvae_training import DynamicVae, GarmentVae, StaticVae, VaeSettings
from drapeline.nets.linear_vae import LinearDynamicVae, LinearVae
from drapeline.nets.trained import BEST, plain

MODELS: dict[str, type[GarmentVae]] = {
    "gcvae": StaticVae,
    "linear": LinearVae,
    "dynamic": DynamicVae,
    "linear_dynamic": LinearDynamicVae,
}


def train_vae(
    folder: str | Path,
    garments: Garments,
    domain: Domain,
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
        "domain": tensors_digest(domain.tensors()),
        "code": code,
    }
    model = MODELS[training.model](settings, domain)
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
