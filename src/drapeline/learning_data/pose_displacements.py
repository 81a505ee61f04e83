"""What poses do to simulated garments beside the skinning (SMPLicit 3.5), as mapped arrays.

A garment at rest goes to the T-pose by its smoothed skinning weights, and so does every simulated
frame of it. The displacement is the difference of the two there, in the frame of the body's model.
Skinning a garment at rest that was displaced so gives the simulated frame back.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drapeline.bodies.kinematics import axis_angle_to_matrix
from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.rest_skinning import straighten, tpose_motions
from drapeline.bodies.skinning import unskin_points
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.errors import InputError
from drapeline.frames import GENDERS, JOINT_NAMES, REST_POSE
from drapeline.geometry.mesh import Mesh, edges
from drapeline.outfits.garment_types import GARMENTS
from drapeline.rule_log import progress
from drapeline.seeding import rng_for
from drapeline.storage import atomic_folder, create_array, load_npz, open_arrays, save_npz

# Cloth does not reach the ends of limbs, and a turn of the whole body is told by gravity.
_LEFT_OUT = ("pelvis", "ankle", "foot", "neck", "head", "wrist", "hand")
POSE_JOINTS = [
    index
    for index, name in enumerate(JOINT_NAMES)
    if name.removeprefix("left_").removeprefix("right_") not in _LEFT_OUT
]
POSE_NUMBERS = 9 * len(POSE_JOINTS) + 3
# Share of each training sequence, at its end, that stands in for a validation split without any.
_HELD_BACK = 1 / 6

_GARMENTS = {
    "sample": "str g",
    "split": "str g",
    "garment": f"int<{len(GARMENTS)} g",
    "shape": "float g 10",
    "gender": f"int<{len(GENDERS)} g",
    **dict.fromkeys(("vertices", "edges", "frames"), "int g"),
}
_PER_POINT = ("points", "straight", "weights", "displacement")
_ARRAYS = {
    "points": "float v 3",
    "straight": "float v 3",
    "weights": "float v 24",
    "displacement": "float * 3",
    "edges": "int * 2",
    "pose": f"float n {POSE_NUMBERS}",
    "motions": "float n 24 3 4",
}


def encode_poses(poses: np.ndarray) -> np.ndarray:
    """Poses as networks take them, zero at rest.

    Args:
        poses: (N, 72) axis-angle, rad.

    Returns:
        (N, `POSE_NUMBERS`) float32: the rotation matrices of `POSE_JOINTS` and the direction of
        gravity as the root joint has it, all minus what they are at rest. Where the body faces does
        not count.
    """
    both = np.concatenate([REST_POSE[None], np.asarray(poses, dtype=np.float64)])
    rotations = axis_angle_to_matrix(both.reshape(-1, 24, 3))
    gravity = -rotations[:, 0, 2]  # R^T (0, 0, -1)
    joints = rotations[:, POSE_JOINTS].reshape(len(both), -1)
    numbers = np.concatenate([joints, gravity], axis=1)
    return (numbers[1:] - numbers[0]).astype(np.float32)


class SimulatedGarment(NamedTuple):
    """A garment of a simulated sample, at rest and in frames of its motion.

    Attributes:
        gender: of the wearer.
        shape: (10,) of the wearer.
        rest: triangles at rest, root-relative metres.
        poses: (T, 72) rad.
        cloth: (T, V, 3) float32 simulated vertices, root-relative metres.
    """

    gender: str
    shape: np.ndarray
    rest: Mesh
    poses: np.ndarray
    cloth: np.ndarray


@dataclass(frozen=True)
class SimulatedFiles:
    """Where a garment of a simulated sample is; not all of them fit into memory.

    Attributes:
        sample: id of the sample.
        split: "train", "val" or "test".
        name: the garment's type.
        folder: of the sample.
        frames: (T,) numbers of the frames that are read.
    """

    sample: str
    split: str
    name: str
    folder: Path
    frames: np.ndarray

    def rest(self) -> Mesh:
        """The garment at rest as triangles, root-relative metres.

        Raises:
            InputError: the file is missing or damaged.
        """
        with Sample(self.folder) as sample:
            mesh = sample.mesh(self.name)
        return Mesh(mesh.vertices, mesh.triangles)

    def load(self) -> SimulatedGarment:
        """Read the garment.

        Raises:
            InputError: a file is missing or damaged.
        """
        with Sample(self.folder) as sample:
            # One by one, so that frames between them are never in memory.
            cloth = [sample.vertices(self.name, k, k + 1, frame="root")[0] for k in self.frames]
            return SimulatedGarment(
                gender=sample.gender,
                shape=np.asarray(sample.info.shape),
                rest=self.rest(),
                poses=np.asarray(sample.info.poses)[self.frames],
                cloth=np.stack(cloth),
            )


def simulated_files(
    samples: Iterable[str | Path],
    garments: Sequence[str],
    splits: Sequence[str],
    *,
    frame_step: int,
) -> list[SimulatedFiles]:
    """Garments of some types among the accepted samples of some splits.

    Args:
        samples: folders as `write_sample` leaves them.
        garments: types.
        splits: whose samples are wanted.
        frame_step: of the frames that are read.

    Raises:
        InputError: a file of a sample is missing or damaged.
    """
    found = []
    for folder in map(Path, samples):
        record = read_record(folder)
        if record.accepted and record.meta["split"] in splits:
            with Sample(folder) as sample:
                frames = np.arange(0, sample.frame_count, frame_step)
                worn = [name for name in sample.garments if name in garments]
            split = record.meta["split"]
            found += [SimulatedFiles(sample.id, split, name, folder, frames) for name in worn]
    return found


def collect_displacements(
    output: str | Path,
    samples: Iterable[str | Path],
    garments: Sequence[str],
    bodies: Mapping[str, BodyModel],
    *,
    frame_step: int,
) -> int:
    """Write the displacements of the training and validation garments of some types.

    Args:
        output: folder, replaced as a whole.
        samples: folders as `write_sample` leaves them, of any split.
        garments: types.
        bodies: whole, by gender.
        frame_step: of the frames that are taken.

    Returns:
        Number of frames of garments.

    Raises:
        InputError: no garment of these types is for training, or a file is unusable.
    """
    found = simulated_files(samples, garments, ("train", "val"), frame_step=frame_step)
    if not any(files.split == "train" for files in found):
        raise InputError(
            f"{output}: no simulated sample for training wears {' or '.join(garments)}, expected"
            " one or more; ask for more samples"
        )
    meshes = [files.rest() for files in found]
    about = {
        "sample": np.array([files.sample for files in found]),
        "split": np.array([files.split for files in found]),
        "garment": np.array([GARMENTS.index(files.name) for files in found], dtype=np.int8),
        "vertices": np.array([len(mesh.vertices) for mesh in meshes]),
        "edges": np.array([len(edges(mesh.faces)) for mesh in meshes]),
        "frames": np.array([len(files.frames) for files in found]),
    }
    with atomic_folder(output) as scratch:
        wearers = _write_arrays(scratch, found, about, bodies)
        save_npz(scratch / "garments.npz", **about, **wearers)
    return int(about["frames"].sum())


def _write_arrays(
    folder: Path,
    found: Sequence[SimulatedFiles],
    about: Mapping[str, np.ndarray],
    bodies: Mapping[str, BodyModel],
) -> dict[str, np.ndarray]:
    """Fill the mapped arrays, one garment at a time, and return shape and gender of the wearers."""
    vertices, frames = about["vertices"], about["frames"]
    sizes = {
        "points": (vertices.sum(), 3),
        "straight": (vertices.sum(), 3),
        "weights": (vertices.sum(), 24),
        "edges": (about["edges"].sum(), 2),
        "displacement": ((vertices * frames).sum(), 3),
        "pose": (frames.sum(), POSE_NUMBERS),
        "motions": (frames.sum(), 24, 3, 4),
    }
    arrays = {
        name: create_array(
            folder / f"{name}.npy", np.int32 if name == "edges" else np.float32, size
        )
        for name, size in sizes.items()
    }
    filled = dict.fromkeys(arrays, 0)
    shapes, genders = [], []
    for files in progress(found, total=len(found), label="garments"):
        one = files.load()
        for name, values in _garment_arrays(files, one, bodies[one.gender]).items():
            end = filled[name] + len(values)
            arrays[name][filled[name] : end] = values
            filled[name] = end
        shapes.append(one.shape)
        genders.append(GENDERS.index(one.gender))
    for array in arrays.values():
        array.flush()
    return {
        "shape": np.array(shapes, dtype=np.float32),
        "gender": np.array(genders, dtype=np.int8),
    }


def _garment_arrays(
    files: SimulatedFiles, one: SimulatedGarment, body: BodyModel
) -> dict[str, np.ndarray]:
    at_rest = rest_body(body, one.shape)
    weights = interpolated_weights(one.rest.vertices, one.rest.faces, at_rest, body.weights)
    straight = straighten(one.rest.vertices, weights, body, one.shape)
    motions = tpose_motions(body, one.shape, one.poses)
    displacement = unskin_points(one.cloth, motions, weights) - straight
    if not np.isfinite(displacement).all():
        raise InputError(
            f"{files.folder}: {files.name} holds NaN or infinity, expected metres in every frame"
        )
    return {
        "points": one.rest.vertices,
        "straight": straight,
        "weights": weights,
        "edges": edges(one.rest.faces),
        "displacement": displacement.reshape(-1, 3),
        "pose": encode_poses(one.poses),
        "motions": motions,
    }


class DisplacementData:
    """Displacements of garments as `collect_displacements` wrote them; a row is a frame of one.

    G garments, N frames of all of them.

    Args:
        folder: that it wrote.

    Attributes:
        sample, split: (G,) names.
        garment: (G,) int8, index into `GARMENTS`.
        shape: (G, 10) float32.
        gender: (G,) int8, 0 female, 1 male.
        garment_index: (N,) which garment a row is of.
        pose: (N, `POSE_NUMBERS`), memory-mapped.

    Raises:
        InputError: a file is missing, or the files count different rows.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        table = load_npz(self.folder / "garments.npz", _GARMENTS)
        self.sample, self.split, self.garment = (table[k] for k in ("sample", "split", "garment"))
        self.shape, self.gender = table["shape"], table["gender"]
        self._frames, self._vertices = table["frames"], table["vertices"]
        self.garment_index = np.repeat(np.arange(len(self.garment)), self._frames)
        self._arrays = open_arrays(self.folder, _ARRAYS)
        self.pose = self._arrays["pose"]
        moved = self._frames * self._vertices
        self._parts = {
            "points": _parts(self._vertices),
            "edges": _parts(table["edges"]),
            "displacement": _parts(moved),
            "pose": _parts(self._frames),
        }
        for name, parts in self._parts.items():
            if len(self._arrays[name]) != parts[-1].stop:
                raise InputError(
                    f"{self.folder}/{name}.npy: has {len(self._arrays[name])} rows, expected"
                    f" {parts[-1].stop} as in garments.npz"
                )

    def __len__(self) -> int:
        return len(self.garment_index)

    def arrays(self) -> dict[str, np.ndarray]:
        """Every array by name, for a digest of the data."""
        return {**self._arrays, "split": self.split, "shape": self.shape, "gender": self.gender}

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of "train" or "val".

        Without a validation garment, the last sixth of each training sequence is held back for it.
        """
        if (self.split == "val").any():
            return np.flatnonzero(self.split[self.garment_index] == split)
        number = np.concatenate([np.arange(count) for count in self._frames])
        kept = np.ceil(self._frames * (1 - _HELD_BACK))[self.garment_index]
        return np.flatnonzero((number < kept) == (split == "train"))

    def names(self, rows: np.ndarray) -> list[str]:
        """Sample and garment of rows, for messages."""
        garments = self.garment_index[rows]
        return [f"{self.sample[g]}/{GARMENTS[self.garment[g]]}" for g in garments]

    def garment_points(self, garment: int) -> np.ndarray:
        """(V, 3) float32 vertices of a garment at rest, root-relative metres."""
        return self._arrays["points"][self._parts["points"][garment]]

    def displacements(self, row: int) -> np.ndarray:
        """(V, 3) float32 metres of all vertices of a row, in the T-pose."""
        garment = int(self.garment_index[row])
        count = int(self._vertices[garment])
        number = row - self._parts["pose"][garment].start
        start = self._parts["displacement"][garment].start + number * count
        return self._arrays["displacement"][start : start + count]

    def batch(self, rows: np.ndarray, count: int, seed: int) -> dict[str, Any]:
        """Edges of rows (B,), drawn for each row by the seed, with what their ends are and do.

        Args:
            rows: of which garments in which frames.
            count: edges per row, E.
            seed: of the draw.

        Returns:
            `points` (B, 2 E, 3) at rest and `straight` in the T-pose, the starts of all edges and
            then their ends; their `weights` (B, 2 E, 24) and `displacement` (B, 2 E, 3); `pose`
            and `motions` (B, 24, 3, 4) of the frames; `shape`, `gender`, `garment_index`, `names`.
        """
        found: dict[str, list[np.ndarray]] = {name: [] for name in _PER_POINT}
        for row in rows.tolist():
            garment = int(self.garment_index[row])
            pairs = self._arrays["edges"][self._parts["edges"][garment]]
            chosen = rng_for(seed, "edges", row).integers(len(pairs), size=count)
            ends = pairs[chosen].T.ravel()
            for name in ("points", "straight", "weights"):
                found[name].append(self._arrays[name][self._parts["points"][garment]][ends])
            found["displacement"].append(self.displacements(row)[ends])
        garments = self.garment_index[rows]
        return {
            **{name: np.stack(values) for name, values in found.items()},
            "pose": self.pose[rows],
            "motions": self._arrays["motions"][rows],
            "shape": self.shape[garments],
            "gender": self.gender[garments],
            "garment_index": garments,
            "names": self.names(rows),
        }


def _parts(counts: np.ndarray) -> list[slice]:
    """Where each garment's rows are, for how many it has."""
    ends = np.cumsum(counts).tolist()
    return [slice(start, end) for start, end in zip([0, *ends], ends, strict=False)]
