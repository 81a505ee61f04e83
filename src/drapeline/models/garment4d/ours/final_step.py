"""Our final step: the garment at rest corrected by its points, and laid on them in every frame.

It takes a first guess of the garment at rest and the labels of the points. The guess, skinned, is
moved to the points of some frames. Where it had to stretch for that, it was too short: a regression
from such lengths and offsets, fitted in closed form to training sequences, corrects it. The
corrected garment, skinned or simulated, is then moved to the points of all frames.

F frames, P points, N vertices of the template, K of its springs, D components.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import torch

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.sequence import untouched_sequence
from drapeline.experiment.cloth_solvers import OUR_SOLVER
from drapeline.generation.moving_sheets import WORN, simulate_sheet
from drapeline.geometry.collision import PenetrationResolver
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.learning_data.sequences import SIMULATED
from drapeline.metrics.sequence import vertex_error_mm
from drapeline.models.garment4d.data import (
    BodySequences,
    Seen,
    proposals,
    propose_garment,
    skinning_weights,
    spread_rows,
)
from drapeline.models.garment4d.ours.body_maps import MapRegression
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.outfits.garment_types import BODY, GARMENT_TYPES, LABELS
from drapeline.registration.settings import RefineSettings
from drapeline.registration.to_points import (
    WornGarmentStatistics,
    fit_to_points,
    spring_lengths,
    springs,
)
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.rule_log import LOGGER, progress
from drapeline.simulation.settings import SimulationSettings

DEFAULT_REFINING = RefineSettings()
_SMALL_M = 1e-4
_TINY_M = 1e-9
_MOST_FRAMES = 20  # of a sequence, evenly spread, that a correction is made from
_SIMULATED_ERROR_M = 0.08  # of simulated proposals, where it is not measured
_SIMULATION = SimulationSettings(attempts=1, floor=False)


class LaidGarment(NamedTuple):
    """A garment on its points; metres, root frame."""

    canonical: np.ndarray  # (N, 3) corrected
    proposal: np.ndarray  # (F, N, 3) skinned or simulated
    final: np.ndarray  # (F, N, 3)


@dataclass(frozen=True)
class FinalStep:
    """The step for a garment type."""

    space: GarmentSpace
    label: int  # of the type, in `LABELS`
    skinning: SkinningSettings
    # Of simulated training sequences; None where there were none.
    statistics: WornGarmentStatistics | None = None
    # From `evidence` to changes of alpha; None where no first guess is of garments left out.
    correction: MapRegression | None = None
    most_m: float = 0.0  # root mean square that a correction moves vertices by, at most
    # (N,) root mean square error of simulated proposals; None where they are skinned.
    simulated_error_m: np.ndarray | None = None

    def __call__(self, first: np.ndarray, seen: Seen, settings: RefineSettings) -> LaidGarment:
        """The garment in all frames, from a first guess (N, 3) of it at rest."""
        return self.lay(self.correct(first, seen), seen, settings)

    def lay(self, canonical: np.ndarray, seen: Seen, settings: RefineSettings) -> LaidGarment:
        """The garment in all frames, from one (N, 3) at rest that is taken as it is."""
        proposal, statistics = self.propose(canonical, seen)
        final = self._fit(proposal, canonical, seen, settings, statistics)
        return LaidGarment(canonical, proposal, self._push_out(final, seen))

    def correct(self, first: np.ndarray, seen: Seen) -> np.ndarray:
        """(N, 3) float32 garment at rest, from a first guess (N, 3)."""
        if self.correction is None:
            return first
        evidence = torch.from_numpy(self.evidence(first, seen))[None]
        change = self.correction(evidence)[0].numpy()
        # Scans may be worse than anything that the regression was fitted to.
        moved_m = float(np.sqrt(change @ self.space.metric() @ change))
        change = change * min(1.0, self.most_m / max(moved_m, _SMALL_M))
        return first + self.space.vertices(change) - self.space.mean

    def propose(
        self, canonical: np.ndarray, seen: Seen
    ) -> tuple[np.ndarray, WornGarmentStatistics | None]:
        """Garments (F, N, 3) before they are moved to points, and what is known of their errors."""
        if self.simulated_error_m is not None:
            found = simulate_proposals(canonical, self.space.faces, LABELS[self.label], seen)
            if found is not None:
                shares = np.ones(1) if self.statistics is None else self.statistics.shares
                # All of their accelerations are meant.
                error_m = self.simulated_error_m
                return found, WornGarmentStatistics(shares, error_m, np.ones(len(error_m)))
        return self._skin(canonical, seen)[0], self.statistics

    def evidence(self, canonical: np.ndarray, seen: Seen) -> np.ndarray:
        """What points say of a guess (N, 3) at rest: (1, K + 3 N) float32.

        The guess is skinned and moved to the points of some frames, each by itself. Evidence are
        the mean logarithms by which springs became longer, and the median offsets that vertices
        have when they are carried back to rest, in mean lengths of a spring.
        """
        part = seen.frames(spread_rows(np.arange(len(seen.poses)), _MOST_FRAMES))
        proposal, weights, motions = self._skin(canonical, part)
        still = RefineSettings(smooth=0)
        garment = self._fit(proposal, canonical, part, still, None)
        pairs = springs(self.space.faces)[0]
        rest, moved = (
            np.maximum(spring_lengths(each, pairs), _SMALL_M) for each in (canonical, garment)
        )
        blended = np.einsum("nj,fjab->fnab", weights, motions)
        away = (garment - blended[..., :3, 3])[..., None]
        back = np.linalg.solve(blended[..., :3, :3], away)[..., 0]
        offset = (np.median(back, axis=0) - canonical) / rest.mean()
        found = np.concatenate([np.log(moved / rest).mean(axis=0), offset.ravel()])
        return found[None].astype(np.float32)

    def _skin(self, canonical: np.ndarray, seen: Seen) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Proposals (F, N, 3), weights (N, 24) and joints' motions (F, 24, 4, 4)."""
        weights = skinning_weights(seen.body, canonical, self.space.faces, self.skinning)
        motions = seen.body.transforms(seen.poses)
        return proposals(canonical[None], weights[None], motions[None])[0], weights, motions

    def _push_out(self, garment: np.ndarray, seen: Seen) -> np.ndarray:
        """The garment (F, N, 3) where the whole body, not some vertices of it, lets it be."""
        model = seen.body.model
        bodies = posed_vertices(model, seen.body.shape, seen.poses)[0]
        average = averaging_matrix(self.space.faces, garment.shape[1])
        resolver, out = PenetrationResolver(bodies[0], model.faces), np.zeros_like(garment)
        for frame, body in enumerate(bodies):
            resolver.move(body)
            out[frame] = resolver.push_out(garment[frame], average)
        return out

    def _fit(
        self,
        proposal: np.ndarray,
        canonical: np.ndarray,
        seen: Seen,
        settings: RefineSettings,
        statistics: WornGarmentStatistics | None,
    ) -> np.ndarray:
        return fit_to_points(
            proposal,
            seen.points,
            seen.taken_for(self.label),
            self.space.faces,
            canonical,
            *seen.body.pose_surface(seen.poses),
            settings,
            worn_statistics=statistics,
            bare=seen.taken_for(LABELS.index(BODY)),
        )

    def arrays(self) -> dict[str, Any]:
        """What training found, for `load_final_step`."""
        found: dict[str, Any] = {}
        if self.statistics is not None:
            found |= self.statistics._asdict()
        if self.simulated_error_m is not None:
            found["simulated_error_m"] = self.simulated_error_m
        if self.correction is not None:
            state = self.correction.state_dict()
            found |= {f"{_CORRECTION}{name}": value.numpy() for name, value in state.items()}
            found["most_m"] = self.most_m
        return found


_CORRECTION = "correction_"
# Forms of `FinalStep.arrays` in a file; `e` is the number of values of evidence.
FINAL_STEP_FORMS = {
    "simulated_error_m?": "float *",
    **{f"{name}?": "float *" for name in WornGarmentStatistics._fields},
    **{f"{_CORRECTION}{name}?": "float 1 e" for name in ("mean", "scale", "low", "high")},
    f"{_CORRECTION}weight?": "float e d",
    f"{_CORRECTION}bias?": "float d",
    "most_m?": "float",
}


def load_final_step(
    found: Mapping[str, np.ndarray], space: GarmentSpace, label: int, skinning: SkinningSettings
) -> FinalStep:
    """The step of `FinalStep.arrays`."""
    names = WornGarmentStatistics._fields
    statistics = (
        WornGarmentStatistics(*(found[name] for name in names)) if names[0] in found else None
    )
    correction = None
    if any(name.startswith(_CORRECTION) for name in found):
        state = {
            name: torch.from_numpy(found[f"{_CORRECTION}{name}"])
            for name in MapRegression(1, 1, 1).state_dict()
        }
        correction = MapRegression(1, *state["weight"].shape)
        correction.load_state_dict(state)
    error_m = found.get("simulated_error_m")
    step = FinalStep(space, label, skinning, statistics, simulated_error_m=error_m)
    if correction is None:
        return step
    return replace(step, correction=correction, most_m=float(found["most_m"]))


def simulate_proposals(
    canonical: np.ndarray, faces: np.ndarray, garment: str, seen: Seen
) -> np.ndarray | None:
    """(F, N, 3) float32 a garment (N, 3) at rest, by the fast solver, of cotton.

    None, and a warning in the log, if its cloth has come undone.
    """
    body = seen.body
    record = untouched_sequence(body.shape, body.gender, seen.poses, seen.trans)
    frames = simulate_sheet(
        Mesh(canonical, faces),
        garment,
        body.model,
        record,
        import_module(OUR_SOLVER).cloth_solver(1),
        edge_length_m=None,
        simulation=_SIMULATION,
        bounds=WORN,
    )
    return np.stack([frame.vertices for frame in frames]) if frames else None


class Guess(NamedTuple):
    """A first guess for a training or validation sequence."""

    seen: Seen  # its points, labelled by a network
    sequence: int
    alpha: np.ndarray  # (D,) of the garment at rest, by a fit without the sequence


def fit_final_step(
    sequences: BodySequences,
    skinning: SkinningSettings,
    guesses: Iterable[Guess],
    settings: RefineSettings,
    proposals: str,
) -> FinalStep:
    """Fit the step to training sequences, and choose its proposals on validation sequences.

    Args:
        sequences: of the type.
        guesses: of training sequences of all kinds, and of simulated validation sequences. Without
            any for training, first guesses are not corrected.
        settings: of the last fit.
        proposals: "skinned", "simulated" or "best", which is the one with the smaller M2; of upper
            garments, which nothing holds, it is "skinned": they slip while they get from the rest
            pose to the first frame.
    """
    data = sequences.data
    statistics = training_worn_statistics(sequences, skinning)
    step = FinalStep(data.space, data.label, skinning, statistics)
    by_split: dict[str, list[Guess]] = {"train": [], "val": []}
    for guess in guesses:
        by_split[str(data.split[guess.sequence])].append(guess)
    step = _fit_correction(step, sequences, by_split["train"])
    loose = GARMENT_TYPES[LABELS[data.label]].region == "upper"
    if proposals == "skinned" or (proposals == "best" and loose):
        return step
    usual = np.full(len(data.space.mean), _SIMULATED_ERROR_M)
    simulated = replace(step, simulated_error_m=usual)
    known = by_split["val"]
    if not known:
        return simulated if proposals == "simulated" else step
    found_mm, squared = _validate(simulated, sequences, known, settings)
    if proposals == "best":
        skinned_mm, _ = _validate(step, sequences, known, settings)
        LOGGER.info("skinned proposals: %.1f mm, simulated ones: %.1f mm", skinned_mm, found_mm)
        if skinned_mm <= found_mm:
            return step
    return replace(simulated, simulated_error_m=np.sqrt(_with_mean(squared)))


def _fit_correction(
    step: FinalStep, sequences: BodySequences, guesses: Sequence[Guess]
) -> FinalStep:
    """The step with its correction, if there are two guesses or more."""
    data, space = sequences.data, sequences.data.space
    if len(guesses) < 2:
        return step
    evidence = np.stack(
        [
            step.evidence(space.vertices(guess.alpha), guess.seen)
            for guess in progress(guesses, label="corrections")
        ]
    )
    off = np.stack([data.coefficients[one.sequence] - one.alpha for one in guesses])
    regression = MapRegression(1, evidence.shape[-1], len(space.components))
    metric = space.metric()
    _, error = regression.fit(evidence, off, [str(one.sequence) for one in guesses], metric)
    size_m = np.sqrt(((off @ metric) * off).sum(axis=1))
    before = float(np.sqrt((size_m**2).mean()))
    LOGGER.info("garments at rest: off by %.1f mm, corrected %.1f mm", 1e3 * before, 1e3 * error)
    return replace(step, correction=regression, most_m=float(size_m.max()))


def _validate(
    step: FinalStep, sequences: BodySequences, guesses: Sequence[Guess], settings: RefineSettings
) -> tuple[float, list[np.ndarray]]:
    """M2 in mm, and (N,) mean squared errors of the proposals for each of the sequences."""
    data = sequences.data
    errors, squared = [], []
    for guess in progress(guesses, label="proposals"):
        canonical = step.correct(data.space.vertices(guess.alpha), guess.seen)
        laid = step.lay(canonical, guess.seen, settings)
        true = data.garment[data.rows(guess.sequence)]
        errors.append(vertex_error_mm(laid.final, true))
        squared.append(((laid.proposal - true) ** 2).sum(axis=-1).mean(axis=0))
    return float(np.mean(errors)), squared


def training_worn_statistics(
    sequences: BodySequences, skinning: SkinningSettings
) -> WornGarmentStatistics | None:
    """Statistics of a type's simulated training sequences against proposals; None without any.

    Static outfits in motion follow their skinning, so they would tell nothing of cloth.
    """
    data = sequences.data
    chosen = data.of_split("train", (SIMULATED,))
    if not len(chosen):
        return None
    return measure_worn_garments(
        (data.garment[data.rows(sequence)] for sequence in chosen),
        (
            propose_garment(
                sequences.body(sequence),
                data.poses[data.rows(sequence)],
                data.canonical[sequence],
                data.space.faces,
                skinning,
            )
            for sequence in chosen
        ),
        (data.canonical[sequence] for sequence in chosen),
        data.space.faces,
    )


def measure_worn_garments(
    garments: Iterable[np.ndarray],
    proposals: Iterable[np.ndarray],
    canonicals: Iterable[np.ndarray],
    faces: np.ndarray,
) -> WornGarmentStatistics:
    """Means over training sequences and one more that has the mean at all vertices and springs.

    Cloth loses length to wrinkles finer than the template, and some parts of a garment are held by
    the body while others hang.

    Args:
        garments: (F, N, 3) worn garments of each sequence, simulated, metres.
        proposals: (F, N, 3) the same garments by skinning alone.
        canonicals: (N, 3) of the same sequences.
        faces: (E, 3).
    """
    pairs = springs(faces)[0]
    share, squared, products, squares = [], [], 0.0, 0.0
    for garment, proposal, rest in zip(garments, proposals, canonicals, strict=True):
        worn = spring_lengths(garment, pairs).mean(axis=0)
        share.append(worn / np.maximum(spring_lengths(rest, pairs), _TINY_M))
        squared.append(((garment - proposal) ** 2).sum(-1).mean(axis=0))
        made, true = np.diff(proposal, 2, axis=0), np.diff(garment, 2, axis=0)
        products, squares = products + (made * true).sum((0, 2)), squares + (made**2).sum((0, 2))
    follow = (products + np.mean(products) / len(share)) / np.maximum(
        squares + np.mean(squares) / len(share), _TINY_M**2
    )
    return WornGarmentStatistics(
        _with_mean(share), np.sqrt(_with_mean(squared)), np.clip(follow, 0, 1)
    )


def _with_mean(rows: list[np.ndarray]) -> np.ndarray:
    return (np.sum(rows, axis=0) + np.mean(rows)) / (len(rows) + 1)
