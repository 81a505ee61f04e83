"""A network that regresses codes of garments at rest from pictures (CLOTH3D 5.3).

The class of a garment is known where its silhouette is, so the network says how far a code is from
the mean of the class. B pictures, Z numbers of a code.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from drapeline.models.gcvae.pictures.views import CHANNELS, hide_parts, mirror_images
from drapeline.models.gcvae.settings import PictureNetwork, PictureViews
from drapeline.models.layers.resnet import ResNet18
from drapeline.models.pictures.read import CLASSES
from drapeline.models.training.batches import Batch
from drapeline.models.training.checkpoints import load_network
from drapeline.models.training.module import BEST, TrainableModule
from drapeline.seeding import rng_for


class CodeSpace(NamedTuple):
    """Codes of the training garments, and how they were made.

    Attributes:
        means: (K, Z) float32 of each of `CLASSES`; zeros of a class without garments.
        known: (K,) bool, classes with garments.
        spread: (Z,) float32 deviation from the mean of the class.
        tightness: (2,) float32 that codes are encoded and decoded with: no picture tells it.
        model: digest of the static model's weights.
    """

    means: np.ndarray
    known: np.ndarray
    spread: np.ndarray
    tightness: np.ndarray
    model: str


class PictureCoder(TrainableModule):
    """Codes of garments that pictures show.

    Args:
        settings: sizes and training.
        size_px: R of the pictures.
        space: of the codes.
    """

    checkpoint_type = "picture_code"
    settings: PictureNetwork
    means: torch.Tensor
    known: torch.Tensor
    spread: torch.Tensor
    tightness: torch.Tensor

    def __init__(self, settings: PictureNetwork, size_px: int, space: CodeSpace) -> None:
        super().__init__()
        self.settings, self.size_px, self.model = settings, size_px, space.model
        for name in CodeSpace._fields[:-1]:
            self.register_buffer(name, torch.from_numpy(getattr(space, name)))
        rng = rng_for(settings.training.seed, "picture network")
        drawn = torch.Generator().manual_seed(int(rng.integers(2**62)))
        self.network = ResNet18(CHANNELS, len(space.spread), settings.width, drawn)

    @property
    def space(self) -> CodeSpace:
        """Of its codes."""
        arrays = {name: getattr(self, name).cpu().numpy() for name in CodeSpace._fields[:-1]}
        return CodeSpace(**arrays, model=self.model)

    def forward(self, images: torch.Tensor, kind: torch.Tensor) -> torch.Tensor:
        """(B, Z) codes of images (B, CHANNELS, R, R) of garments of classes (B,)."""
        return self.means[kind] + self.spread * self.network(images)

    def training_step(self, batch: Batch) -> torch.Tensor:
        """L2 of the codes.

        Half of the pictures are mirrored, whose garments have the same codes, and half have
        something unknown in them.
        """
        images = batch["images"]
        rng = rng_for(self.settings.training.seed, "mirrored", *self.progress[:3])
        turned = torch.from_numpy(rng.random(len(images)) < 0.5).to(images.device)
        images = torch.where(turned[:, None, None, None], mirror_images(images), images)
        loss = self._loss(hide_parts(images, rng), batch)
        self.stop_if_unfinite(loss, {"code": loss}, batch["names"])
        self.log_means("train", {"loss": loss}, len(images))
        return loss

    def validation_step(self, batch: Batch) -> None:
        """The same on validation rows, as they are."""
        self.log_means("val", {"loss": self._loss(batch["images"], batch)}, len(batch["images"]))

    def _loss(self, images: torch.Tensor, batch: Batch) -> torch.Tensor:
        """Squared error of codes, as a share of how far they are from the mean of their class."""
        away = (self(images, batch["kind"]) - batch["z"]).square().sum(1).mean()
        return away / self.spread.square().sum()

    def checkpoint_metadata(self) -> dict[str, Any]:
        """Type, settings and sizes; the rest is among the weights."""
        return {
            "checkpoint_type": self.checkpoint_type,
            "settings": self.settings.plain(),
            "size_px": self.size_px,
            "latent": len(self.spread),
            "model": self.model,
        }


def load_coder(folder: str | Path) -> PictureCoder:
    """A trained network from the folder of its training.

    Raises:
        InputError: a file is missing or damaged, or of another kind of network.
    """

    def build(metadata: Any) -> PictureCoder:
        latent, classes = int(metadata["latent"]), len(CLASSES)
        space = CodeSpace(
            np.zeros((classes, latent), np.float32),
            np.zeros(classes, bool),
            np.ones(latent, np.float32),
            np.zeros(2, np.float32),
            str(metadata["model"]),
        )
        settings = PictureNetwork(**metadata["settings"])
        return PictureCoder(settings, PictureViews(size_px=metadata["size_px"]).size_px, space)

    return load_network(Path(folder) / BEST, PictureCoder.checkpoint_type, build)
