"""Toy garments and an untrained network as the files that rules read."""

from pathlib import Path

import numpy as np
import torch

from drapeline.nets.domain import topology_codes
from drapeline.nets.gcvae import GcvaeNetwork
from drapeline.nets.gcvae_training import GcvaeTraining, StaticVae, VaeSettings
from drapeline.storage import save_npz
from gcvae_toys import ToyGarments, toy_domain, tube

SETTINGS = VaeSettings(
    network=GcvaeNetwork(widths=(6, 8, 8, 10), features=12, latent=5, condition=4),
    training=GcvaeTraining(normal_parts=2),
)


class TypedGarments(ToyGarments):
    """Toy garments with types that fit their topology; all types are among the held-out ones."""

    def __init__(self) -> None:
        super().__init__()
        skirted = np.flatnonzero(topology_codes(np.arange(6)))
        others = np.setdiff1d(np.arange(6), skirted)
        turn = np.arange(len(self.codes)) // 2
        self.codes = np.arange(len(self.codes)) % 2
        self.garment = np.where(
            self.codes == 1, skirted[turn % len(skirted)], others[turn % len(others)]
        )
        self.split[-12:] = "test"
        self.split[-18:-12] = "val"
        self.outfit = np.array([f"s{row:05d}" for row in range(len(self.codes))])


def save_static_data(folder: Path) -> TypedGarments:
    """What the rule `collect_static` leaves, of the toy garments."""
    garments = TypedGarments()
    train = garments.rows("train")
    folder.mkdir(parents=True)
    np.save(folder / "offsets.npy", garments.offsets)
    np.save(folder / "mask.npy", garments.mask)
    names = ("shape", "gender", "tightness", "garment", "outfit", "split")
    save_npz(folder / "rows.npz", **{name: getattr(garments, name) for name in names})
    save_npz(
        folder / "statistics.npz",
        mean=garments.offsets[train].mean(0),
        std=garments.offsets[train].std(0) + 5e-3,
        body_mean=tube().astype(np.float32),
        body_std=np.full(tube().shape, 0.02, dtype=np.float32),
    )
    return garments


def save_model(folder: Path, model: StaticVae | None = None) -> StaticVae:
    """What a training leaves: the best checkpoint, here of an untrained static network."""
    model = model or StaticVae(SETTINGS, toy_domain()).eval()
    checkpoint = {"state_dict": model.state_dict()}
    model.on_save_checkpoint(checkpoint)
    folder.mkdir(parents=True)
    torch.save(checkpoint, folder / "best.ckpt")
    return model
