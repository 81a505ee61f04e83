"""Training of the canonical stage, and of its baseline PN++."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from drapeline.dataset.labels import LABELS
from drapeline.models.garment4d.canonical import (
    CanonicalNetwork,
    CanonicalOutput,
    PointNetRegressor,
    balance_labels,
    canonical_loss,
)
from drapeline.models.garment4d.settings import CanonicalStageSettings
from drapeline.models.garment4d.stage import Stage, distance_mm, sequence_names, window_keys
from drapeline.models.garment4d.windows import Windows
from drapeline.models.layers.point_search import SEARCH_ANEW, Searches, SearchMemory
from drapeline.models.training.batches import Batch, as_tensors
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.rule_log import LOGGER

_THINNED = (1, 2, 4)  # maps are fitted to every point, every second and every fourth one
_BATCH = 4  # windows at once where no gradient is wanted
_KEPT_BYTES = 1 << 30  # of the answers to searches in training windows


class CanonicalStage(Stage):
    """Canonical garment estimation, with the loss of equation 4."""

    checkpoint_type = "garment4d_canonical"
    SETTINGS, ERROR = CanonicalStageSettings, "canonical_error_mm"
    MOST_VALIDATED = 3

    def __init__(self, settings: CanonicalStageSettings, space: GarmentSpace, label: int) -> None:
        super().__init__(settings, space, label)
        self.network = self.build()
        self.register_buffer("label_weights", torch.ones(len(LABELS)))
        self.out_of_fold_alpha: dict[str, torch.Tensor] = {}
        self._memory = SearchMemory(_KEPT_BYTES)

    def build(self) -> torch.nn.Module:
        """The network that is trained."""
        network, rng = self.settings.network, self.weight_rng()
        return CanonicalNetwork(network, self.space, self.label, rng)

    def prepare(self, windows: Windows) -> None:
        """Balance labels by their share of the training points, and fit the regression of alpha.

        `out_of_fold_alpha` then holds, for each training sequence, the estimate of a regression
        that was fitted without it. Training starts from those: they are as wrong as the estimates
        for new garments will be.
        """
        share = windows.sequences.data.label_share("train")
        self.label_weights.copy_(balance_labels(share, self.settings.loss.balance))
        network = self.network
        if network.regression is None:
            return
        names, maps, coefficients, complete = [], [], [], []
        rows = windows.rows("train")
        for part in np.array_split(rows, -(-len(rows) // _BATCH)):
            batch = as_tensors(windows.batch(part))
            points, chosen = batch["points"], network.choose(batch["labels"])
            for step in _THINNED:
                names += sequence_names(batch)
                complete += [step == 1] * len(part)
                maps.append(network.maps(points[:, :, ::step], chosen[:, :, ::step]))
                coefficients.append(batch["coefficients"])
        if len(set(names)) < 2:
            LOGGER.warning(
                "only one training sequence: alpha starts from 0, not from a regression on maps of"
                " the body"
            )
            return
        components = self.space.components.reshape(len(self.space.components), -1)
        predictions, error = network.regression.fit(
            torch.cat(maps).numpy(),
            torch.cat(coefficients).numpy(),
            names,
            components @ components.T / len(self.space.mean),
        )
        LOGGER.info("maps of the body: off by %.1f mm for sequences left out", 1000 * error)
        of_sequence = np.where(complete, names, "")
        self.out_of_fold_alpha = {
            name: torch.from_numpy(predictions[of_sequence == name].mean(axis=0))
            for name in dict.fromkeys(names)
        }

    def initial_alpha(self, names: Sequence[str]) -> torch.Tensor | None:
        """(B, D) alpha that training sequences start from; None if no regression was fitted."""
        if not self.out_of_fold_alpha:
            return None
        return torch.stack([self.out_of_fold_alpha[name] for name in names]).to(self.device)

    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Equation 4, and the mean distance of canonical vertices."""
        output = self.estimate(batch)
        terms = canonical_loss(
            output,
            batch["labels"],
            batch["coefficients"],
            batch["canonical"],
            batch["rest_body"],
            batch["rest_normals"],
            self.laplacian,
            self.settings.loss,
            self.label_weights,
        )
        return terms, distance_mm(output.vertices, batch["canonical"])

    def estimate(self, batch: Batch) -> CanonicalOutput:
        """Garments of a batch.

        In training the points that truly are the garment's are used: with those of a segmentation
        that has learned nothing yet, alpha would learn nothing either.
        """
        if not self.training:
            return self.network(batch["points"])
        initial_alpha = self.initial_alpha(sequence_names(batch))
        return self.network(batch["points"], batch["labels"], initial_alpha, self.searches(batch))

    def searches(self, batch: Batch) -> Searches:
        """Remembered in training: points and their true labels are the same in every epoch."""
        return self._memory.of(window_keys(batch)) if self.training else SEARCH_ANEW

    def checkpoint_metadata(self) -> dict[str, Any]:
        """With `out_of_fold_alpha`, which the posed stage is trained on."""
        return {**super().checkpoint_metadata(), "out_of_fold_alpha": self.out_of_fold_alpha}


class PointNetStage(CanonicalStage):
    """The PN++ baseline of table 2: coefficients from all points, without segmentation."""

    checkpoint_type = "garment4d_pointnet"

    def build(self) -> torch.nn.Module:
        """The network that is trained."""
        return PointNetRegressor(self.settings.network, self.space, self.weight_rng())

    def estimate(self, batch: Batch) -> CanonicalOutput:
        """Garments of a batch."""
        initial_alpha = self.initial_alpha(sequence_names(batch)) if self.training else None
        return self.network(batch["points"], initial_alpha, self.searches(batch))
