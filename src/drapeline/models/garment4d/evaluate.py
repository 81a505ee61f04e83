"""SplitEvaluation of trained Garment4D networks: metrics of all variants of a garment type.

F frames, P points of a cloud, N vertices of the template, B vertices of the body, L labels.
"""

import time
from collections.abc import Mapping, Sequence
from functools import lru_cache, reduce
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.model import load_bodies, posed_vertices
from drapeline.dataset.point_clouds import corrupt_labels, cut_holes
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
from drapeline.models.garment4d.data import BodySequences, BodySet, ShapedBody
from drapeline.models.garment4d.final_step import FinalStep, LaidGarment, Seen
from drapeline.models.garment4d.reconstruct import (
    DEFAULT_REFINING,
    Estimate,
    ReconstructedGarment,
    body_frames,
    build_reconstruction,
    estimate,
    reconstruct,
)
from drapeline.models.garment4d.settings import EvaluationSettings, SkinningSettings
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    MgnStage,
    PointNetStage,
    PosedStage,
    load_posed_files,
    load_stage,
)
from drapeline.models.training.batches import ByteCache
from drapeline.models.training.checkpoints import tensors_digest
from drapeline.models.training.module import fastest_device
from drapeline.outfits.garment_types import LABELS
from drapeline.registration.settings import RefineSettings
from drapeline.rule_log import progress
from drapeline.schema import Table
from drapeline.seeding import rng_for
from drapeline.storage import atomic_folder

_KEPT_BYTES = 1 << 30  # of the outputs of canonical networks for sequences
ONE, BY_VERTEX = "one_label", "label_by_vertex"
_COUNTED = slice(None, None, 10)  # neighbouring frames hardly differ


class SplitEvaluation:
    """Measures of all variants on one split, sequence by sequence.

    Args:
        split: "train", "val" or "test".
        final_step: our final step; without corrections of garments at rest if None.

    Raises:
        InputError: no sequence of the split is simulated. Garments moved by skinning are never
            measured: they have no folds of their own.
    """

    def __init__(
        self,
        sequences: BodySequences,
        split: str,
        settings: EvaluationSettings,
        refining: RefineSettings = DEFAULT_REFINING,
        final_step: FinalStep | None = None,
    ) -> None:
        self.sequences, self.data = sequences, sequences.data
        self.split, self.settings = split, settings
        self.refining = refining
        self.final_step = final_step or FinalStep(
            self.data.space, self.data.label, SkinningSettings()
        )
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

        The references are the mean garment; "regression", what the stage "canonical" starts from;
        "pca", the garment from its true coefficients, which is the best that the space can do; and
        "truth", the registered garment against the original. Those for labels are `GuessedLabels`.
        """
        data, guessed = self.data, GuessedLabels(self.sequences)
        for sequence in progress(self.simulated, total=len(self.simulated), label="canonical"):
            self._measure_canonical("mean_garment", sequence, data.space.mean)
            self._measure_canonical(
                "pca", sequence, data.space.vertices(data.coefficients[sequence])
            )
            self._measure_canonical("truth", sequence, data.canonical[sequence], true=False)
            made = {variant: self._estimate(stage, sequence) for variant, stage in stages.items()}
            if (regressed := made["canonical"].regressed) is not None:
                made["regression"] = made["canonical"]._replace(canonical=regressed)
            for variant, estimated in made.items():
                self._measure_canonical(variant, sequence, estimated.canonical)
            labels = {variant: estimated.labels for variant, estimated in made.items()}
            for variant, found in (labels | guessed.of(sequence)).items():
                if found is not None:
                    right = metrics.segmentation_accuracy(found, data.labels[data.rows(sequence)])
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

    def measure_ours(self, sequence: int, made: ReconstructedGarment) -> ReconstructedGarment:
        """Measure our variant at rest and in motion, and return it as a reconstruction."""
        started = time.perf_counter()
        laid = self._lay(sequence, made)
        seconds = made.seconds + time.perf_counter() - started
        self._measure_canonical("ours", sequence, laid.canonical)
        self.measure_garment("ours", sequence, laid.final, seconds=seconds)
        return made._replace(**laid._asdict())

    def measure_oracles(self, sequence: int, made: ReconstructedGarment) -> None:
        """Our variant given parts of the truth: what better ones would be worth."""
        data = self.data
        labels = data.labels[data.rows(sequence)]
        told = self._lay(sequence, made._replace(labels=labels))
        self.measure_garment("ours_true_labels", sequence, told.final)
        seen = self._seen(sequence, made)
        told = self.final_step.lay(data.canonical[sequence], seen, self.refining)
        self.measure_garment("ours_true_rest", sequence, told.final)

    def _lay(
        self,
        sequence: int,
        made: ReconstructedGarment,
        *,
        noisy: bool = False,
    ) -> LaidGarment:
        """What our final step makes of a reconstruction."""
        return self.final_step(made.first, self._seen(sequence, made, noisy=noisy), self.refining)

    def _seen(self, sequence: int, made: ReconstructedGarment, *, noisy: bool = False) -> Seen:
        """A sequence with the labels of its reconstruction."""
        rows = self.data.rows(sequence)
        poses, body = self._body(sequence, noisy=noisy)
        return Seen(self.data.points[rows], made.labels, poses, self.data.trans[rows], body)

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
            points=data.points[rows],
            poses=data.poses[rows],
            body=self.sequences.body(sequence),
            number=data.number[rows],
            true=data.garment[rows],
            true_canonical=data.canonical[sequence],
        )

    def measure_sweeps(self, stage: PosedStage) -> None:
        """Figures 8, 9 and 10."""
        settings, plain = self.settings, stage.settings.skinning
        for sequence in progress(self.simulated, total=len(self.simulated), label="sweeps"):
            name, rows = str(self.data.name[sequence]), self.data.rows(sequence)
            points, labels = self.data.points[rows], self.data.labels[rows]
            for count in settings.neighbours:
                made = self._reconstruct(stage, sequence, skinning=plain.replace(neighbours=count))
                self._measure_errors(f"neighbours_{count}", sequence, made.final, made.seconds)
            for share in settings.missing:
                rng = rng_for(settings.seed, "missing", name, share)
                holed = np.stack(
                    [cut_holes(*frame, share, rng)[0] for frame in zip(points, labels, strict=True)]
                )
                made = self._reconstruct(stage, sequence, points=holed)
                variant = f"missing_{round(100 * share)}"
                self._measure_errors(variant, sequence, made.final, made.seconds)
            for share in settings.accuracy:
                rng = rng_for(settings.seed, "accuracy", name, share)
                wrong = corrupt_labels(labels.ravel(), share, self.data.label, rng)
                made = self._reconstruct(stage, sequence, labels=wrong.reshape(labels.shape))
                variant = f"accuracy_{round(100 * share)}"
                self._measure_errors(variant, sequence, made.final, made.seconds)

    def measure_noisy_bodies(
        self, canonical: Mapping[str, CanonicalStage], posed: Mapping[str, PosedStage]
    ) -> None:
        """Errors with a body that is not exactly known, in variants that end in "noisy_body".

        Canonical stages are measured if their points are body-relative, since others do not use the
        body. Of the posed stages these are the full model (the variant "noisy_body" itself), its
        proposals and our final step, and MGN*.
        """
        for sequence in progress(self.simulated, total=len(self.simulated), label="noisy bodies"):
            for variant, stage in canonical.items():
                if stage.body_relative_points:
                    estimated = self._estimate(stage, sequence, noisy=True)
                    self._measure_canonical(f"{variant}_noisy_body", sequence, estimated.canonical)
            made = self._reconstruct(posed["posed"], sequence, noisy=True)
            self._measure_errors("noisy_body", sequence, made.final)
            self._measure_errors("lbs_noisy_body", sequence, made.proposal)
            ours = self._lay(sequence, made, noisy=True)
            self._measure_errors("ours_noisy_body", sequence, ours.final)
            if "mgn" in posed:
                made = self._reconstruct(posed["mgn"], sequence, noisy=True)
                self._measure_errors("mgn_noisy_body", sequence, made.final)

    def _body(self, sequence: int, *, noisy: bool = False) -> tuple[np.ndarray, ShapedBody]:
        """Poses (F, 72) and the body of a sequence as networks are given them."""
        data, settings = self.data, self.settings
        poses = data.poses[data.rows(sequence)]
        if not noisy:
            return poses, self.sequences.body(sequence)
        rng = rng_for(settings.seed, "noisy body", str(data.name[sequence]))
        poses = poses + rng.normal(0, settings.noise_pose_rad, 72)
        shape = data.shape[sequence] + rng.normal(0, settings.noise_shape, 10)
        return poses, self.sequences.bodies.of(data.gender[sequence], shape)

    def _measure_errors(
        self, variant: str, sequence: int, garment: np.ndarray, seconds: float | None = None
    ) -> None:
        """Measure M2 and M3 alone."""
        true = self.data.garment[self.data.rows(sequence)]
        measures = metrics.sequence_measures(garment, true)
        if seconds is not None:
            measures["inference_s_per_frame"] = seconds / len(true)
        self.add(variant, sequence, measures)

    def _estimate(
        self,
        stage: CanonicalStage,
        sequence: int,
        *,
        noisy: bool = False,
        frames: int | None = None,
        stride: int | None = None,
    ) -> Estimate:
        """Estimate of a canonical network for a sequence; see `estimate`.

        Posed stages of sequences in motion hold the same network, so it is kept for the next one.
        """
        frames = frames or stage.settings.training.frames
        key = (tensors_digest(stage.state_dict()), int(sequence), noisy, frames, stride or frames)
        if key in self._estimates:
            return self._estimates[key]
        points, body = self.data.points[self.data.rows(sequence)], self._body(sequence, noisy=noisy)
        made = estimate(stage, points, *body, frames=frames, stride=stride)
        self._estimates.add(key, made)
        return made

    def _reconstruct(
        self,
        stage: PosedStage,
        sequence: int,
        *,
        noisy: bool = False,
        points: np.ndarray | None = None,
        labels: np.ndarray | None = None,
        skinning: SkinningSettings | None = None,
    ) -> ReconstructedGarment:
        """See `reconstruct`; what is None is as in the data, or as in training."""
        stride, estimated = self.settings.stride or None, None
        if points is None and labels is None:
            frames = stage.settings.training.frames
            estimated = self._estimate(
                stage.canonical, sequence, noisy=noisy, frames=frames, stride=stride
            )
        return reconstruct(
            stage,
            self.data.points[self.data.rows(sequence)] if points is None else points,
            *self._body(sequence, noisy=noisy),
            stride=stride,
            skinning=skinning,
            labels=labels,
            estimated=estimated,
        )


def evaluate(
    sequences: BodySequences,
    canonical: Mapping[str, CanonicalStage],
    posed: Mapping[str, PosedStage],
    splits: Sequence[str],
    settings: EvaluationSettings,
    refining: RefineSettings,
    final_step: FinalStep,
    *,
    pictures: str | Path,
    vertex_sampled: BodySequences | None = None,
) -> Table:
    """Rows of the table of metrics for all variants of a type, and reconstructions for figures.

    Ablations, sweeps and noisy bodies are for the test split alone.

    Args:
        canonical: variant -> trained stage; "canonical" and "pointnet".
        posed: variant -> trained stage; "posed", "mgn" and ablations.
        final_step: our final step.
        pictures: folder for `{sequence}.npz` and `{sequence}_ours.npz` of the test split, each a
            `Reconstruction`; replaced as a whole.
        vertex_sampled: the same sequences with points sampled as in the released code; None to
            leave them out.
    """
    data, tables = sequences.data, []
    with atomic_folder(pictures) as scratch:
        for split in splits:
            evaluation = SplitEvaluation(sequences, split, settings, refining, final_step)
            evaluation.measure_canonicals(canonical)
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
                ours = evaluation.measure_ours(sequence, made)
                evaluation.measure_garment("truth", sequence, data.garment[rows], true=False)
                if split == "test":
                    shown = evaluation.reconstruction(sequence, made)
                    shown.save(scratch / f"{name}.npz")
                    evaluation.reconstruction(sequence, ours).save(scratch / f"{name}_ours.npz")
                    evaluation.measure_oracles(sequence, made)
                for variant, stage in others.items():
                    evaluation.measure_posed(variant, stage, sequence)
            if split == "test":
                evaluation.measure_sweeps(posed["posed"])
                if settings.noise_pose_rad or settings.noise_shape:
                    evaluation.measure_noisy_bodies(canonical, posed)
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
    stages = {name: load_stage(folder, PosedStage).to(device) for name, folder in posed.items()}
    released = given.get("vertex_sampled")
    with atomic_folder(job.output[0]) as scratch:
        rows = evaluate(
            BodySequences(SequenceData(given.data), bodies),
            {
                "canonical": load_stage(given.canonical, CanonicalStage).to(device),
                "pointnet": load_stage(given.pointnet, PointNetStage).to(device),
            },
            {**stages, "mgn": load_stage(given.mgn, MgnStage).to(device)},
            params.splits,
            EvaluationSettings(**params.settings),
            RefineSettings(**params.refine),
            load_posed_files(posed["posed"], stages["posed"]).final_step,
            pictures=scratch / RECONSTRUCTIONS,
            vertex_sampled=BodySequences(SequenceData(released), bodies) if released else None,
        )
        write_metrics(scratch / METRICS_FILE, rows)
