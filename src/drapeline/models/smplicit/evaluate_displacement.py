"""How well displacements and skinning give back simulated frames of held-out samples.

The garment at rest is the true one, so that vertices correspond and nothing but the motion counts.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_skinning import straighten, tpose_motions
from drapeline.bodies.skinning import skin_points
from drapeline.errors import InputError
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.pose_displacements import SimulatedFiles, SimulatedGarment
from drapeline.metrics.garment import inside_measures, surface_distances_mm
from drapeline.metrics.metric import Measured
from drapeline.metrics.table import join, summarise
from drapeline.models.smplicit.displacement_baselines import ClusterDisplacement
from drapeline.models.smplicit.displacement_network import DisplacementField
from drapeline.models.smplicit.repose import garment_weights
from drapeline.models.smplicit.worn_displacement import WornDisplacement
from drapeline.rule_log import progress
from drapeline.schema import Table

Measures = dict[str, float]
_MODEL = "smplicit"
_INSIDE = ("inside_share", "inside_1cm_share")
# Given a garment, its weights (V, 24) and body: displacements (N, V, 3), or (1, V, 3) of no pose.
_Predict = Callable[[SimulatedGarment, np.ndarray, BodyModel], np.ndarray]


@dataclass(frozen=True)
class _Variant:
    """A way to pose a garment: skinning, see `garment_weights`, after a displacement, or none."""

    skinning: str
    predict: _Predict | None = None


class DisplacementEvaluation:
    """Measures of held-out garments in motion.

    Args:
        network: trained.
        untrained: of the same settings, before its first step.
        baselines: of the training garments.
        bodies: by gender.
        seed: of the experiment.
    """

    def __init__(
        self,
        network: DisplacementField,
        untrained: DisplacementField,
        baselines: ClusterDisplacement,
        bodies: Mapping[str, BodyModel],
        *,
        seed: int,
    ) -> None:
        self._bodies, self._seed, self._name = bodies, seed, network.name
        self._variants = {
            "nearest": _Variant("nearest"),
            "smoothed": _Variant("smoothed"),
            "mean": _Variant("smoothed", _at_clusters(baselines, posed=False)),
            "ridge": _Variant("smoothed", _at_clusters(baselines, posed=True)),
            "network": _Variant("smoothed", _by_network(network)),
            "other_pose": _Variant("smoothed", _by_network(network, _take_other_frames)),
            "at_rest": _Variant("smoothed", _by_network(network, _stay_at_rest)),
            "untrained": _Variant("smoothed", _by_network(untrained)),
        }

    def run(self, split: str, found: Sequence[SimulatedFiles]) -> Table:
        """A row per variant and measure.

        Args:
            split: "val" or "test".
            found: garments of this split.

        Raises:
            InputError: there is none, or a file is unusable.
        """
        if not found:
            raise InputError(
                f"no simulated sample of the {split} split wears a garment of the model"
                f" '{self._name}', expected one or more; ask for more samples"
            )
        names = [files.name for files in found for _ in files.frames]
        samples = [files.sample for files in found for _ in files.frames]
        measured: dict[str, list[Measures]] = {name: [] for name in self._variants}
        for files in progress(found, total=len(found), label="garments"):
            for name, measures in self._measure(files.load()):
                measured[name] += measures
        return join(
            self._rows(name, measures, names, samples, split) for name, measures in measured.items()
        )

    def _measure(self, one: SimulatedGarment) -> Iterator[tuple[str, list[Measures]]]:
        body = self._bodies[one.gender]
        motions = tpose_motions(body, one.shape, one.poses)
        wearers, _ = posed_vertices(body, one.shape, one.poses)
        weights = {
            skinning: garment_weights(one.rest, body, one.shape, skinning)
            for skinning in {variant.skinning for variant in self._variants.values()}
        }
        for name, variant in self._variants.items():
            own = weights[variant.skinning]
            straight = straighten(one.rest.vertices, own, body, one.shape)
            if variant.predict is not None:
                straight = straight + variant.predict(one, own, body)
            moved = skin_points(straight, motions, own).astype(np.float32)
            pairs = zip(moved, one.cloth, wearers, strict=True)
            yield (
                name,
                [
                    motion_measures(Mesh(cloth, one.rest.faces), true, wearer, body.faces)
                    for cloth, true, wearer in pairs
                ],
            )

    def _rows(
        self,
        name: str,
        measures: Sequence[Measures],
        garments: Sequence[str],
        samples: Sequence[str],
        split: str,
    ) -> Table:
        variant = f"{_MODEL}_displacement_{self._name}_{name}"
        measured = map(Measured, samples, garments, measures)
        how = {"model": _MODEL, "variant": variant, "split": split, "seed": self._seed}
        return summarise(list(measured), **how, stream=(variant, split), by_source=False)


def motion_measures(
    predicted: Mesh, true: np.ndarray, wearer: np.ndarray, wearer_faces: np.ndarray
) -> Measures:
    """Measures of a garment in a frame against the simulated one, whose vertices are the same.

    Args:
        predicted: triangles, root-relative metres.
        true: (V, 3) simulated vertices.
        wearer, wearer_faces: (B, 3) and (G, 3) body in the pose.
    """
    simulated = Mesh(true, predicted.faces)
    to_true, to_predicted = surface_distances_mm(predicted, simulated)
    inside = inside_measures(predicted.vertices, wearer, wearer_faces)
    distance = np.linalg.norm(predicted.vertices - true, axis=1).mean()
    return {
        "vertex_error_mm": float(1000 * distance),
        "predicted_to_true_mm": to_true,
        "true_to_predicted_mm": to_predicted,
        "area_ratio": surface_area(predicted) / surface_area(simulated),
        **{name: inside[name] for name in _INSIDE},
    }


def surface_area(mesh: Mesh) -> float:
    """Square metres of a triangle mesh."""
    first, second, third = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    return float(np.linalg.norm(np.cross(second - first, third - first), axis=1).sum() / 2)


def _at_clusters(baselines: ClusterDisplacement, *, posed: bool) -> _Predict:
    def predict(one: SimulatedGarment, weights: np.ndarray, body: BodyModel) -> np.ndarray:
        given = one.poses if posed else None
        return baselines.displacements(one.rest, one.shape, GENDERS.index(one.gender), given)

    return predict


def _by_network(
    network: DisplacementField, change: Callable[[np.ndarray], np.ndarray] = lambda poses: poses
) -> _Predict:
    zero = np.zeros(network.codes.shape[1])

    def predict(one: SimulatedGarment, weights: np.ndarray, body: BodyModel) -> np.ndarray:
        worn = WornDisplacement(network, one.shape, GENDERS.index(one.gender), zero)
        poses = change(one.poses)
        motions = tpose_motions(body, one.shape, poses)
        return worn.displace(one.rest.vertices, weights, poses, motions)

    return predict


def _take_other_frames(poses: np.ndarray) -> np.ndarray:
    """Poses from half of the sequence earlier or later."""
    return np.roll(poses, len(poses) // 2, axis=0)


def _stay_at_rest(poses: np.ndarray) -> np.ndarray:
    return np.tile(REST_POSE, (len(poses), 1))
