"""Training of the posed stage on a trained canonical one, and of its baseline MGN*."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import torch

from drapeline.models.garment4d.body_input import SkinningSettings
from drapeline.models.garment4d.canonical import CanonicalNetwork, CanonicalOutput
from drapeline.models.garment4d.canonical_stage import CanonicalStage
from drapeline.models.garment4d.data import SequenceData, window_starts
from drapeline.models.garment4d.losses import UniformLaplacian
from drapeline.models.garment4d.posed import (
    MgnNetwork,
    MgnSettings,
    PosedNetwork,
    PosedSettings,
    PosedWeights,
    posed_loss,
)
from drapeline.models.garment4d.settings import StageSettings
from drapeline.models.garment4d.stage import Stage, distance_mm, windows_of
from drapeline.models.layers.pointnet import PointLevel
from drapeline.models.training.batches import Batch
from drapeline.models.training.digests import tensors_digest
from drapeline.models.training.module import plain

_BATCH = 4  # windows at once where no gradient is wanted
_KEPT_BYTES = 1 << 30  # of what the canonical network said about windows of training


class PosedStage(Stage):
    """Posed garment reconstruction from proposals, with the loss of equation 7.

    Args:
        settings: of the stage.
        canonical: trained, of the same garment type; it is frozen and gives levels of points.
    """

    kind = "garment4d_posed"
    NETWORK, LOSS, POSED, ERROR = PosedSettings, PosedWeights, True, "vertex_error_mm"

    def __init__(self, settings: StageSettings, canonical: CanonicalStage) -> None:
        super().__init__(settings, canonical.space, canonical.label)
        if settings.loss.laplacian_form == "released":
            self.laplacian = UniformLaplacian(self.space.faces, len(self.space.mean))
        self.canonical = canonical.requires_grad_(False)
        self.network = self.build(canonical.network)
        self._kept: dict[tuple[int, int], list[PointLevel]] = {}
        self._room = _KEPT_BYTES

    @property
    def body_relative_points(self) -> bool:
        """As the canonical stage has it."""
        return self.canonical.body_relative_points

    @property
    def smooth_passes(self) -> int:
        """Over the frames of a whole sequence, see `PosedSettings`."""
        return self.settings.network.smooth_passes

    def build(self, canonical: CanonicalNetwork) -> torch.nn.Module:
        """The network that is trained."""
        return PosedNetwork(
            self.settings.network,
            self.space.faces,
            len(self.space.mean),
            canonical.level_channels,
            self.weight_rng(),
        )

    def levels(
        self,
        points: torch.Tensor,
        labels: torch.Tensor | None = None,
        initial_alpha: torch.Tensor | None = None,
    ) -> CanonicalOutput:
        """What the canonical network says about windows (B, T, P, 3), without gradient."""
        with torch.no_grad():
            return self.canonical.network(points, labels, initial_alpha)

    def kept_levels(self, batch: Batch) -> list[PointLevel]:
        """The same levels of points, of windows seen before from memory."""
        keys = windows_of(batch)
        new = [row for row, key in enumerate(keys) if key not in self._kept]
        found = {key: self._kept[key] for key in keys if key in self._kept}
        if new:
            levels = self.levels(batch["points"][new]).levels
            found |= self.keep([keys[row] for row in new], levels)
        windows = zip(*(found[key] for key in keys), strict=True)  # level by level
        # They were found before the network was moved to where it is trained.
        device = batch["points"].device
        return [
            PointLevel(*(torch.cat(x).to(device) for x in zip(*level, strict=True)))
            for level in windows
        ]

    def keep(
        self, keys: Sequence[tuple[int, int]], levels: Sequence[PointLevel]
    ) -> dict[tuple[int, int], list[PointLevel]]:
        """Levels of windows, by sequence and first frame; remembered while there is room."""
        frames = len(levels[0].points) // len(keys)
        parts = [slice(row * frames, (row + 1) * frames) for row in range(len(keys))]
        found = {
            key: [PointLevel(*(x[clouds] for x in level)) for level in levels]
            for key, clouds in zip(keys, parts, strict=True)
        }
        size = sum(x.nbytes for level in levels for x in level)
        if size <= self._room:
            self._kept |= found
            self._room -= size
        return found

    def predicted_canonicals(self, data: SequenceData, splits: Sequence[str]) -> np.ndarray:
        """T(alpha') of the sequences of some splits, (S, N, 3) float32; others have the mean.

        Alpha' is the mean over a sequence's windows; that of a training sequence begins with what
        maps say when it is left out of their fit. What the canonical network says of points is kept
        for training, whose windows are the same unless they overlap.
        """
        frames = self.settings.training.frames
        alpha = np.zeros_like(data.coefficients, dtype=np.float32)
        for sequence in np.flatnonzero(np.isin(data.split, splits)).tolist():
            points = data.clouds(sequence, body_relative_points=self.body_relative_points)
            name = str(data.name[sequence])
            starts = window_starts(len(points), frames, frames, name)
            found = []
            for part in np.array_split(starts, -(-len(starts) // _BATCH)):
                windows = np.stack([points[start : start + frames] for start in part])
                trained = name in self.canonical.out_of_fold_alpha
                initial_alpha = (
                    self.canonical.initial_alpha([name] * len(part)) if trained else None
                )
                given = torch.from_numpy(windows).to(self.canonical.device)
                output = self.levels(given, initial_alpha=initial_alpha)
                self.keep([(sequence, start) for start in part.tolist()], output.levels)
                found.append(output.coefficients)
            alpha[sequence] = torch.cat(found).mean(0).cpu().numpy()
        return data.space.vertices(alpha)

    def predictions(self, batch: Batch, levels: list[PointLevel]) -> list[torch.Tensor]:
        """Posed garments (B, T, N, 3) in metres, one for each iteration, the last one the best."""
        return self.network(batch["proposal"], levels, batch["body"], batch["body_normals"])

    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Equation 7, and the mean distance of posed vertices."""
        found = self.predictions(batch, self.kept_levels(batch))
        terms = posed_loss(
            found,
            batch["target"],
            batch["body"],
            batch["body_normals"],
            self.laplacian,
            self.settings.loss,
        )
        return terms, distance_mm(found[-1], batch["target"])

    def given(self) -> dict[str, Any]:
        """The canonical network."""
        return {
            "canonical": plain(asdict(self.canonical.settings)),
            "canonical_weights": tensors_digest(self.canonical.state_dict()),
        }

    def about(self) -> dict[str, Any]:
        """With what the canonical network is built from."""
        return {**super().about(), "canonical": self.canonical.about()}


class MgnStage(PosedStage):
    """The MGN* baseline of table 3: displacements of the canonical garment, then K = 1 skinning."""

    kind = "garment4d_mgn"
    NETWORK, SKINNING = MgnSettings, SkinningSettings(neighbours=1, passes=0)
    smooth_passes = 0

    def build(self, canonical: CanonicalNetwork) -> torch.nn.Module:
        """The network that is trained."""
        return MgnNetwork(
            self.settings.network, len(self.space.mean), canonical.level_channels, self.weight_rng()
        )

    def predictions(self, batch: Batch, levels: list[PointLevel]) -> list[torch.Tensor]:
        """Posed garments (B, T, N, 3) in metres."""
        return [self.network(batch["worn"], levels, batch["weights"], batch["transforms"])]
