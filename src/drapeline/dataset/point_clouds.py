"""Labelled point clouds of dressed bodies: what scanners around a person would see of a sample.

Garment4D's released code feeds on mesh vertices, whose order and number tell more than any scanner
could, and sees skin through cloth. Here points are drawn from the visible surface, anew in every
frame; the released code's way is an option.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import warp as wp

from drapeline.dataset.labels import BODY, LABELS
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.geometry.warp_mesh import start_warp, warp_mesh
from drapeline.seeding import rng_for
from drapeline.storage import atomic_folder, open_array, read_json, write_json

Visibility = Literal["all", "multi", "single"]
Protocol = Literal["surface", "vertices"]

# Height angles in degrees and cameras in each ring. None looks from below the floor, which lies
# about 0.9 m under the root joint.
_RIGS: dict[str, tuple[tuple[float, int], ...]] = {
    "all": ((-17.0, 6), (25.0, 6), (90.0, 1)),
    "multi": ((10.0, 4),),
    "single": ((10.0, 1),),
}
_AWAY_M = 3.0  # of the cameras from the root joint
_LIFT_M = 0.0005  # rays start so far before their own surface
_COVER_M = 0.02  # what has another surface so close before it is taken for covered
_HOLE = 0.05  # share of the points that one hole takes
_CHUNK = 32  # frames held in memory at once
# Frames after which the tree for rays is built anew. Boxes that follow a dancer grow: rays took
# three times as long after 40 frames, while building takes as long as the rays of one frame.
_REBUILD = 8


@dataclass(frozen=True)
class CloudSettings:
    """How point clouds are taken.

    Attributes:
        points: P, in every frame.
        noise_m: standard deviation of the error of each coordinate.
        missing: share of the visible surface that lies in holes.
        visibility: who looks: "all" is 13 cameras around and above, "multi" four in a ring,
            "single" one; the rings are turned at random, once for a sequence.
        protocol: "surface", or "vertices" as in the released code: half of the points are garment
            vertices, half body vertices, the same ones in every frame, covered or not; nobody
            looks then, and nothing is missing.
        seed: with a sequence's name and a frame's number it fixes the points.
    """

    points: int = 2048
    noise_m: float = 0.0
    missing: float = 0.0
    visibility: Visibility = "all"
    protocol: Protocol = "surface"
    seed: int = 0


class CloudRngs(NamedTuple):
    """Generators of one frame.

    Attributes:
        points: draws them and the holes.
        noise: draws the errors of their coordinates.
    """

    points: np.random.Generator
    noise: np.random.Generator


class CloudSampler:
    """Point clouds of meshes that move and keep their faces.

    The tree that rays are cast into follows the vertices and is built anew from time to time only.
    """

    def __init__(
        self,
        surfaces: Sequence[tuple[np.ndarray, str]],
        settings: CloudSettings,
        *,
        turn_rad: float = 0.0,
    ) -> None:
        """Name the faces.

        Args:
            surfaces: triangles (F, 3) and label of each mesh.
            settings: see there.
            turn_rad: of the cameras about the vertical.

        Raises:
            InputError: a label is none of `LABELS`.
        """
        unknown = [label for _, label in surfaces if label not in LABELS]
        if unknown:
            raise InputError(
                f"points of '{unknown[0]}' have no label, expected one of {', '.join(LABELS)}"
            )
        self.settings = settings
        self._triangles = [np.asarray(triangles) for triangles, _ in surfaces]
        self._codes = [LABELS.index(label) for _, label in surfaces]
        self._face_label = np.repeat(self._codes, [len(t) for t in self._triangles]).astype("u1")
        start_warp()
        self._label_of_face = wp.array(self._face_label, dtype=wp.uint8, device="cpu")
        self._cameras = wp.array(_rig(settings.visibility, turn_rad), dtype=wp.vec3, device="cpu")
        self._corners: np.ndarray | None = None
        self._mesh: wp.Mesh | None = None
        self._frames = 0

    def sample(
        self, vertices: Sequence[np.ndarray], rngs: CloudRngs
    ) -> tuple[np.ndarray, np.ndarray]:
        """The cloud of one frame.

        Args:
            vertices: (V, 3) of each mesh, in the order of the surfaces; as many in every frame.
            rngs: what draws the points, and their noise. With the protocol "vertices", equal
                generators choose equal vertices.

        Returns:
            Points (P, 3) float32 and labels (P,) uint8.

        Raises:
            InputError: the cameras see nothing.
        """
        settings, rng = self.settings, rngs.points
        if settings.protocol == "vertices":
            points, labels = self._vertex_sample(vertices, rng)
        else:
            count = int(np.ceil(settings.points / (1 - settings.missing)))
            points, labels = self._surface_sample(vertices, count, rng)
            kept = _outside_of_holes(points, count - settings.points, rng)
            points, labels = points[kept], labels[kept]
        if settings.noise_m:
            points = points + rngs.noise.normal(0, settings.noise_m, points.shape)
        return points.astype(np.float32), labels

    def _vertex_sample(
        self, vertices: Sequence[np.ndarray], rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        everything = np.concatenate(vertices)
        labels = np.repeat(self._codes, [len(v) for v in vertices]).astype(np.uint8)
        skin, cloth = np.flatnonzero(labels == 0), np.flatnonzero(labels)
        half = self.settings.points // 2 if len(cloth) else 0
        chosen = np.concatenate(
            [
                rng.choice(ids, count, replace=count > len(ids))
                for ids, count in ((skin, self.settings.points - half), (cloth, half))
                if count
            ]
        )
        return everything[chosen], labels[chosen]

    def _surface_sample(
        self, vertices: Sequence[np.ndarray], count: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """`count` points on what the cameras see, evenly by area."""
        everything = np.concatenate(vertices).astype(np.float32)
        mesh = self._placed(everything, [len(v) for v in vertices])
        a, b, c = (everything[self._corners[:, i]] for i in range(3))
        cross = np.cross(b - a, c - a)
        double_area = np.linalg.norm(cross, axis=1)
        normals = cross / np.maximum(double_area, 1e-20)[:, None]
        upto = np.cumsum(double_area, dtype=np.float64)
        points, labels = np.zeros((0, 3), np.float32), np.zeros(0, np.uint8)
        share, drawn = 1.0, 0  # the first round tells which share is seen
        while len(points) < count:
            wanted = int(1.05 * (count - len(points)) / share) + 16
            # One point in each of so many equal parts of the area. Rays from neighbours, one after
            # the other, pass through the same boxes of the tree.
            at = (np.arange(wanted) + rng.random(wanted)) / wanted
            face = np.searchsorted(upto, upto[-1] * at, side="right")
            face = np.minimum(face, len(upto) - 1)
            u, v = rng.random((2, wanted, 1), dtype=np.float32)
            u = np.sqrt(u)
            place = (1 - u) * a[face] + u * ((1 - v) * b[face] + v * c[face])
            seen = self._seen(mesh, place, normals[face], face)
            points = np.concatenate([points, place[seen]])
            labels = np.concatenate([labels, self._face_label[face][seen]])
            drawn += wanted
            share = max(len(points) / drawn, 0.02)
            if drawn > 1000 * count:
                raise InputError(
                    f"cameras '{self.settings.visibility}' see {len(points)} of {drawn} points of"
                    " a scene, expected a body within 2 m of its root joint"
                )
        order = rng.permutation(len(points))[:count]
        return points[order], labels[order]

    def _placed(self, vertices: np.ndarray, counts: Sequence[int]) -> wp.Mesh:
        if self._corners is None:
            starts = np.cumsum([0, *counts])[:-1]
            self._corners = np.concatenate(
                [t + start for t, start in zip(self._triangles, starts, strict=True)]
            ).astype(np.int32)
        if self._mesh is None or self._frames % _REBUILD == 0:
            self._mesh = warp_mesh(vertices, self._corners)
        else:
            self._mesh.points.assign(vertices)
            self._mesh.refit()
        self._frames += 1
        return self._mesh

    def _seen(
        self, mesh: wp.Mesh, points: np.ndarray, normals: np.ndarray, face: np.ndarray
    ) -> np.ndarray:
        """(n,) bool, which points on faces of a mesh any camera sees."""
        seen = wp.zeros(len(points), dtype=wp.bool, device="cpu")
        wp.launch(
            _look,
            dim=len(points),
            inputs=[
                mesh.id,
                self._label_of_face,
                wp.array(points, dtype=wp.vec3, device="cpu"),
                wp.array(normals, dtype=wp.vec3, device="cpu"),
                wp.array(face.astype(np.int32), dtype=int, device="cpu"),
                self._cameras,
            ],
            outputs=[seen],
            device="cpu",
        )
        return seen.numpy()


def _rig(visibility: Visibility, turn_rad: float) -> np.ndarray:
    """(C, 3) places of the cameras; the first of a ring stands before the body at turn 0."""
    places = []
    for height_deg, count in _RIGS[visibility]:
        around = turn_rad - np.pi / 2 + 2 * np.pi * np.arange(count) / count
        up = np.radians(height_deg)
        ring = [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around)]
        places.append(np.stack([*ring, np.full(count, np.sin(up))], axis=-1))
    return (_AWAY_M * np.concatenate(places)).astype(np.float32)


@wp.func
def _seen_by(
    mesh: wp.uint64, place: wp.vec3, normal: wp.vec3, camera: wp.vec3, two_sided: int
) -> bool:
    away = camera - place
    facing = wp.dot(normal, away)
    if facing <= 0.0 and two_sided == 0:
        return False
    far = wp.length(away)
    start = place + wp.sign(facing) * _LIFT_M * normal
    return not wp.mesh_query_ray_anyhit(mesh, start, away / far, far)


@wp.kernel
def _look(
    mesh: wp.uint64,
    label: wp.array(dtype=wp.uint8),
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    face: wp.array(dtype=int),
    cameras: wp.array(dtype=wp.vec3),
    seen: wp.array(dtype=wp.bool),
):
    index = wp.tid()
    place = points[index]
    normal = normals[index]
    own = label[face[index]]
    # One short ray settles most hidden points, which else would take one to every camera.
    cover = wp.mesh_query_ray(mesh, place + _LIFT_M * normal, normal, _COVER_M)
    if cover.result and label[cover.face] != own:
        return
    two_sided = wp.where(own == wp.uint8(0), 0, 1)  # cloth is, the body is seen from outside only
    best = wp.int32(0)  # a plain 0 would be a constant, which Warp does not let loops change
    straightest = wp.float32(0.0)
    for camera in range(cameras.shape[0]):
        facing = wp.dot(normal, wp.normalize(cameras[camera] - place))
        if two_sided == 1:
            facing = wp.abs(facing)
        if facing > straightest:
            straightest = facing
            best = camera
    if _seen_by(mesh, place, normal, cameras[best], two_sided):
        seen[index] = True
        return
    for camera in range(cameras.shape[0]):
        if camera != best and _seen_by(mesh, place, normal, cameras[camera], two_sided):
            seen[index] = True
            return


def _outside_of_holes(points: np.ndarray, missing: int, rng: np.random.Generator) -> np.ndarray:
    """(P - missing,) indices of the points that are left when holes have taken `missing` of them.

    A hole is a random point and those nearest to it.
    """
    left = np.arange(len(points))
    while missing:
        size = min(missing, max(round(_HOLE * len(points)), 1))
        centre = points[left[rng.integers(len(left))]]
        square = ((points[left] - centre) ** 2).sum(axis=1)
        left = np.delete(left, np.argpartition(square, size - 1)[:size])
        missing -= size
    return left


def cut_holes(
    points: np.ndarray, labels: np.ndarray, share: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A cloud with holes (figure 9): whole patches are taken away, and points left repeated.

    Args:
        points: (P, 3).
        labels: (P,).
        share: of the points that lie in holes, less than 1.
        rng: draws the holes, each of 5 % of the points, and the points that are repeated.

    Returns:
        Points (P, 3) and labels (P,) of the cloud outside of the holes, refilled to P.
    """
    count = len(points)
    left = _outside_of_holes(points, min(round(share * count), count - 1), rng)
    chosen = rng.permutation(np.resize(rng.permutation(left), count))
    return points[chosen], labels[chosen]


def corrupt_labels(
    labels: np.ndarray, accuracy: float, garment_label: int, rng: np.random.Generator
) -> np.ndarray:
    """Labels of which a share is right (figure 10).

    Args:
        labels: (P,) true labels.
        accuracy: share of the points that keep their label.
        garment_label: of the garment looked for: wrong points of it become body, others become it.
        rng: draws the points that are wrong.

    Returns:
        (P,) labels, as a copy.
    """
    out = labels.copy()
    wrong = rng.choice(len(labels), round((1 - accuracy) * len(labels)), replace=False)
    out[wrong] = np.where(labels[wrong] == garment_label, 0, garment_label)
    return out


@dataclass(frozen=True)
class CloudSequence:
    """Point clouds of all frames of a sequence, as `load_clouds` opens them.

    Attributes:
        points: (F, P, 3) float32 metres relative to the root joint, memory-mapped; no frames if
            the sequence was rejected.
        labels: (F, P) uint8 indices into `LABELS`, memory-mapped.
        about: `name`, `status`, `split`, and unless rejected `source` ("simulated"), `gender`,
            `garments`, `settings` and `fps`.
    """

    points: np.ndarray
    labels: np.ndarray
    about: Mapping[str, Any]

    def __len__(self) -> int:
        return len(self.points)

    @property
    def accepted(self) -> bool:
        """Whether there are clouds."""
        return self.about["status"] == "accepted"


def cloud_rngs(settings: CloudSettings, name: str, frame: int) -> CloudRngs:
    """The generators of a frame; where vertices are sampled, the same points in all of them."""
    noise = rng_for(settings.seed, "cloud noise", name, frame)
    if settings.protocol == "vertices":
        return CloudRngs(rng_for(settings.seed, "cloud", name), noise)
    return CloudRngs(rng_for(settings.seed, "cloud", name, frame), noise)


def rig_turn(settings: CloudSettings, name: str) -> float:
    """How far a sequence's cameras are turned about the vertical, rad."""
    return float(rng_for(settings.seed, "cloud", name, "cameras").uniform(-np.pi, np.pi))


def write_clouds(folder: str | Path, sample: str | Path, settings: CloudSettings) -> str:
    """Write the clouds of a simulated sample's frames: `points.npy`, `labels.npy`, `about.json`.

    Args:
        folder: replaced as a whole; of a rejected sample it holds `about.json` only.
        sample: folder as `write_sample` leaves it.
        settings: see there.

    Returns:
        The sample's status, "accepted" or "rejected".

    Raises:
        InputError: a file of the sample is missing or damaged.
    """
    record = read_record(sample)
    name = record.meta["id"]
    about = {"name": name, "status": record.meta["status"], "split": record.meta["split"]}
    with atomic_folder(folder) as scratch:
        if record.accepted:
            with Sample(sample) as sequence:
                about |= {
                    "source": "simulated",
                    "gender": sequence.gender,
                    "garments": list(sequence.garments),
                    "settings": asdict(settings),
                    "fps": FPS,
                }
                _write_frames(scratch, sequence, settings, name)
        write_json(scratch / "about.json", about)
    return about["status"]


def _write_frames(folder: Path, sequence: Sample, settings: CloudSettings, name: str) -> None:
    meshes = [sequence.body_mesh(), *map(sequence.mesh, sequence.garments)]
    names = (BODY, *sequence.garments)
    sampler = CloudSampler(
        [(mesh.triangles, label) for mesh, label in zip(meshes, names, strict=True)],
        settings,
        turn_rad=rig_turn(settings, name),
    )
    points, labels = create_clouds(folder, sequence.frame_count, settings.points)
    for start in range(0, sequence.frame_count, _CHUNK):
        stop = min(start + _CHUNK, sequence.frame_count)
        parts = [
            sequence.body_vertices(start, stop, frame="root"),
            *(sequence.vertices(g, start, stop, frame="root") for g in sequence.garments),
        ]
        for frame in range(start, stop):
            points[frame], labels[frame] = sampler.sample(
                [part[frame - start] for part in parts], cloud_rngs(settings, name, frame)
            )
    points.flush()
    labels.flush()


def create_clouds(folder: Path, frames: int, points: int) -> tuple[np.memmap, np.memmap]:
    """New `points.npy` (F, P, 3) float32 and `labels.npy` (F, P) uint8 in a folder, to fill."""
    return (
        np.lib.format.open_memmap(folder / "points.npy", "w+", np.float32, (frames, points, 3)),
        np.lib.format.open_memmap(folder / "labels.npy", "w+", np.uint8, (frames, points)),
    )


def load_clouds(folder: str | Path) -> CloudSequence:
    """Open clouds without reading them.

    Raises:
        InputError: a file is missing or damaged, or the files do not fit together.
    """
    folder = Path(folder)
    about = read_json(folder / "about.json")
    if about.get("status") != "accepted":
        return CloudSequence(np.zeros((0, 0, 3), np.float32), np.zeros((0, 0), np.uint8), about)
    points, labels = open_array(folder / "points.npy"), open_array(folder / "labels.npy")
    if points.shape != (*labels.shape, 3):
        raise InputError(
            f"{folder}: points.npy has shape {points.shape} and labels.npy {labels.shape},"
            " expected (F, P, 3) and (F, P)"
        )
    return CloudSequence(points, labels, about)
