"""Training of the posed stage on a trained canonical one, and of its baseline MGN*."""

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import torch

from drapeline.dataset.windows import window_starts
from drapeline.learning_data.sequences import SequenceData
from drapeline.models.garment4d.canonical import CanonicalNetwork, CanonicalOutput
from drapeline.models.garment4d.canonical_stage import CanonicalStage
from drapeline.models.garment4d.dressed import DressedSequences
from drapeline.models.garment4d.losses import UniformLaplacian
from drapeline.models.garment4d.posed import MgnNetwork, PosedNetwork, posed_loss
from drapeline.models.garment4d.settings import MgnStageSettings, PosedStageSettings
from drapeline.models.garment4d.stage import Stage, distance_mm, window_keys
from drapeline.models.garment4d.windows import BodySequences
from drapeline.models.layers.pointnet import PointLevel
from drapeline.models.training.batches import Batch, ByteCache
from drapeline.models.training.checkpoints import tensors_digest

_BATCH = 4  # windows at once where no gradient is wanted
_KEPT_BYTES = 1 << 30  # of levels of points of windows


class PosedStage(Stage):
    """Posed garment reconstruction from proposals, with the loss of equation 7.

    Args:
        settings: of the stage.
        canonical: trained, of the same garment type; it is frozen and gives levels of points.
    """

    checkpoint_type = "garment4d_posed"
    SETTINGS, ERROR = PosedStageSettings, "vertex_error_mm"

    def __init__(
        self, settings: PosedStageSettings | MgnStageSettings, canonical: CanonicalStage
    ) -> None:
        super().__init__(settings, canonical.space, canonical.label)
        if settings.loss.laplacian_form == "released":
            self.laplacian = UniformLaplacian(self.space.faces, len(self.space.mean))
        self.canonical = canonical.requires_grad_(False)
        self.network = self.build(canonical.network)
        self._levels: ByteCache[tuple[int, int], list[PointLevel]] = ByteCache(_KEPT_BYTES)

    @property
    def body_relative_points(self) -> bool:
        """As in the canonical stage."""
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

    def untrained(self) -> "PosedStage":
        """The same stage with the weights that its training began with."""
        stage = deepcopy(self)
        stage.network = self.build(self.canonical.network).to(self.device)
        return stage.eval()

    def estimate_canonical(
        self, points: torch.Tensor, initial_alpha: torch.Tensor | None = None
    ) -> CanonicalOutput:
        """Output of the canonical network for windows (B, T, P, 3 or 7), without gradient."""
        with torch.no_grad():
            return self.canonical.network(points, None, initial_alpha)

    def point_levels(self, batch: Batch) -> list[PointLevel]:
        """Levels of points of a batch from the canonical network, or from memory.

        The network is frozen, so that a window's levels are the same whenever it comes.
        """
        keys = window_keys(batch)
        new = [row for row, key in enumerate(keys) if key not in self._levels]
        levels = {key: self._levels[key] for key in keys if key in self._levels}
        if new:
            output = self.estimate_canonical(batch["points"][new])
            levels |= self._keep([keys[row] for row in new], output.levels)
        by_level = zip(*(levels[key] for key in keys), strict=True)
        # Some were computed before the network was moved to where it is trained.
        device = batch["points"].device
        return [
            PointLevel(*(torch.cat([x.to(device) for x in xs]) for xs in zip(*level, strict=True)))
            for level in by_level
        ]

    def _keep(
        self, keys: Sequence[tuple[int, int]], levels: Sequence[PointLevel]
    ) -> dict[tuple[int, int], list[PointLevel]]:
        """Levels of windows by sequence and first frame, which are kept while there is room."""
        frames = len(levels[0].points) // len(keys)
        parts = [slice(row * frames, (row + 1) * frames) for row in range(len(keys))]
        of_window = {
            key: [PointLevel(*(x[clouds] for x in level)) for level in levels]
            for key, clouds in zip(keys, parts, strict=True)
        }
        for key, part in of_window.items():
            self._levels.add(key, part)
        return of_window

    def training_sequences(self, sequences: BodySequences) -> DressedSequences:
        """Dressed in predicted canonical garments."""
        return self.dress(sequences, ("train", "val"))

    def dress(self, sequences: BodySequences, splits: Sequence[str]) -> DressedSequences:
        """Sequences in the canonical garments that the canonical network predicts for them.

        Args:
            sequences: to dress.
            splits: whose garments are predicted; bodies of other splits wear the mean garment.
        """
        canonical = self.predict_canonicals(sequences.data, splits)
        return DressedSequences(sequences, canonical, self.settings.skinning)

    def predict_canonicals(self, data: SequenceData, splits: Sequence[str]) -> np.ndarray:
        """T(alpha') of the sequences of some splits, (S, N, 3) float32; others get the mean.

        Alpha' is the mean over a sequence's windows; for a training sequence the network starts
        from its `out_of_fold_alpha`. Levels of points are kept for training, whose windows are the
        same unless they overlap.
        """
        frames = self.settings.training.frames
        alpha = np.zeros_like(data.coefficients, dtype=np.float32)
        for sequence in np.flatnonzero(np.isin(data.split, splits)).tolist():
            points = data.clouds(sequence, body_relative_points=self.body_relative_points)
            name = str(data.name[sequence])
            starts = window_starts(len(points), frames, frames, name)
            coefficients = []
            for part in np.array_split(starts, -(-len(starts) // _BATCH)):
                windows = np.stack([points[start : start + frames] for start in part])
                initial_alpha = None
                if name in self.canonical.out_of_fold_alpha:
                    initial_alpha = self.canonical.initial_alpha([name] * len(part))
                clouds = torch.from_numpy(windows).to(self.canonical.device)
                output = self.estimate_canonical(clouds, initial_alpha)
                self._keep([(sequence, start) for start in part.tolist()], output.levels)
                coefficients.append(output.coefficients)
            alpha[sequence] = torch.cat(coefficients).mean(0).cpu().numpy()
        return data.space.vertices(alpha)

    def predict(self, batch: Batch, levels: list[PointLevel]) -> list[torch.Tensor]:
        """Posed garments (B, T, N, 3) in metres after each iteration, the last one the best."""
        return self.network(batch["proposal"], levels, batch["body"], batch["body_normals"])

    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Equation 7, and the mean distance of posed vertices."""
        predictions = self.predict(batch, self.point_levels(batch))
        terms = posed_loss(
            predictions,
            batch["target"],
            batch["body"],
            batch["body_normals"],
            self.laplacian,
            self.settings.loss,
        )
        return terms, distance_mm(predictions[-1], batch["target"])

    def dependencies(self) -> dict[str, Any]:
        """The canonical network."""
        return {
            "canonical": self.canonical.settings.plain(),
            "canonical_weights": tensors_digest(self.canonical.state_dict()),
        }

    def checkpoint_metadata(self) -> dict[str, Any]:
        """With what the canonical network is built from."""
        return {**super().checkpoint_metadata(), "canonical": self.canonical.checkpoint_metadata()}


class MgnStage(PosedStage):
    """The MGN* baseline of table 3: displacements of the canonical garment, then K = 1 skinning."""

    checkpoint_type = "garment4d_mgn"
    SETTINGS = MgnStageSettings
    smooth_passes = 0

    def build(self, canonical: CanonicalNetwork) -> torch.nn.Module:
        """The network that is trained."""
        return MgnNetwork(
            self.settings.network, len(self.space.mean), canonical.level_channels, self.weight_rng()
        )

    def predict(self, batch: Batch, levels: list[PointLevel]) -> list[torch.Tensor]:
        """Posed garments (B, T, N, 3) in metres."""
        return [self.network(batch["worn"], levels, batch["weights"], batch["transforms"])]
