"""Training of the canonical stage, and of its baseline PN++."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from drapeline.dataset.labels import LABELS
from drapeline.models.garment4d.canonical import (
    CanonicalNetwork,
    CanonicalOutput,
    CanonicalSettings,
    CanonicalWeights,
    PointNetRegressor,
    balanced,
    canonical_loss,
)
from drapeline.models.garment4d.data import Windows
from drapeline.models.garment4d.settings import StageSettings, settings_of
from drapeline.models.garment4d.stage import Stage, distance_mm, sequences_of, windows_of
from drapeline.models.layers.point_search import Recall
from drapeline.models.training.batches import Batch, as_tensors
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.rule_log import LOGGER

_THINNED = (1, 2, 4)  # maps are fitted to every point, every second and every fourth one
_BATCH = 4  # windows at once where no gradient is wanted
_KEPT_BYTES = 1 << 30  # of what was searched about windows of training


class CanonicalStage(Stage):
    """Canonical garment estimation, with the loss of equation 4."""

    kind = "garment4d_canonical"
    NETWORK, LOSS, POSED, ERROR = CanonicalSettings, CanonicalWeights, False, "canonical_error_mm"

    @classmethod
    def network_of(cls, values: Mapping[str, Any]) -> CanonicalSettings:
        """Sizes; with `points` and `width` those that are not given are scaled, see there."""
        scale = {key: values[key] for key in ("points", "width") if key in values}
        given = {key: value for key, value in values.items() if value is not None}
        sizes = settings_of(
            CanonicalSettings, {key: value for key, value in given.items() if key not in scale}
        )
        if not scale:
            return sizes
        scaled = sizes.scaled(**scale)
        return replace(scaled, garment_points=given.get("garment_points", scaled.garment_points))

    def __init__(self, settings: StageSettings, space: GarmentSpace, label: int) -> None:
        super().__init__(settings, space, label)
        self.network = self.build()
        self.register_buffer("label_weights", torch.ones(len(LABELS)))
        self._recall = Recall(_KEPT_BYTES)
        self.out_of_fold_alpha: dict[str, torch.Tensor] = {}

    def build(self) -> torch.nn.Module:
        """The network that is trained."""
        network, rng = self.settings.network, self.weight_rng()
        return CanonicalNetwork(network, self.space, self.label, rng)

    def prepare(self, windows: Windows) -> None:
        """Balance labels by their share of the training points, and fit alpha to maps.

        `out_of_fold_alpha` is then the estimate for each training sequence from a fit without it:
        networks learn from estimates that are as wrong as those of new garments will be.
        """
        share = windows.data.label_share("train")
        self.label_weights.copy_(balanced(share, self.settings.loss.balance))
        network = self.network
        if network.regression is None:
            return
        names, maps, coefficients, whole = [], [], [], []
        rows = windows.rows("train")
        for part in np.array_split(rows, -(-len(rows) // _BATCH)):
            batch = as_tensors(windows.batch(part))
            points, chosen = batch["points"], network.chosen(batch["labels"])
            for step in _THINNED:
                names += sequences_of(batch)
                whole += [step == 1] * len(part)
                maps.append(network.maps(points[:, :, ::step], chosen[:, :, ::step]))
                coefficients.append(batch["coefficients"])
        if len(set(names)) < 2:
            LOGGER.warning("one training sequence: alpha does not begin with maps of the body")
            return
        components = self.space.components.reshape(len(self.space.components), -1)
        found, error = network.regression.fit(
            torch.cat(maps).numpy(),
            torch.cat(coefficients).numpy(),
            names,
            components @ components.T / len(self.space.mean),
        )
        LOGGER.info("maps of the body: off by %.1f mm for sequences left out", 1000 * error)
        of_sequence = np.where(whole, names, "")
        self.out_of_fold_alpha = {
            name: torch.from_numpy(found[of_sequence == name].mean(axis=0))
            for name in dict.fromkeys(names)
        }

    def initial_alpha(self, names: Sequence[str]) -> torch.Tensor | None:
        """(B, D) alpha that training sequences begin with; None if no maps were fitted."""
        if not self.out_of_fold_alpha:
            return None
        return torch.stack([self.out_of_fold_alpha[name] for name in names]).to(self.device)

    def losses(self, batch: Batch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Equation 4, and the mean distance of canonical vertices."""
        # Neither the points nor their true labels are others in the next epoch.
        with self._recall.of(windows_of(batch)) if self.training else nullcontext():
            output = self.estimated(batch)
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

    def estimated(self, batch: Batch) -> CanonicalOutput:
        """Of a batch; in training alpha is made from the points that truly are the garment's.

        It would learn nothing before the segmentation has.
        """
        if not self.training:
            return self.network(batch["points"])
        initial_alpha = self.initial_alpha(sequences_of(batch))
        return self.network(batch["points"], batch["labels"], initial_alpha)

    def about(self) -> dict[str, Any]:
        """With `out_of_fold_alpha`, which the posed stage is trained on."""
        return {**super().about(), "out_of_fold_alpha": self.out_of_fold_alpha}


class PointNetStage(CanonicalStage):
    """The PN++ baseline of table 2: coefficients from all points, without segmentation."""

    kind = "garment4d_pointnet"

    def build(self) -> torch.nn.Module:
        """The network that is trained."""
        return PointNetRegressor(self.settings.network, self.space, self.weight_rng())

    def estimated(self, batch: Batch) -> CanonicalOutput:
        """Of a batch."""
        initial_alpha = self.initial_alpha(sequences_of(batch)) if self.training else None
        return self.network(batch["points"], initial_alpha)
