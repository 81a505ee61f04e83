"""Labelled point clouds of dressed bodies: what scanners around a person would see of a sample.

Garment4D's released code uses mesh vertices as points: their order and number reveal more than any
scanner could, and skin is visible through cloth. Here points are drawn from the visible surface,
independently in every frame; the protocol of the released code is available as an option.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from scipy.spatial import ConvexHull

from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.dataset.settings import CloudSettings, Visibility
from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.geometry.warp_mesh import move_mesh, start_warp, warp_mesh
from drapeline.outfits.garment_types import BODY, LABELS
from drapeline.seeding import rng_for
from drapeline.storage import ArrayFiles, atomic_folder, open_arrays, read_json, write_json

# Elevation in degrees and number of cameras of each ring. No camera is below the floor, which lies
# about 0.9 m under the root joint.
_RIGS: dict[str, tuple[tuple[float, int], ...]] = {
    "all": ((-17.0, 6), (25.0, 6), (90.0, 1)),
    "multi": ((10.0, 4),),
    "single": ((10.0, 1),),
}
_CAMERA_DISTANCE_M = 3.0  # from the root joint
_LIFT_M = 0.0005  # rays start this far in front of their own surface
_COVER_M = 0.02  # a point with another surface this close in front of it counts as covered
_FLIP = 100.0  # radius of the sphere that points are flipped at, in distances of the farthest one
_HOLE = 0.05  # share of the points that a single hole removes
_CHUNK = 32  # frames held in memory at once
# Frames after which the tree for ray casting is rebuilt. Boxes that follow a dancer grow: rays took
# three times as long after 40 frames, while rebuilding takes as long as the rays of one frame.
_REBUILD = 8


class CloudRngs(NamedTuple):
    """Random generators of a frame's points and holes, and of the noise of their coordinates."""

    points: np.random.Generator
    noise: np.random.Generator


class CloudSampler:
    """Samples point clouds of meshes that move but keep their faces.

    The tree used for ray casting is refitted to the vertices of each frame and rebuilt only from
    time to time.
    """

    def __init__(
        self,
        surfaces: Sequence[tuple[np.ndarray, str]],
        settings: CloudSettings,
        *,
        turn_rad: float = 0.0,
    ) -> None:
        """Set up the labelled triangles and the cameras.

        Args:
            surfaces: triangles (F, 3) and label of each mesh.
            turn_rad: rotation of the cameras about the vertical axis.

        Raises:
            InputError: a label is not in `LABELS`.
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
        """Sample one frame's points (P, 3) float32 and labels (P,) uint8.

        Args:
            vertices: (V, 3) of each mesh in metres, in the order of the surfaces; V must not
                change from frame to frame.
            rngs: generators of the points and of their noise. With the protocol "vertices", equal
                generators choose equal vertices.

        Raises:
            InputError: the cameras see nothing.
        """
        settings, rng = self.settings, rngs.points
        if settings.protocol == "vertices":
            points, labels = self._sample_vertices(vertices, rng)
        else:
            count = int(np.ceil(settings.points / (1 - settings.missing)))
            points, labels = self._sample_surface(vertices, count, rng)
            kept = _remaining_after_holes(points, count - settings.points, rng)
            points, labels = points[kept], labels[kept]
        if settings.noise_m:
            points = points + rngs.noise.normal(0, settings.noise_m, points.shape)
        return points.astype(np.float32), labels

    def _sample_vertices(
        self, vertices: Sequence[np.ndarray], rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        all_vertices = np.concatenate(vertices)
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
        return all_vertices[chosen], labels[chosen]

    def _sample_surface(
        self, vertices: Sequence[np.ndarray], count: int, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw `count` points uniformly by area from the surface that the cameras see."""
        all_vertices = np.concatenate(vertices).astype(np.float32)
        mesh, corners = self._move_mesh(all_vertices, [len(v) for v in vertices])
        a, b, c = (all_vertices.take(ids, axis=0) for ids in corners.T)
        cross = np.cross(b - a, c - a)
        double_area = np.linalg.norm(cross, axis=1)
        cumulative_area = np.cumsum(double_area, dtype=np.float64)
        points, labels = np.zeros((0, 3), np.float32), np.zeros(0, np.uint8)
        visible_share, drawn = 1.0, 0  # the share is estimated from the first round
        while len(points) < count:
            wanted = int(1.05 * (count - len(points)) / visible_share) + 16
            # Stratified by area: one point in each of `wanted` equal parts. Consecutive rays then
            # start close together and pass through the same boxes of the tree.
            at = (np.arange(wanted) + rng.random(wanted)) / wanted
            face = np.searchsorted(cumulative_area, cumulative_area[-1] * at, side="right")
            face = np.minimum(face, len(cumulative_area) - 1)
            u, v = rng.random((2, wanted, 1), dtype=np.float32)
            u = np.sqrt(u)
            candidates = (1 - u) * a[face] + u * ((1 - v) * b[face] + v * c[face])
            normals = cross[face] / np.maximum(double_area[face], 1e-20)[:, None]
            visible = self._find_visible(mesh, candidates, normals, face)
            points = np.concatenate([points, candidates[visible]])
            labels = np.concatenate([labels, self._face_label[face][visible]])
            drawn += wanted
            visible_share = max(len(points) / drawn, 0.02)
            if drawn > 1000 * count:
                raise InputError(
                    f"cameras '{self.settings.visibility}' see {len(points)} of {drawn} points of"
                    " a scene, expected a body within 2 m of its root joint"
                )
        order = rng.permutation(len(points))[:count]
        return points[order], labels[order]

    def _move_mesh(self, vertices: np.ndarray, counts: Sequence[int]) -> tuple[wp.Mesh, np.ndarray]:
        if self._corners is None:
            starts = np.cumsum([0, *counts])[:-1]
            self._corners = np.concatenate(
                [t + start for t, start in zip(self._triangles, starts, strict=True)]
            ).astype(np.int32)
        if self._mesh is None or self._frames % _REBUILD == 0:
            self._mesh = warp_mesh(vertices, self._corners)
        else:
            move_mesh(self._mesh, vertices)
        self._frames += 1
        return self._mesh, self._corners

    def _find_visible(
        self, mesh: wp.Mesh, points: np.ndarray, normals: np.ndarray, face: np.ndarray
    ) -> np.ndarray:
        """(n,) bool, which points on the faces of a mesh are visible to at least one camera."""
        visible = wp.zeros(len(points), dtype=wp.bool, device="cpu")
        wp.launch(
            _mark_visible,
            dim=len(points),
            inputs=[
                mesh.id,
                self._label_of_face,
                wp.array(points, dtype=wp.vec3, device="cpu"),
                wp.array(normals, dtype=wp.vec3, device="cpu"),
                wp.array(face.astype(np.int32), dtype=int, device="cpu"),
                self._cameras,
            ],
            outputs=[visible],
            device="cpu",
        )
        return visible.numpy()


def _rig(visibility: Visibility, turn_rad: float) -> np.ndarray:
    """(C, 3) camera positions; at turn 0, the first of each ring is in front of the body."""
    rings = [
        camera_ring(count, turn_rad - np.pi / 2, elevation_deg)
        for elevation_deg, count in _RIGS[visibility]
    ]
    return np.concatenate(rings).astype(np.float32)


def camera_ring(count: int, turn_rad: float, elevation_deg: float = 0.0) -> np.ndarray:
    """(C, 3) cameras evenly around the root joint; at turn 0, the first is at the body's left."""
    azimuth = turn_rad + 2 * np.pi * np.arange(count) / count
    elevation = np.radians(elevation_deg)
    ring = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)]
    return _CAMERA_DISTANCE_M * np.stack([*ring, np.full(count, np.sin(elevation))], axis=-1)


@wp.func
def _is_visible_from(
    camera: wp.vec3, mesh: wp.uint64, point: wp.vec3, normal: wp.vec3, two_sided: int
) -> bool:
    to_camera = camera - point
    facing = wp.dot(normal, to_camera)
    if facing <= 0.0 and two_sided == 0:
        return False
    distance = wp.length(to_camera)
    start = point + wp.sign(facing) * _LIFT_M * normal
    return not wp.mesh_query_ray_anyhit(mesh, start, to_camera / distance, distance)


@wp.kernel
def _mark_visible(
    mesh: wp.uint64,
    label: wp.array[wp.uint8],
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    face: wp.array[int],
    cameras: wp.array[wp.vec3],
    visible: wp.array[wp.bool],
):
    index = wp.tid()
    point = points[index]
    normal = normals[index]
    own_label = label[face[index]]
    # A short ray rules out most hidden points, which would otherwise need a ray to every camera.
    cover = wp.mesh_query_ray(mesh, point + _LIFT_M * normal, normal, _COVER_M)
    if cover.result and label[cover.face] != own_label:
        return
    two_sided = wp.where(own_label == wp.uint8(0), 0, 1)  # cloth is; skin is seen from outside only
    best = wp.int32(0)  # a plain 0 would be a constant, which Warp does not let loops change
    best_facing = wp.float32(0.0)
    for camera in range(cameras.shape[0]):
        facing = wp.dot(normal, wp.normalize(cameras[camera] - point))
        if two_sided == 1:
            facing = wp.abs(facing)
        if facing > best_facing:
            best_facing = facing
            best = camera
    if _is_visible_from(cameras[best], mesh, point, normal, two_sided):
        visible[index] = True
        return
    for camera in range(cameras.shape[0]):
        if camera != best and _is_visible_from(cameras[camera], mesh, point, normal, two_sided):
            visible[index] = True
            return


def _remaining_after_holes(
    points: np.ndarray, missing: int, rng: np.random.Generator
) -> np.ndarray:
    """(P - missing,) indices of the points that remain after holes have removed `missing` points.

    A hole consists of a random point and the points nearest to it.
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
    """Remove whole patches of a cloud and repeat remaining points (Garment4D, figure 9).

    Args:
        points: (P, 3).
        labels: (P,).
        share: share of the points that lie in holes, less than 1.
        rng: draws the holes, each of 5 % of the points, and the points that are repeated.

    Returns:
        Points (P, 3) and labels (P,) of the cloud outside the holes, refilled to P points.
    """
    count = len(points)
    left = _remaining_after_holes(points, min(round(share * count), count - 1), rng)
    chosen = rng.permutation(np.resize(rng.permutation(left), count))
    return points[chosen], labels[chosen]


def find_seen(cameras: np.ndarray, cloud: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(P,) indices of the points of a cloud (P, 3) that cameras (C, 3) see, repeated to as many.

    Points that are hidden behind others are found by flipping the cloud at a sphere around each
    camera: what is seen is on its convex hull (Katz, Tal and Basri, Direct Visibility of Point
    Sets, 2007).
    """
    found = []
    for camera in cameras:
        rays = cloud.astype(np.float64) - camera
        away = np.linalg.norm(rays, axis=1, keepdims=True)
        flipped = rays + 2 * (_FLIP * away.max() - away) * rays / away
        hull = ConvexHull(np.concatenate([flipped, np.zeros((1, 3))])).vertices
        found.append(hull[hull < len(cloud)])
    left = np.unique(np.concatenate(found))
    return rng.permutation(np.resize(rng.permutation(left), len(cloud)))


def corrupt_labels(
    labels: np.ndarray, accuracy: float, garment_label: int, rng: np.random.Generator
) -> np.ndarray:
    """Labels (P,) of which a random share is wrong (Garment4D, figure 10).

    Args:
        labels: (P,) true labels.
        accuracy: share of the points that keep their label.
        garment_label: label of the target garment. Its points are relabelled as body, points of
            any other label are relabelled as the garment.
        rng: draws the points to relabel.
    """
    out = labels.copy()
    wrong = rng.choice(len(labels), round((1 - accuracy) * len(labels)), replace=False)
    out[wrong] = np.where(labels[wrong] == garment_label, 0, garment_label)
    return out


@dataclass(frozen=True)
class CloudSequence:
    """Point clouds of all frames of a sequence, as opened by `load_clouds`.

    Attributes:
        points: (F, P, 3) float32 metres relative to the root joint, memory-mapped; F is 0 if the
            sample was not accepted.
        labels: (F, P) uint8 indices into `LABELS`, memory-mapped.
        about: `name`, `status` and `split`, and for accepted samples `source` ("simulated"),
            `gender`, `garments`, `settings` and `fps`.
    """

    points: np.ndarray
    labels: np.ndarray
    about: Mapping[str, Any]

    def __len__(self) -> int:
        return len(self.points)

    @property
    def accepted(self) -> bool:
        """Whether the sample was accepted, so that there are clouds."""
        return self.about["status"] == "accepted"


def cloud_rngs(settings: CloudSettings, name: str, frame: int) -> CloudRngs:
    """Random generators of a frame; vertices are drawn once per sequence, surfaces per frame."""
    noise = rng_for(settings.seed, "cloud noise", name, frame)
    if settings.protocol == "vertices":
        return CloudRngs(rng_for(settings.seed, "cloud", name), noise)
    return CloudRngs(rng_for(settings.seed, "cloud", name, frame), noise)


def rig_turn(settings: CloudSettings, name: str) -> float:
    """Random rotation of a sequence's cameras about the vertical axis, in radians."""
    return float(rng_for(settings.seed, "cloud", name, "cameras").uniform(-np.pi, np.pi))


def write_clouds(folder: str | Path, sample_folder: str | Path, settings: CloudSettings) -> str:
    """Write the clouds of a simulated sample's frames: `points.npy`, `labels.npy`, `about.json`.

    Args:
        folder: replaced as a whole; for a rejected sample it holds only `about.json`.
        sample_folder: folder of the sample, as written by `write_sample`.

    Returns:
        The sample's status, "accepted" or "rejected".

    Raises:
        InputError: a file of the sample is missing or damaged.
    """
    record = read_record(sample_folder)
    name = record.meta["id"]
    about = {"name": name, "status": record.meta["status"], "split": record.meta["split"]}
    with atomic_folder(folder) as scratch:
        if record.accepted:
            with Sample(sample_folder) as sample:
                about |= {
                    "source": "simulated",
                    "gender": sample.gender,
                    "garments": list(sample.garments),
                    "settings": settings.plain(),
                    "fps": FPS,
                }
                _write_frames(scratch, sample, settings, name)
        write_json(scratch / "about.json", about)
    return about["status"]


def _write_frames(folder: Path, sample: Sample, settings: CloudSettings, name: str) -> None:
    meshes = [sample.body_mesh(), *map(sample.mesh, sample.garments)]
    names = (BODY, *sample.garments)
    sampler = CloudSampler(
        [(mesh.triangles, label) for mesh, label in zip(meshes, names, strict=True)],
        settings,
        turn_rad=rig_turn(settings, name),
    )
    files = ArrayFiles(folder, cloud_layouts(sample.frame_count, settings.points))
    for start in range(0, sample.frame_count, _CHUNK):
        stop = min(start + _CHUNK, sample.frame_count)
        parts = [
            sample.body_vertices(start, stop, frame="root"),
            *(sample.vertices(g, start, stop, frame="root") for g in sample.garments),
        ]
        for frame in range(start, stop):
            points, labels = sampler.sample(
                [part[frame - start] for part in parts], cloud_rngs(settings, name, frame)
            )
            files.append(points=points[None], labels=labels[None])
    files.flush()


def cloud_layouts(frames: int, points: int) -> dict[str, tuple[type, tuple[int, ...]]]:
    """Layouts of `points.npy` (F, P, 3) and `labels.npy` (F, P); see `ArrayFiles`."""
    return {"points": (np.float32, (frames, points, 3)), "labels": (np.uint8, (frames, points))}


_ABOUT = {"name": str, "status": str, "split": str, "garments?": [str], "gender?": str}


def load_clouds(folder: str | Path) -> CloudSequence:
    """Open the clouds of a sequence without reading them.

    Raises:
        InputError: a file is missing or damaged, or the files do not match.
    """
    folder = Path(folder)
    about = read_json(folder / "about.json", _ABOUT)
    if about["status"] != "accepted":
        return CloudSequence(np.zeros((0, 0, 3), np.float32), np.zeros((0, 0), np.uint8), about)
    arrays = open_arrays(folder, {"points": "float f p 3", "labels": "int f p"})
    return CloudSequence(arrays["points"], arrays["labels"], about)
