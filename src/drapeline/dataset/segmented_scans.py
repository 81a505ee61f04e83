"""Segmented scans: points of a dressed person, each known to be skin or cloth of a garment.

They come from simulated samples, with noise and a body that is off by as much as an estimate, or
from a user's files. P points of a scan, T frames of a window around one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.point_clouds import CloudRngs, CloudSampler
from drapeline.dataset.reader import Sample
from drapeline.dataset.scans import ScanSequence
from drapeline.dataset.settings import CloudSettings, ScanSettings
from drapeline.errors import InputError
from drapeline.outfits.garment_types import BODY, GARMENTS, LABELS, layered
from drapeline.seeding import rng_for
from drapeline.storage import load_npz, save_npz

OTHER = 255  # label of cloth of garments that are not looked for


class ScanWindow(NamedTuple):
    """Frames in a row, the scanned one in the middle, with the body as estimated or as fitted."""

    points: np.ndarray  # (T, P, 3) float32 metres, relative to the body's root joint
    labels: np.ndarray  # (T, P) uint8
    poses: np.ndarray  # (T, 72) axis-angles, rad
    trans: np.ndarray  # (T, 3) of the root joint, metres above the floor

    @property
    def middle(self) -> int:
        """The scanned frame."""
        return len(self.points) // 2

    def shifted(self, shift: np.ndarray) -> "ScanWindow":
        """With the root joint elsewhere, by (3,) metres in all frames."""
        points = (self.points - shift).astype(np.float32)
        return self._replace(points=points, trans=self.trans + shift)


@dataclass(frozen=True)
class SegmentedScan:
    """One frame of a dressed person."""

    name: str  # unique among scans
    frame: int  # its number in the sample or in the user's scans
    points: np.ndarray  # (P, 3) float32 metres, in a world whose Z is up
    labels: np.ndarray  # (P,) uint8, indices into `LABELS`, or `OTHER`
    # The types that the person wears, from the innermost to the outermost.
    garments: tuple[str, ...]
    gender: str  # "female" or "male"
    estimate: BodyState  # the body as estimated, in the same world
    joints: np.ndarray | None  # (24, 3) predicted there, or None
    window: ScanWindow | None = None  # for models of sequences

    @property
    def skin(self) -> np.ndarray:
        """(P,) whether each point is skin."""
        return self.labels == LABELS.index(BODY)

    def points_of(self, garment: str) -> np.ndarray:
        """(n, 3) points of a garment."""
        return self.points[self.labels == LABELS.index(garment)]

    def points_beside(self, garment: str) -> np.ndarray:
        """(n, 3) points where the garment is known not to be.

        That is skin, and cloth that it would cover. What covers it may hide it.
        """
        below = (BODY, *self.garments[: self.garments.index(garment)])
        return self.points[np.isin(self.labels, [LABELS.index(name) for name in below])]


def scan_sample(
    sample: Sample, body: BodyModel, settings: ScanSettings, seed: int
) -> list[SegmentedScan]:
    """Scans of some frames of a simulated sample, relative to the root joint.

    Joints and rotations of estimates are off at random, by the same in all frames of a window, and
    their shape is the mean one unless the settings say otherwise.

    Args:
        sample: accepted.
        settings: how many, and how far estimates are off.
    """
    clouds = CloudSettings(
        points=settings.points,
        noise_m=settings.noise_m,
        visibility=settings.visibility,
        missing=settings.missing,
        seed=seed,
    )
    garments = layered(sample.garments)
    meshes = [sample.body_mesh(), *map(sample.mesh, garments)]
    names = (BODY, *garments)
    turn_rad = 0.0
    if settings.visibility != "all":
        turn_rad = rng_for(seed, "scan", sample.id, "cameras").uniform(0, 2 * np.pi)
    sampler = CloudSampler(
        [(mesh.triangles, label) for mesh, label in zip(meshes, names, strict=True)],
        clouds,
        turn_rad=turn_rad,
    )

    def cloud(frame: int) -> tuple[np.ndarray, np.ndarray]:
        parts = [
            sample.body_vertices(frame, frame + 1, frame="root")[0],
            *(sample.vertices(name, frame, frame + 1, "root")[0] for name in garments),
        ]
        rngs = CloudRngs(*(rng_for(seed, "scan", sample.id, frame, part) for part in range(2)))
        return sampler.sample(parts, rngs)

    scans = []
    for index in range(settings.frames):
        frame = (2 * index + 1) * sample.frame_count // (2 * settings.frames)
        pose, shape = sample.info.poses[frame].astype(float), sample.info.shape
        rng = rng_for(seed, "scan", sample.id, frame, "estimate")
        _, joints = posed_vertices(body, shape, pose[None])
        turned = rng.normal(scale=settings.pose_rad, size=72)
        moved = rng.normal(scale=settings.place_m, size=3)
        joints = joints[0] + rng.normal(scale=settings.joints_m, size=(24, 3))
        estimated = np.zeros(10)
        if settings.shape is not None:
            estimated = shape + rng.normal(scale=settings.shape, size=10)
        if settings.window == 1:
            (points, labels), window = cloud(frame), None
        else:
            # Towards the ends of a sample there are fewer frames on both sides.
            reach = min(settings.window // 2, frame, sample.frame_count - frame - 1)
            taken = slice(frame - reach, frame + reach + 1)
            around = [cloud(number) for number in range(taken.start, taken.stop)]
            points, labels = around[reach]
            window = ScanWindow(
                np.stack([places for places, _ in around]),
                np.stack([codes for _, codes in around]),
                sample.info.poses[taken] + turned,
                np.array(sample.info.trans[taken], dtype=float),
            ).shifted(moved)
        scans.append(
            SegmentedScan(
                f"{sample.id}_{frame:03d}",
                frame,
                points,
                labels,
                garments,
                sample.gender,
                BodyState.of(pose + turned, moved, estimated),
                joints if window is None else None,  # which models of sequences have no use for
                window,
            )
        )
    return scans


def segment_scans(
    scans: ScanSequence, garments: Sequence[str], *, name: str
) -> list[SegmentedScan]:
    """A user's scans with labels, as segmented scans in the user's world.

    Args:
        scans: whose frames have labels: 0 for skin, 1 for the first garment and so on, 255 for
            cloth of others.
        garments: what the person wears, from the innermost to the outermost.
        name: of the scans, also in errors.

    Raises:
        InputError: a garment is not known or there is none, or a frame has no labels, labels that
            stand for nothing, or no points of some garment.
    """
    unknown = [one for one in garments if one not in GARMENTS]
    if unknown or not garments:
        raise InputError(
            f"{name}: garments are {', '.join(garments) or 'not named'}, expected some of"
            f" {', '.join(GARMENTS)}"
        )
    codes = np.full(OTHER + 1, OTHER, dtype=np.uint8)
    codes[: 1 + len(garments)] = [LABELS.index(one) for one in (BODY, *garments)]
    body, found = scans.body, []
    for frame, scan in enumerate(scans.scans):
        where = f"{name}: frame {frame + 1}"
        labels = _checked_labels(where, scan.labels, garments)
        root = body.trans[frame]
        found.append(
            SegmentedScan(
                f"{Path(name).stem}_{frame + 1:03d}",
                frame,
                (scan.points + root).astype(np.float32),
                codes[labels],
                tuple(garments),
                body.gender,
                BodyState.of(body.poses[frame], root, body.shape),
                None if body.joints is None else body.joints[frame],
            )
        )
    return found


def _checked_labels(where: str, labels: np.ndarray | None, garments: Sequence[str]) -> np.ndarray:
    if labels is None:
        raise InputError(f"{where}: points have no labels, expected one for each point")
    bad = np.flatnonzero((labels != OTHER) & ((labels < 0) | (labels > len(garments))))
    if len(bad):
        raise InputError(
            f"{where}: point {bad[0] + 1} has the label {labels[bad[0]]}, expected 0 for skin, 1 to"
            f" {len(garments)} for {', '.join(garments)}, or {OTHER} for other cloth"
        )
    for code, garment in enumerate(garments, 1):
        if not (labels == code).any():
            raise InputError(f"{where}: no point is labelled as {garment}, expected some")
    return labels


def save_scans(
    path: str | Path, scans: Sequence[SegmentedScan], bodies: Sequence[BodyState]
) -> None:
    """Write scans with the bodies that were fitted to them, which `load_scans` reads."""
    arrays: dict[str, object] = {"names": np.array([scan.name for scan in scans], dtype=np.str_)}
    for scan, body in zip(scans, bodies, strict=True):
        part = {
            "frame": scan.frame,
            "points": scan.points,
            "labels": scan.labels,
            "garments": np.array(scan.garments, dtype=np.str_),
            "gender": scan.gender,
            "joints": np.zeros((0, 3)) if scan.joints is None else scan.joints,
        }
        if scan.window is not None:
            part |= {f"window_{key}": value for key, value in scan.window._asdict().items()}
        part |= {f"estimate/{key}": value for key, value in scan.estimate._asdict().items()}
        part |= {f"body/{key}": value for key, value in body._asdict().items()}
        arrays |= {f"{scan.name}/{key}": value for key, value in part.items()}
    save_npz(path, **arrays)


_ARRAYS = {
    "names": "str n",
    "*/frame": "int",
    "*/garments": "str *",
    "*/gender": "str",
    "*/points": "float * 3",
    "*/labels": "int *",
    "*/joints": "float * 3",
    "*/rotations": "float 24 3 3",
    "*/trans": "float 3",
    "*/shape": "float 10",
    "*/window_points": "float * * 3",
    "*/window_labels": "int * *",
    "*/window_poses": "float * 72",
    "*/window_trans": "float * 3",
}


def load_scans(path: str | Path) -> list[tuple[SegmentedScan, BodyState]]:
    """Scans with the bodies that were fitted to them.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    arrays = load_npz(path, _ARRAYS)
    return [_scan(arrays, str(name)) for name in arrays["names"]]


def _scan(arrays: Mapping[str, np.ndarray], name: str) -> tuple[SegmentedScan, BodyState]:
    def state(key: str) -> BodyState:
        return BodyState(*(arrays[f"{name}/{key}/{part}"] for part in BodyState._fields))

    part = {key: arrays[f"{name}/{key}"] for key in ("frame", "garments", "gender", "joints")}
    window = None
    if f"{name}/window_points" in arrays:
        window = ScanWindow(*(arrays[f"{name}/window_{key}"] for key in ScanWindow._fields))
    scan = SegmentedScan(
        name,
        int(part["frame"]),
        arrays[f"{name}/points"],
        arrays[f"{name}/labels"],
        tuple(map(str, part["garments"])),
        str(part["gender"]),
        state("estimate"),
        part["joints"] if len(part["joints"]) else None,
        window,
    )
    return scan, state("body")
