"""SplitEvaluation of trained Garment4D networks: metrics of all variants of a garment type.

F frames, P points of a cloud, N vertices of the template, B vertices of the body, L labels.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache, reduce
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.model import load_bodies, posed_vertices
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.job import Job
from drapeline.learning_data.body_relative_points import nearest_vertices
from drapeline.learning_data.sequences import SIMULATED, SequenceData
from drapeline.metrics import sequence as metrics
from drapeline.metrics.garment4d import MODEL
from drapeline.metrics.metric import Measured
from drapeline.metrics.predictions import Reconstruction
from drapeline.metrics.table import METRICS_FILE, join, summarise, without_all, write_metrics
from drapeline.models.garment4d.data import BodySequences, BodySet, Seen, spread_rows
from drapeline.models.garment4d.ours.model import OurModel
from drapeline.models.garment4d.reconstruct import (
    Estimate,
    ReconstructedGarment,
    body_frames,
    build_reconstruction,
    estimate,
    reconstruct,
)
from drapeline.models.garment4d.robustness import degraded
from drapeline.models.garment4d.settings import EvaluationSettings, SkinningSettings
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    MgnStage,
    PointNetStage,
    PosedStage,
    load_stage,
)
from drapeline.models.training.batches import ByteCache
from drapeline.models.training.checkpoints import tensors_digest
from drapeline.models.training.module import fastest_device
from drapeline.outfits.garment_types import LABELS
from drapeline.registration.settings import RefineSettings
from drapeline.rule_log import progress
from drapeline.schema import Table
from drapeline.storage import atomic_folder

_KEPT_BYTES = 1 << 30  # of the outputs of canonical networks for sequences
ONE, BY_VERTEX = "one_label", "label_by_vertex"
_DEGRADED = 8  # sequences that are also measured with worse inputs, at most
_COUNTED = slice(None, None, 10)  # neighbouring frames hardly differ


class SplitEvaluation:
    """Measures of all variants on one split, sequence by sequence.

    Args:
        split: "train", "val" or "test".

    Raises:
        InputError: no sequence of the split is simulated. Garments moved by skinning are never
            measured: they have no folds of their own.
    """

    def __init__(
        self,
        sequences: BodySequences,
        split: str,
        settings: EvaluationSettings,
    ) -> None:
        self.sequences, self.data = sequences, sequences.data
        self.split, self.settings = split, settings
        self._measured: dict[str, list[Measured]] = {}
        self._estimates: ByteCache[tuple, Estimate] = ByteCache(_KEPT_BYTES)
        self._moving_body = lru_cache(1)(self._measured_body)  # all variants of one after another
        self.simulated = self.data.of_split(split, (SIMULATED,))
        if not len(self.simulated):
            raise InputError(
                f"no {self.data.garment_type} of the {split} split is simulated, expected one or"
                " more to measure"
            )

    def rows(self) -> Table:
        """Rows of the table of metrics."""
        seed = self.settings.seed
        tables = (
            summarise(measured, model=MODEL, variant=variant, split=self.split, seed=seed)
            for variant, measured in self._measured.items()
        )
        return without_all(join(tables))

    def add(self, variant: str, sequence: int, measures: Mapping[str, float]) -> None:
        """Record measures of a variant on a sequence."""
        one = Measured(
            str(self.data.clip[sequence]),
            self.data.garment_type,
            measures,
            str(self.data.source[sequence]),
        )
        self._measured.setdefault(variant, []).append(one)

    def measure_canonicals(self, stages: Mapping[str, CanonicalStage]) -> None:
        """M1 of stages by variant and of references.

        The references are the mean garment; "pca", the garment from its true coefficients, which is
        the best that the space can do; and "truth", the registered garment against the original.
        Those for labels are `GuessedLabels`.
        """
        data, guessed = self.data, GuessedLabels(self.sequences)
        for sequence in progress(self.simulated, total=len(self.simulated), label="canonical"):
            self._measure_canonical("mean_garment", sequence, data.space.mean)
            self._measure_canonical(
                "pca", sequence, data.space.vertices(data.coefficients[sequence])
            )
            self._measure_canonical("truth", sequence, data.canonical[sequence], true=False)
            made = {variant: self._estimate(stage, sequence) for variant, stage in stages.items()}
            for variant, estimated in made.items():
                self._measure_canonical(variant, sequence, estimated.canonical)
            labels = {variant: estimated.labels for variant, estimated in made.items()}
            for variant, found in (labels | guessed.of(sequence)).items():
                if found is not None:
                    self._measure_labels(variant, sequence, found)

    def _measure_labels(self, variant: str, sequence: int, labels: np.ndarray) -> None:
        right = metrics.segmentation_accuracy(labels, self.data.labels[self.data.rows(sequence)])
        self.add(variant, sequence, {"segmentation_accuracy": right})

    def _measure_canonical(
        self, variant: str, sequence: int, garment: np.ndarray, *, true: bool = True
    ) -> None:
        """All measures of a canonical garment (N, 3); if not `true`, those without ground truth."""
        mesh = Mesh(garment, self.data.space.faces)
        original = self.data.originals.get(str(self.data.name[sequence]))
        registered = self.data.canonical[sequence] if true else None
        self.add(variant, sequence, metrics.canonical_measures(mesh, registered, original))

    def measure_posed(self, variant: str, stage: PosedStage, sequence: int) -> ReconstructedGarment:
        """Measure a stage on a sequence and return its reconstruction."""
        made = self._reconstruct(stage, sequence)
        self.measure_garment(variant, sequence, made.final, seconds=made.seconds)
        return made

    def measure_ours(self, model: OurModel, sequence: int) -> ReconstructedGarment:
        """Measure our model at rest and in motion, and return its reconstruction."""
        seen = self.sequences.seen(sequence)
        guess = model.guesser.guess(seen)
        made = model.lay(guess, seen)
        self._measure_labels("ours", sequence, guess.labels)
        self._measure_canonical("regression", sequence, guess.canonical)
        self._measure_canonical("ours", sequence, made.canonical)
        self.measure_garment("ours_proposals", sequence, made.proposal)
        self.measure_garment("ours", sequence, made.final, seconds=made.seconds)
        return made

    def measure_oracles(self, model: OurModel, sequence: int, made: ReconstructedGarment) -> None:
        """Our model given parts of the truth: what better ones would be worth.

        Args:
            made: by the model.
        """
        data = self.data
        labels = data.labels[data.rows(sequence)]
        told = model.make(self.sequences.seen(sequence, labels))
        self._measure_canonical("ours_true_labels", sequence, told.canonical)
        self.measure_garment("ours_true_labels", sequence, told.final)
        laid = model.final_step.lay(data.canonical[sequence], made.seen, model.refining)
        self.measure_garment("ours_true_rest", sequence, laid.final)

    def measure_garment(
        self,
        variant: str,
        sequence: int,
        garment: np.ndarray,
        *,
        seconds: float | None = None,
        true: bool = True,
    ) -> None:
        """All measures of a posed garment (F, N, 3); if not `true`, those without ground truth."""
        data = self.data
        rows = data.rows(sequence)
        measures = metrics.sequence_measures(
            garment,
            data.garment[rows] if true else None,
            body=self._moving_body(sequence),
            points=data.points[rows],
            faces=data.space.faces,
        )
        if seconds is not None:
            measures["inference_s_per_frame"] = seconds / len(garment)
        self.add(variant, sequence, measures)

    def _measured_body(self, sequence: int) -> metrics.BodyFrames:
        return body_frames(self.sequences.body(sequence), self.data.poses[self.data.rows(sequence)])

    def measure_still(self, sequence: int) -> None:
        """Errors in the motion of a garment that never moves, as if all were smoothed away."""
        true = self.data.garment[self.data.rows(sequence)]
        still = np.zeros_like(true)
        measures = {
            "velocity_error_m_s": metrics.velocity_error_m_s(still, true),
            "acceleration_error_m_s2": metrics.acceleration_error_m_s2(still, true),
        }
        self.add("still", sequence, measures)

    def reconstruction(self, sequence: int, made: ReconstructedGarment) -> Reconstruction:
        """A reconstruction with all that figures need."""
        data, rows = self.data, self.data.rows(sequence)
        return build_reconstruction(
            made,
            name=str(data.name[sequence]),
            garment=data.garment_type,
            faces=data.space.faces,
            number=data.number[rows],
            true=data.garment[rows],
            true_canonical=data.canonical[sequence],
        )

    def measure_neighbours(self, stage: PosedStage) -> None:
        """Figure 8: proposals with weights of other numbers of body vertices."""
        plain = stage.settings.skinning
        for sequence in progress(self.simulated, total=len(self.simulated), label="neighbours"):
            for count in self.settings.neighbours:
                made = self._reconstruct(stage, sequence, skinning=plain.replace(neighbours=count))
                self._measure_errors(f"neighbours_{count}", sequence, made.final, made.seconds)

    def measure_degraded(self, posed: Mapping[str, PosedStage], ours: OurModel) -> None:
        """Figures 9 and 10, and what inexact bodies, noise and few views do.

        It is measured on a few sequences, for "posed", its proposals "lbs", "mgn" if there is one,
        and "ours", in variants `{model}_{name}` with names as of `degraded`.
        """
        chosen = spread_rows(self.simulated, _DEGRADED)
        longest = max(
            ours.guesser.frames, *(stage.settings.training.frames for stage in posed.values())
        )
        for sequence in progress(chosen, total=len(chosen), label="degraded"):
            for name, seen, step in degraded(self.sequences, int(sequence), self.settings):
                if len(seen.points) < longest:
                    continue
                made = self._reconstruct(posed["posed"], sequence, seen)
                self._measure_errors(f"posed_{name}", sequence, made.final, step=step)
                self._measure_errors(f"lbs_{name}", sequence, made.proposal, step=step)
                if "mgn" in posed:
                    made = self._reconstruct(posed["mgn"], sequence, seen)
                    self._measure_errors(f"mgn_{name}", sequence, made.final, step=step)
                made = ours.make(seen)
                self._measure_canonical(f"ours_{name}", sequence, made.canonical)
                # The true garment is relative to the root joint as it was given.
                shift = (made.seen.trans - seen.trans)[:, None]
                self._measure_errors(f"ours_{name}", sequence, made.final + shift, step=step)

    def _measure_errors(
        self,
        variant: str,
        sequence: int,
        garment: np.ndarray,
        seconds: float | None = None,
        *,
        step: int = 1,
    ) -> None:
        """Measure M2, and motion where there is every frame of it."""
        true = self.data.garment[self.data.rows(sequence)][::step]
        if step == 1:
            measures = metrics.sequence_measures(garment, true)
        else:
            measures = {"vertex_error_mm": metrics.vertex_error_mm(garment, true)}
        if seconds is not None:
            measures["inference_s_per_frame"] = seconds / len(true)
        self.add(variant, sequence, measures)

    def _estimate(
        self,
        stage: CanonicalStage,
        sequence: int,
        *,
        frames: int | None = None,
        stride: int | None = None,
    ) -> Estimate:
        """Estimate of a canonical network for a sequence; see `estimate`.

        Posed stages of sequences in motion hold the same network, so it is kept for the next one.
        """
        frames = frames or stage.settings.training.frames
        key = (tensors_digest(stage.state_dict()), int(sequence), frames, stride or frames)
        if key in self._estimates:
            return self._estimates[key]
        points = self.data.points[self.data.rows(sequence)]
        made = estimate(stage, points, frames=frames, stride=stride)
        self._estimates.add(key, made)
        return made

    def _reconstruct(
        self,
        stage: PosedStage,
        sequence: int,
        seen: Seen | None = None,
        *,
        skinning: SkinningSettings | None = None,
    ) -> ReconstructedGarment:
        """See `reconstruct`; what is None is as in the data, or as in training."""
        stride, estimated = self.settings.stride or None, None
        plain = self.sequences.seen(sequence)
        if seen is None or (seen.labels is None and np.array_equal(seen.points, plain.points)):
            frames = stage.settings.training.frames
            estimated = self._estimate(stage.canonical, sequence, frames=frames, stride=stride)
        return reconstruct(
            stage,
            plain if seen is None else seen,
            stride=stride,
            skinning=skinning,
            estimated=estimated,
        )


def evaluate(
    sequences: BodySequences,
    canonical: Mapping[str, CanonicalStage],
    posed: Mapping[str, PosedStage],
    ours: OurModel,
    splits: Sequence[str],
    settings: EvaluationSettings,
    *,
    pictures: str | Path,
    vertex_sampled: BodySequences | None = None,
) -> Table:
    """Rows of the table of metrics for all variants of a type, and reconstructions for figures.

    Ablations and worse inputs are for the test split alone.

    Args:
        canonical: variant -> trained stage; "canonical" and "pointnet".
        posed: variant -> trained stage; "posed", "mgn" and ablations.
        ours: our model.
        pictures: folder for `{sequence}.npz` and `{sequence}_ours.npz` of the test split, each a
            `Reconstruction`; replaced as a whole.
        vertex_sampled: the same sequences with points sampled as in the released code; None to
            leave them out.
    """
    data, tables = sequences.data, []
    with atomic_folder(pictures) as scratch:
        for split in splits:
            evaluation = SplitEvaluation(sequences, split, settings)
            begun = canonical["canonical"].untrained()
            evaluation.measure_canonicals({**canonical, "canonical_untrained": begun})
            others = {}
            if split == "test":
                others = {name: stage for name, stage in posed.items() if name != "posed"}
                others["untrained"] = posed["posed"].untrained()
            simulated = evaluation.simulated.tolist()
            for sequence in progress(simulated, total=len(simulated), label="posed"):
                name, rows = str(data.name[sequence]), data.rows(sequence)
                made = evaluation.measure_posed("posed", posed["posed"], sequence)
                evaluation.measure_garment("lbs", sequence, made.proposal)
                evaluation.measure_still(sequence)
                laid = evaluation.measure_ours(ours, sequence)
                evaluation.measure_garment("truth", sequence, data.garment[rows], true=False)
                if split == "test":
                    shown = evaluation.reconstruction(sequence, made)
                    shown.save(scratch / f"{name}.npz")
                    evaluation.reconstruction(sequence, laid).save(scratch / f"{name}_ours.npz")
                    evaluation.measure_oracles(ours, sequence, laid)
                for variant, stage in others.items():
                    evaluation.measure_posed(variant, stage, sequence)
            if split == "test":
                evaluation.measure_neighbours(posed["posed"])
                if settings.degrades:
                    evaluation.measure_degraded(posed, ours)
                if vertex_sampled is not None:
                    released = SplitEvaluation(vertex_sampled, split, settings)
                    for sequence in released.simulated.tolist():
                        released.measure_posed("vertex_sampled", posed["posed"], sequence)
                    tables.append(released.rows())
            tables.append(evaluation.rows())
    return join(tables)


class GuessedLabels:
    """Labels of points without a network, which a segmentation has to beat.

    The guess `ONE` is the label that most training points have. `BY_VERTEX` is the one that most
    of them have among those nearest to the same vertex of the body, which must be known.

    Args:
        sequences: whose training points count, in every tenth frame.
    """

    def __init__(self, sequences: BodySequences) -> None:
        self._sequences = sequences
        votes = reduce(np.add, map(self._votes, sequences.data.of_split("train")))
        self._one = int(votes.sum(axis=0).argmax())
        self._by_vertex = np.where(votes.any(axis=1), votes.argmax(axis=1), self._one)

    def of(self, sequence: int) -> dict[str, np.ndarray]:
        """Guess -> labels (F, P) of a sequence's points."""
        nearest = self._nearest(sequence, slice(None))
        return {ONE: np.full(nearest.shape, self._one), BY_VERTEX: self._by_vertex[nearest]}

    def _votes(self, sequence: int) -> np.ndarray:
        """(B, L) points of a sequence that are nearest to each vertex, by label."""
        data, body = self._sequences.data, self._sequences.body(sequence).model
        labels = data.labels[data.rows(sequence)][_COUNTED]
        nearest = self._nearest(sequence, _COUNTED)
        votes = np.zeros((len(body.v_template), len(LABELS)), dtype=np.int64)
        np.add.at(votes, (nearest.ravel(), labels.ravel()), 1)
        return votes

    def _nearest(self, sequence: int, frames: slice) -> np.ndarray:
        """(F, P) the body's vertices that are nearest to the points in some frames."""
        data, body = self._sequences.data, self._sequences.body(sequence)
        points, poses = (each[data.rows(sequence)][frames] for each in (data.points, data.poses))
        posed = posed_vertices(body.model, body.shape, poses)[0]
        return np.stack([nearest_vertices(*pair) for pair in zip(posed, points, strict=True)])


# In the folder of an evaluation, for figures.
RECONSTRUCTIONS = "reconstructions"


def evaluate_garment(job: Job) -> None:
    """Metrics of all networks of one garment type, and reconstructions."""
    given, params = job.input, job.params
    torch.set_num_threads(job.threads)
    bodies = BodySet(load_bodies(given), params.body_points)
    device = fastest_device(params.accelerator)
    posed = dict(zip(params.posed, given.posed, strict=True))
    stages: dict[str, PosedStage] = {
        name: load_stage(folder, PosedStage, MgnStage).to(device) for name, folder in posed.items()
    }
    ours = OurModel(given.ours, device)
    ours.refining = RefineSettings(**params.refine)
    released = given.get("vertex_sampled")
    with atomic_folder(job.output[0]) as scratch:
        rows = evaluate(
            BodySequences(SequenceData(given.data), bodies),
            {
                "canonical": load_stage(given.canonical, CanonicalStage).to(device),
                "pointnet": load_stage(given.pointnet, PointNetStage).to(device),
            },
            {**stages, "mgn": load_stage(given.mgn, MgnStage).to(device)},
            ours,
            params.splits,
            EvaluationSettings(**params.settings),
            pictures=scratch / RECONSTRUCTIONS,
            vertex_sampled=BodySequences(SequenceData(released), bodies) if released else None,
        )
        write_metrics(scratch / METRICS_FILE, rows)
