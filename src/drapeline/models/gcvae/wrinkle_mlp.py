"""Wrinkles of a garment from how its wearer moves, by a multilayer perceptron.

Not in the paper, whose DVAE is shown the frame. A frame's wrinkles are a code of masked PCA that
knows nothing of the pose; the network finds it from rotations of the joints, how fast they turn,
which way is up, the wearer, and the code of the garment at rest; docs/background/garment-vae.md has
what each is worth.
"""

from collections.abc import Mapping
from functools import partial
from itertools import pairwise

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from drapeline.bodies.kinematics import axis_angle_to_matrix
from drapeline.learning_data.static import CONDITIONS
from drapeline.learning_data.training_rows import with_mirror_images
from drapeline.models.gcvae.codec import Code, TopologyBatch, conditions_of, encode_rows
from drapeline.models.gcvae.data import BodyTemplate, DynamicGarments, cvar_statistics
from drapeline.models.gcvae.ppca import DynamicPpca
from drapeline.models.gcvae.settings import (
    WRINKLE_MLP,
    WrinkleMlpSettings,
    dynamic_conditions,
)
from drapeline.models.layers.linear import linear
from drapeline.models.training.batches import Batch
from drapeline.models.training.module import TrainableModule
from drapeline.seeding import rng_for

# Poses among the conditions, of which more add nothing, and joints of a pose.
_POSES, _JOINTS = dynamic_conditions(WRINKLE_MLP)[1], 24
_DEVIATIONS = 5.0  # from the mean of the training, beyond which an input says no more
_DROPPED = 0.3  # share of the hidden numbers in a training step
_SMALL_M = 1e-5  # keeps the gradient of a distance finite at zero


def motion_features(cvar: torch.Tensor) -> torch.Tensor:
    """What the network sees of conditions (B, 13 + 72 * 2 + Z).

    Returns:
        (B, 13 + 6 * 23 + 3 + 72 + Z): static conditions; two columns of the rotation matrix of each
        joint but the root (Zhou et al. 2019); which way is up, in the root's frame; sine times axis
        of every joint's turn from the earlier pose; static code.
    """
    size = _POSES * _JOINTS * 3
    static, poses, code = cvar.tensor_split((CONDITIONS, CONDITIONS + size), dim=1)
    turned = axis_angle_to_matrix(poses.unflatten(1, (_POSES, _JOINTS, 3)))
    now, before = turned.unbind(1)
    change = before.mT @ now
    skew = (change - change.mT) / 2
    speed = torch.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], -1)
    joints, up = now[:, 1:, :, :2], now[:, 0, 2]
    return torch.cat([static, joints.flatten(1), up, speed.flatten(1), code], 1)


class WrinkleMlp(DynamicPpca, TrainableModule):
    """Codes of masked PCA, and the network that predicts them from conditions.

    A code says how far a frame is from the prediction, so that zero is the likeliest.

    Args:
        settings: sizes and training.
        body_template: of the training data.
    """

    checkpoint_type = "wrinkle_mlp"
    model = "mlp"
    SETTINGS = WrinkleMlpSettings
    conditioned = False
    resolves_penetration = False
    sees_frame = False
    settings: WrinkleMlpSettings
    feature_mean: torch.Tensor
    feature_std: torch.Tensor

    def __init__(self, settings: WrinkleMlpSettings, body_template: BodyTemplate) -> None:
        super().__init__(settings, body_template)
        seen = motion_features(torch.zeros(1, len(body_template.cvar_mean)))
        rng = torch.Generator().manual_seed(int(rng_for(self.seed, "weights").integers(2**62)))
        widths = (seen.shape[1], settings.width, settings.width)
        self.hidden = nn.ModuleList(linear(*pair, rng) for pair in pairwise(widths))
        self.last = linear(settings.width, settings.latent, rng)
        nn.init.zeros_(self.last.weight)  # begins with the mean
        for moment, value in (("mean", 0.0), ("std", 1.0)):
            self.register_buffer(f"feature_{moment}", torch.full_like(seen[0], value))

    def predict(self, cvar: torch.Tensor) -> torch.Tensor:
        """(B, latent) codes of the PCA, given conditions (B, C)."""
        return self._network(self._inputs(cvar), None)

    def encode_parts(self, parts: Mapping[str, TopologyBatch]) -> Code:
        """The exact posterior, from the prediction."""
        code = super().encode_parts(parts)
        return code._replace(mean=code.mean - self.predict(conditions_of(parts)[0]))

    def decode_parts(
        self, z: torch.Tensor, cvar: torch.Tensor, counts: Mapping[str, int]
    ) -> dict[str, torch.Tensor]:
        """Topology -> (V, 3, B_t) normalised offsets, of the prediction and what is added to it."""
        return super().decode_parts(z + self.predict(cvar), cvar, counts)

    def _network(self, x: torch.Tensor, rng: np.random.Generator | None) -> torch.Tensor:
        """Codes (B, latent) of inputs; drops numbers of hidden layers if told how to draw."""
        for layer in self.hidden:
            x = functional.relu(layer(x))
            if rng is not None:
                kept = torch.from_numpy(rng.random(x.shape, dtype=np.float32) >= _DROPPED)
                x = x * kept.to(x) / (1 - _DROPPED)
        return self.last(x)

    def _inputs(self, cvar: torch.Tensor) -> torch.Tensor:
        away = motion_features(cvar) - self.feature_mean
        return (away / self.feature_std).clamp(-_DEVIATIONS, _DEVIATIONS)

    # ---- training

    def prepare(self, cvar: np.ndarray) -> None:
        """Set the statistics of the inputs from conditions (n, C) of training rows."""
        features = motion_features(torch.from_numpy(cvar)).numpy()
        for name, value in zip(("mean", "std"), cvar_statistics(features), strict=True):
            getattr(self, f"feature_{name}").copy_(torch.from_numpy(value))

    def training_step(self, batch: Batch) -> torch.Tensor:
        """Distance of fields, with dropout (Srivastava et al. 2014).

        What is dropped depends on seed, step and rank alone, for trainings that are resumed.
        """
        rng = rng_for(self.seed, "dropout", self.progress.step, self.progress.rank)
        loss = self._loss(self._network(self._inputs(batch["cvar"]), rng), batch)
        self.stop_if_unfinite(loss, {"distance": loss}, batch["names"])
        self.log_means("train", {"loss": loss}, len(batch["cvar"]))
        return loss

    def validation_step(self, batch: Batch) -> None:
        """The same without dropout."""
        loss = self._loss(self.predict(batch["cvar"]), batch)
        self.log_means("val", {"loss": loss}, len(batch["cvar"]))

    def _loss(self, predicted: torch.Tensor, batch: Batch) -> torch.Tensor:
        """Mean over frames of the root mean square distance over the body's vertices, in mm.

        Rows of the basis are orthogonal, so it follows from the codes alone.
        """
        size = self.ppca.basis.square().sum(1) * (
            self.constants.unit_m**2 / len(self.offset_mean[0])
        )
        square = ((predicted - batch["z"]).square() * size).sum(1)
        return 1000 * (square + _SMALL_M**2).sqrt().mean()


class CodeRows:
    """Frames, and mirror images of those of the training split, as conditions and codes.

    Args:
        model: whose PCA is fitted, and whose network still predicts zero.
        garments: frames of the training and the validation split.
    """

    def __init__(self, model: WrinkleMlp, garments: DynamicGarments) -> None:
        mirror = model.body_template.mirror
        rows = {split: garments.rows(split) for split in ("train", "val")}
        parts = [(split, own, garments.cvar(own), garments.batch) for split, own in rows.items()]
        if mirror is not None:
            own = rows["train"]
            image = partial(_mirror_images, garments, mirror)
            parts.append(("train", own, garments.mirrored_cvar(own), image))
        self._split = np.concatenate([np.full(len(own), split) for split, own, _, _ in parts])
        self._rows = np.concatenate([own for _, own, _, _ in parts])
        self._cvar = np.concatenate([cvar for _, _, cvar, _ in parts])
        self._z = np.concatenate(
            [encode_rows(model, read, own).mean for _, own, _, read in parts if len(own)]
        )
        self._garments = garments

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split, "train" or "val"."""
        return np.flatnonzero(self._split == split)

    def batch(self, rows: np.ndarray) -> Batch:
        """`cvar` (B, C) and `z` (B, latent) float32, and `names`."""
        names = self._garments.names(self._rows[rows])
        return {"cvar": self._cvar[rows], "z": self._z[rows], "names": names}


def _mirror_images(garments: DynamicGarments, mirror: np.ndarray, rows: np.ndarray) -> Batch:
    return with_mirror_images(garments, rows, mirror)[1]
