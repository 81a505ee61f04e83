"""Trainings of a garment VAE and of its conditioning, from data and settings to a folder."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch

from drapeline.bodies.model import load_bodies
from drapeline.errors import InputError
from drapeline.job import Job
from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.data import (
    BodyTemplate,
    DynamicGarments,
    Garments,
    cvar_statistics,
    dynamic_body_template,
    static_body_template,
)
from drapeline.models.gcvae.load import load_dynamic_garments, save_static_files
from drapeline.models.gcvae.networks import ConditioningAutoencoder
from drapeline.models.gcvae.ppca import DynamicPpca, StaticPpca, save_fit
from drapeline.models.gcvae.settings import (
    ConditioningSettings,
    DvaeSettings,
    PpcaSettings,
    VaeSettings,
    WrinkleMlpSettings,
)
from drapeline.models.gcvae.vae import DynamicVae, GarmentVae, StaticVae
from drapeline.models.gcvae.wrinkle_mlp import CodeRows, WrinkleMlp
from drapeline.models.training.batches import Batch, TrainingBatches, refuse_unfinite
from drapeline.models.training.checkpoints import Checkpoint, read_checkpoint, tensors_digest
from drapeline.models.training.lightning import TrainingRun, fit
from drapeline.models.training.module import BEST, TrainableModule
from drapeline.registration.to_body.hierarchy import load_hierarchy
from drapeline.registration.to_body.topology import Topology, load_topology
from drapeline.seeding import rng_for


class Conditions(Protocol):
    """Rows of a dataset with their conditions."""

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split."""

    def cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, C)."""

    def names(self, rows: np.ndarray) -> list[str]:
        """Names of rows, for messages."""


class ConditionRows:
    """Conditions as rows to train on, without their garments."""

    def __init__(self, conditions: Conditions) -> None:
        self.rows, self._conditions = conditions.rows, conditions

    def batch(self, rows: np.ndarray) -> Batch:
        """`cvar` (B, C) float32 and `names`."""
        cvar = self._conditions.cvar(rows).astype(np.float32)
        return {"cvar": cvar, "names": self._conditions.names(rows)}


class ConditioningTraining(TrainableModule):
    """The autoencoder Gamma with its L1 loss, given the training rows' mean and std (C,)."""

    checkpoint_type = "conditioning"

    def __init__(self, settings: ConditioningSettings, mean: np.ndarray, std: np.ndarray) -> None:
        super().__init__()
        self.settings = settings
        rng = rng_for(settings.training.seed, "conditioning")
        self.autoencoder = ConditioningAutoencoder(
            len(mean),
            2 * settings.condition,
            settings.condition,
            mean=torch.from_numpy(mean),
            std=torch.from_numpy(std),
            rng=torch.Generator().manual_seed(int(rng.integers(2**62))),
        )

    def training_step(self, batch: Batch) -> torch.Tensor:
        """L1 of the reconstruction."""
        loss = self.autoencoder.loss(batch["cvar"])
        self.stop_if_unfinite(loss, {"reconstruction": loss}, batch["names"])
        self.log_means("train", {"loss": loss}, len(batch["cvar"]))
        return loss

    def validation_step(self, batch: Batch) -> None:
        """The same on validation rows."""
        loss = self.autoencoder.loss(batch["cvar"])
        self.log_means("val", {"loss": loss}, len(batch["cvar"]))

    def checkpoint_metadata(self) -> dict[str, Any]:
        """Type and settings; the statistics are among the weights."""
        return {"checkpoint_type": self.checkpoint_type, "settings": self.settings.plain()}


def train_conditioning(
    conditions: Conditions, settings: ConditioningSettings, run: TrainingRun
) -> None:
    """Train on the training rows and leave a folder as `fit` does.

    Raises:
        InputError: a condition, or later the loss, is not finite; names the samples.
    """
    rows, training = conditions.rows("train"), settings.training
    cvar = conditions.cvar(rows)
    refuse_unfinite(cvar, conditions.names(rows), "conditions")
    mean, std = cvar_statistics(cvar)
    fit(
        ConditioningTraining(settings, mean, std),
        TrainingBatches(ConditionRows(conditions), batch=training.batch, seed=training.seed),
        run,
        monitor="val_loss",
        settings={**settings.plain(), "mean": mean.tolist(), "std": std.tolist()},
    )


def load_conditioning(checkpoint: Checkpoint, into: ConditioningAutoencoder, path: Path) -> None:
    """Copy trained weights into an autoencoder.

    Args:
        checkpoint: as `train_conditioning` leaves it.
        into: gets the weights.
        path: of the checkpoint, for messages.

    Raises:
        InputError: the checkpoint is of another network or another size.
    """
    prefix = "autoencoder."
    state = {
        key.removeprefix(prefix): value
        for key, value in checkpoint.weights.items()
        if key.startswith(prefix)
    }
    try:
        into.load_state_dict(state)
    except RuntimeError as error:
        raise InputError(
            f"{path}: holds a conditioning network of another size than the settings ask for"
            f" ({str(error).splitlines()[-1].strip()})"
        ) from error


def train_vae(
    model: GarmentVae,
    garments: Garments,
    conditioning: str | Path,
    run: TrainingRun,
    complete: Callable[[Path], None] | None = None,
) -> None:
    """Train a garment VAE and leave a folder as `fit` does.

    Args:
        garments: of training and validation rows.
        conditioning: folder of the trained conditioning autoencoder.
        complete: see `fit`.

    Raises:
        InputError: a checkpoint is unusable, or the loss is not finite.
    """
    training = model.settings.training
    about = {
        "checkpoint_type": model.checkpoint_type,
        **model.settings.plain(),
        "body_template": tensors_digest(model.body_template.tensors()),
    }
    path = Path(conditioning) / BEST
    load_conditioning(read_checkpoint(path), model.conditioning, path)
    about["conditioning"] = tensors_digest(model.conditioning.state_dict())
    fit(
        model,
        TrainingBatches(garments, batch=training.batch, seed=training.seed),
        run,
        monitor="val_selection",
        settings=about,
        complete=complete,
    )


def train_svae_conditioning(job: Job) -> None:
    """The autoencoder of the conditions of garments in rest pose."""
    settings = ConditioningSettings(**job.params.settings)
    train_conditioning(StaticData(job.input.data), settings, TrainingRun.of(job))


def train_dvae_conditioning(job: Job) -> None:
    """The autoencoder of the conditions of garments in motion."""
    garments = load_dynamic_garments(job.input.data, job.input.static, job.params.frames)
    train_conditioning(garments, ConditioningSettings(**job.params.settings), TrainingRun.of(job))


def train_svae(job: Job) -> None:
    """The paper's VAE of garments in rest pose, in one of its variants."""
    settings = VaeSettings(**job.params.settings)
    of_each = settings.network.topology_moments
    garments, topology, template = _static_garments(job, of_each=of_each)
    model = StaticVae(settings, template)
    train_vae(
        model,
        garments,
        job.input.conditioning,
        TrainingRun.of(job),
        lambda made: save_static_files(made, model, garments, topology),
    )


def train_dvae(job: Job) -> None:
    """The paper's VAE of garments in motion, in one of its variants."""
    settings = DvaeSettings(**job.params.settings)
    garments, template = _dynamic_garments(job, of_each=settings.network.topology_moments)
    model = DynamicVae(settings, template)
    train_vae(model, garments, job.input.conditioning, TrainingRun.of(job))


def train_wrinkle_mlp(job: Job) -> None:
    """Masked probabilistic PCA of garments in motion, and the network that predicts its codes."""
    torch.set_num_threads(job.threads)
    settings = WrinkleMlpSettings(**job.params.settings)
    garments, template = _dynamic_garments(job)
    model = WrinkleMlp(settings, template)
    model.fit(garments)
    rows, training = CodeRows(model, garments), settings.training
    model.prepare(rows.batch(rows.rows("train"))["cvar"])
    fit(
        model,
        TrainingBatches(rows, batch=training.batch, seed=training.seed),
        TrainingRun.of(job),
        monitor="val_loss",
        settings={
            "checkpoint_type": model.checkpoint_type,
            **settings.plain(),
            "constants": asdict(model.constants),
            "begun_with": tensors_digest(model.state_dict()),
        },
    )


def fit_static_ppca(job: Job) -> None:
    """Masked probabilistic PCA of garments in rest pose."""
    torch.set_num_threads(job.threads)
    garments, topology, template = _static_garments(job)
    model = StaticPpca(PpcaSettings(**job.params.settings), template)
    model.fit(garments)
    save_fit(job.output[0], model, lambda made: save_static_files(made, model, garments, topology))


def fit_dynamic_ppca(job: Job) -> None:
    """Masked probabilistic PCA of garments in motion."""
    torch.set_num_threads(job.threads)
    garments, template = _dynamic_garments(job)
    model = DynamicPpca(PpcaSettings(**job.params.settings), template)
    model.fit(garments)
    save_fit(job.output[0], model)


def _static_garments(
    job: Job, *, of_each: bool = True
) -> tuple[StaticData, Topology, BodyTemplate]:
    given = job.input
    garments, topology = StaticData(given.data), load_topology(given.topology)
    hierarchy, bodies = load_hierarchy(given.hierarchy), load_bodies(given)
    template = static_body_template(garments, topology, hierarchy, bodies, of_each=of_each)
    return garments, topology, template


def _dynamic_garments(job: Job, *, of_each: bool = True) -> tuple[DynamicGarments, BodyTemplate]:
    given = job.input
    garments = load_dynamic_garments(given.data, given.static, job.params.frames)
    topology, hierarchy = load_topology(given.topology), load_hierarchy(given.hierarchy)
    bodies = load_bodies(given)
    return garments, dynamic_body_template(garments, topology, hierarchy, bodies, of_each=of_each)
