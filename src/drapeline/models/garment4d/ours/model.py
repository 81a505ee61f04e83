"""Our model of a garment type: labels, a first guess of the shape at rest, and the final step.

Coordinates are metres relative to the root joint, Z up. F frames, P points of a cloud, N vertices
of the type's template, T frames of a window, D components of its space.
"""

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn

from drapeline.bodies.scan_fit import fit_sequence, is_exact
from drapeline.learning_data.body_relative_points import body_relative_points
from drapeline.learning_data.sequences import SIMULATED, CloudData, SequenceData
from drapeline.models.garment4d.data import BodySequences, Seen, SequenceWindows, spread_rows
from drapeline.models.garment4d.ours.body_maps import (
    SHAPE_CELL_M,
    MapRegression,
    garment_maps,
    map_cells,
)
from drapeline.models.garment4d.ours.final_step import (
    DEFAULT_REFINING,
    FINAL_STEP_FORMS,
    FinalStep,
    Guess,
    load_final_step,
)
from drapeline.models.garment4d.ours.labels import LabelStage, choose_labels
from drapeline.models.garment4d.reconstruct import ReconstructedGarment, ReconstructionModel
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.garment4d.stages import save_seen_forms, space_of
from drapeline.models.training.checkpoints import (
    building,
    load_network,
    read_checkpoint,
    write_checkpoint,
)
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import BODY, LABELS
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.rule_log import LOGGER, progress
from drapeline.seeding import rng_for
from drapeline.storage import load_npz, save_npz

CHECKPOINT_TYPE = "garment4d_ours"
_FINAL_STEP = "final_step.npz"
_CHOSEN_ON = 8  # validation sequences that the final step's proposals are chosen on


class FirstGuess(NamedTuple):
    """What the final step begins with."""

    labels: np.ndarray  # (F, P) uint8 of the points
    canonical: np.ndarray  # (N, 3) at rest
    seconds: float  # that it took


class Guesser(nn.Module):
    """Labels and first guesses for a garment type.

    Args:
        labels: trained.
        space: of the type.
        label: its code in `LABELS`.

    Attributes:
        garment: the type.
        regression: of the coefficients, from maps of a window.
    """

    def __init__(self, labels: LabelStage, space: GarmentSpace, label: int) -> None:
        super().__init__()
        self.labels, self.space = labels, space
        self.label, self.garment = label, LABELS[label]
        self.regression = MapRegression(3, map_cells(SHAPE_CELL_M), len(space.components))

    @torch.inference_mode()
    def guess(self, seen: Seen) -> FirstGuess:
        """Labels of a sequence, unless they are known, and its garment at rest.

        Raises:
            InputError: the sequence is shorter than a window.
        """
        started = time.perf_counter()
        on_body = _places(seen)
        labels = self._label(seen, on_body) if seen.labels is None else seen.labels
        windows = SequenceWindows(len(on_body), self.frames)
        alpha = [
            self.regression(
                garment_maps(
                    torch.from_numpy(windows.of(starts, on_body)),
                    torch.from_numpy(windows.of(starts, labels == self.label)),
                )
            )
            for starts in windows.batches()
        ]
        canonical = self.space.vertices(torch.cat(alpha).mean(0).numpy())
        return FirstGuess(labels, canonical, time.perf_counter() - started)

    @property
    def frames(self) -> int:
        """T."""
        return self.labels.settings.training.frames

    def label_points(self, seen: Seen) -> np.ndarray:
        """(F, P) uint8 labels of a sequence's points."""
        return self._label(seen, _places(seen))

    def _label(self, seen: Seen, on_body: np.ndarray) -> np.ndarray:
        return choose_labels(self.labels.logits(seen.points, on_body), self.garment)

    def checkpoint_metadata(self) -> dict[str, Any]:
        """All that it is built from, as plain values and tensors."""
        return {
            "labels": self.labels.checkpoint_metadata(),
            "space": {key: torch.from_numpy(value) for key, value in vars(self.space).items()},
            "label": self.label,
        }


def _places(seen: Seen) -> np.ndarray:
    """(F, P, 4) of points on the body."""
    body = seen.body
    return body_relative_points(body.model, body.shape, seen.poses, seen.points)[..., 3:]


class OurModel(ReconstructionModel):
    """Our model, see `ReconstructionModel`.

    Args:
        folder: such as `results/garment4d/Skirt/ours`.

    Attributes:
        guesser: labels points and guesses the garment at rest.
        final_step: corrects it and lays it on the points.
        refining: how.
    """

    def __init__(self, folder: str | Path, device: torch.device | str | None = None) -> None:
        super().__init__(folder, device)
        path = self.folder / BEST
        self.guesser = load_network(path, CHECKPOINT_TYPE, _build_guesser)
        with building(path):
            skinning = SkinningSettings(**read_checkpoint(path).metadata["skinning"])
        self.guesser.labels.to(self.device)
        self.garment, self.space = self.guesser.garment, self.guesser.space
        self.final_step = load_final_step(
            load_npz(self.folder / _FINAL_STEP, FINAL_STEP_FORMS, d=len(self.space.components)),
            self.space,
            self.guesser.label,
            skinning,
        )
        self.refining = DEFAULT_REFINING

    def make(self, seen: Seen) -> ReconstructedGarment:
        """See `ReconstructionModel`; a body that is not exact is fitted to the points."""
        started = time.perf_counter()
        found = self.fit_body(seen)
        made = self.lay(self.guesser.guess(found), found)
        return made._replace(seconds=time.perf_counter() - started)

    def fit_body(self, seen: Seen) -> Seen:
        """A sequence with a body that is fitted to it if it is not exact.

        Without labels, it is fitted to all points first, and to skin and cloth as they are then
        labelled. Points are relative to the root joint of the body that is returned.
        """
        given = seen.body
        if is_exact(given.model, seen.points, seen.poses, given.shape):
            return seen
        LOGGER.info("the body is not exact: it is fitted to the points")
        skin = LABELS.index(BODY)
        if seen.labels is not None:
            return self._fit_body(seen, seen.taken_for(skin))
        found = self._fit_body(seen, None)
        return self._fit_body(found, self.guesser.label_points(found) == skin)

    def _fit_body(self, seen: Seen, skin: np.ndarray | None) -> Seen:
        body, rng = seen.body, rng_for(0, "body of a sequence")
        fitted = fit_sequence(body.model, seen.points, skin, seen.poses, body.shape, rng)
        return Seen(
            (seen.points - fitted.shift).astype(np.float32),
            fitted.poses,
            seen.trans + fitted.shift,
            self.bodies.of(body.gender, fitted.shape),
            seen.labels,
        )

    def lay(self, guess: FirstGuess, seen: Seen) -> ReconstructedGarment:
        """The garment from a first guess of it."""
        started = time.perf_counter()
        seen = seen._replace(labels=guess.labels)
        laid = self.final_step(guess.canonical, seen, self.refining)
        return ReconstructedGarment(seen, *laid, guess.seconds + time.perf_counter() - started)


def save_our_model(
    folder: Path, guesser: Guesser, final_step: FinalStep, sequences: BodySequences
) -> None:
    """Write a fitted model for `OurModel`."""
    metadata = {
        "checkpoint_type": CHECKPOINT_TYPE,
        **guesser.checkpoint_metadata(),
        "skinning": final_step.skinning.plain(),
    }
    write_checkpoint(folder / BEST, guesser.state_dict(), metadata)
    save_npz(folder / _FINAL_STEP, **final_step.arrays())
    save_seen_forms(folder, sequences)


def _build_guesser(metadata: Mapping[str, Any]) -> Guesser:
    labels = LabelStage.from_metadata(metadata["labels"])
    return Guesser(labels, space_of(metadata), metadata["label"])


def fit_regression(
    guesser: Guesser, data: SequenceData, clouds: CloudData
) -> dict[tuple[int, bool], np.ndarray]:
    """Fit the regression to the windows of training sequences with their true labels.

    Args:
        clouds: of all sequences, with the worse ones.

    Returns:
        Training sequence, and whether its clouds are the worse ones -> (D,) its estimate by a fit
        without the sequence: as wrong as estimates for new garments will be. None, and a warning
        in the log, if there is only one sequence.
    """
    windows = data.windows("train", guesser.frames, guesser.frames)
    if len(np.unique(windows[:, 0])) < 2:
        LOGGER.warning("only one training sequence: all first guesses are the mean garment")
        return {}
    maps: list[torch.Tensor] = []
    kinds: list[tuple[int, bool]] = []  # sequence of each map, and whether its cloud is worse
    for sequence, start in progress(windows.tolist(), label="maps"):
        span = slice(start, start + guesser.frames)
        own, others = data.rows(sequence), clouds.rows_of(str(data.name[sequence]))
        both = (
            (data.on_body[own], data.labels[own]),
            (clouds.on_worse_body[others], clouds.worse_labels[others]),
        )
        for worse, (places, labels) in enumerate(both):
            on_body = torch.from_numpy(np.array(places[span]))
            chosen = torch.from_numpy(labels[span] == data.label)
            maps.append(garment_maps(on_body[None], chosen[None]))
            kinds.append((sequence, bool(worse)))
    owner, is_worse = np.array(kinds).T
    predictions, error = guesser.regression.fit(
        torch.cat(maps).numpy(), data.coefficients[owner], owner.tolist(), data.space.metric()
    )
    LOGGER.info("maps of the body: off by %.1f mm for sequences left out", 1000 * error)
    return {
        (int(sequence), worse): predictions[(owner == sequence) & (is_worse == worse)].mean(axis=0)
        for sequence in np.unique(owner)
        for worse in (False, True)
    }


def guess_all(
    guesser: Guesser,
    sequences: BodySequences,
    clouds: CloudData,
    known: Mapping[tuple[int, bool], np.ndarray],
) -> Iterator[Guess]:
    """First guesses that the final step is fitted to.

    Args:
        clouds: of all sequences, with the worse ones.
        known: of `fit_regression`.
    """
    data = sequences.data
    for (sequence, worse), alpha in known.items():
        seen = sequences.seen(sequence)
        if worse:
            rows = clouds.rows_of(str(data.name[sequence]))
            seen = seen._replace(points=clouds.worse_points[rows])
        yield Guess(seen._replace(labels=guesser.label_points(seen)), sequence, alpha)
    for sequence in spread_rows(data.of_split("val", (SIMULATED,)), _CHOSEN_ON).tolist():
        seen = sequences.seen(sequence)
        found = guesser.guess(seen)
        alpha = data.space.coefficients(found.canonical)
        yield Guess(seen._replace(labels=found.labels), sequence, alpha)
