"""Static outfits put into motion by their skinning weights: cheap sequences of many garments.

The canonical stage of Garment4D learns the shapes of garments from point clouds, and needs many
garments more than it needs true folds. A simulated sample takes minutes and shows one outfit; here
an outfit that was never simulated goes through a few frames of a sample's motion in a tenth of a
second.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.bodies.kinematics import skin_points
from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.bodies.weight_transfer import nearest_weights
from drapeline.dataset.point_clouds import CloudSampler, cloud_layouts, cloud_rngs, rig_turn
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.dataset.settings import CloudSettings
from drapeline.errors import InputError
from drapeline.frames import FPS
from drapeline.geometry.collision import PenetrationResolver
from drapeline.geometry.mesh import triangulate
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.learning_data.settings import SkinnedSettings
from drapeline.outfits.garment_types import BODY, weight_reach_m
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static import StaticOutfit, load_static
from drapeline.rule_log import progress
from drapeline.seeding import rng_for
from drapeline.storage import (
    ArrayFiles,
    atomic_folder,
    load_npz,
    open_arrays,
    read_json,
    save_npz,
    write_json,
)


class PosedOutfit(NamedTuple):
    """An outfit in motion: body (T, B, 3), garments (T, V, 3) by name; root-relative metres."""

    body: np.ndarray
    garments: dict[str, np.ndarray]


def skin_outfit(outfit: Outfit, body: BodyModel, poses: np.ndarray) -> PosedOutfit:
    """Move an outfit's garments with its wearer by linear blend skinning, then out of the body.

    Args:
        outfit: in the rest pose.
        body: of the wearer's gender, whole.
        poses: (T, 72) rad.
    """
    rest = rest_body(body, outfit.shape)
    posed = posed_vertices(body, outfit.shape, poses)[0]
    motions = rest_to_pose(body, outfit.shape, poses)
    resolver = PenetrationResolver(posed[0], body.faces)
    garments, averages = {}, {}
    for garment in outfit.garments:
        weights = worn_weights(garment, rest, body)
        garments[garment.name] = skin_points(garment.vertices, motions, weights).astype(np.float32)
        averages[garment.name] = averaging_matrix(garment.faces, len(garment.vertices))
    for frame, vertices in enumerate(posed):
        resolver.move(vertices)
        for name, cloth in garments.items():
            cloth[frame] = resolver.push_out(cloth[frame], averages[name])
    return PosedOutfit(posed, garments)


def worn_weights(garment: Garment, rest: np.ndarray, body: BodyModel) -> np.ndarray:
    """(V, 24) float32 skinning weights of a garment at rest on a body (B, 3)."""
    return nearest_weights(
        garment.vertices,
        garment.faces,
        rest,
        body.faces,
        body.weights,
        reach_m=weight_reach_m(garment.name),
    )


@dataclass(frozen=True)
class SampleMotion:
    """A simulated sample's poses."""

    sample: str  # its id
    split: str  # "train", "val" or "test"
    poses: np.ndarray  # (F, 72) rad


def read_motions(samples: Sequence[str | Path]) -> list[SampleMotion]:
    """Read the poses of the accepted ones among simulated samples, sorted by id.

    Raises:
        InputError: a file of a sample is missing or damaged.
    """
    motions = []
    for folder in samples:
        record = read_record(folder)
        if record.accepted:
            with Sample(folder) as sample:
                poses = sample.info.poses
            motions.append(SampleMotion(record.meta["id"], record.meta["split"], poses))
    return sorted(motions, key=lambda motion: motion.sample)


def write_skinned(
    folder: str | Path,
    shard: str | Path,
    samples: Sequence[str | Path],
    bodies: Mapping[str, BodyModel],
    settings: SkinnedSettings,
) -> int:
    """Put the outfits of a shard into motion and write their clouds and cloth.

    An outfit moves as a simulated sample of its own split, so that no motion is in two splits;
    outfits of a split without samples are left out and named in `about.json`.

    Args:
        folder: for `points.npy` (F, P, 3) and `labels.npy` (F, P), frames of all sequences one
            after the other; `cloth.npy` (R, 3), their garments' vertices; `sequences.npz` and
            `about.json`, which tell them apart. Replaced as a whole.
        shard: `.npz` of static outfits.
        samples: folders of simulated samples.
        bodies: whole, by gender.

    Returns:
        Number of outfits written.

    Raises:
        InputError: a file is unusable, or no sample is long enough.
    """
    motions = read_motions(samples)
    span = (settings.frames - 1) * settings.step + 1
    if motions and all(len(m.poses) < span for m in motions):
        raise InputError(
            f"{folder}: the longest of {len(motions)} samples has"
            f" {max(len(m.poses) for m in motions)} frames, expected at least {span}"
        )
    motions = [m for m in motions if len(m.poses) >= span]
    wanted = list(load_static(shard))
    splits = {m.split for m in motions}
    outfits = [o for o in wanted if o.split in splits]
    with atomic_folder(folder) as scratch:
        _write(scratch, outfits, motions, bodies, settings)
        write_json(
            scratch / "about.json",
            {
                "source": "skinned",
                "settings": settings.plain(),
                "fps": FPS,
                "garments": [[g.name for g in o.outfit.garments] for o in outfits],
                "left_out": [o.name for o in wanted if o.split not in splits],
            },
        )
    return len(outfits)


def _write(
    folder: Path,
    outfits: Sequence[StaticOutfit],
    motions: Sequence[SampleMotion],
    bodies: Mapping[str, BodyModel],
    settings: SkinnedSettings,
) -> None:
    span = settings.step * np.arange(settings.frames)
    sizes = [[len(g.vertices) for g in o.outfit.garments] for o in outfits]
    most = max(map(len, sizes), default=1)
    rows = settings.frames * sum(map(sum, sizes))
    clouds = cloud_layouts(len(outfits) * settings.frames, settings.clouds.points)
    files = ArrayFiles(folder, clouds | {"cloth": (np.float32, (rows, 3))})
    chosen: list[tuple[str, np.ndarray, np.ndarray]] = []
    for static in progress(outfits, label="outfits"):
        rng = rng_for(settings.clouds.seed, "skinned", static.name)
        own = [m for m in motions if m.split == static.split]
        motion = own[rng.integers(len(own))]
        number = rng.integers(len(motion.poses) - span[-1]) + span
        poses = motion.poses[number]
        body = bodies[static.outfit.gender]
        worn = skin_outfit(static.outfit, body, poses)
        points, labels = _clouds(static, body, worn, settings.clouds)
        files.append(points=points, labels=labels)
        for vertices in worn.garments.values():
            files.append(cloth=vertices.reshape(-1, 3))
        chosen.append((motion.sample, number, poses))
    files.flush()
    save_npz(
        folder / "sequences.npz",
        name=np.array([o.name for o in outfits], dtype=str),
        split=np.array([o.split for o in outfits], dtype=str),
        gender=np.array([o.outfit.gender for o in outfits], dtype=str),
        shape=np.array([o.outfit.shape for o in outfits]).reshape(-1, 10),
        sample=np.array([sample for sample, _, _ in chosen], dtype=str),
        number=np.array([number for _, number, _ in chosen]).reshape(-1, settings.frames),
        poses=np.array([poses for _, _, poses in chosen]).reshape(-1, settings.frames, 72),
        # Of as many garments as an outfit has at most; 0 for none.
        vertices=np.array([size + [0] * (most - len(size)) for size in sizes]).reshape(-1, most),
    )


def _clouds(
    static: StaticOutfit, body: BodyModel, worn: PosedOutfit, settings: CloudSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Points (T, P, 3) and labels (T, P) of an outfit in motion."""
    garments = static.outfit.garments
    sampler = CloudSampler(
        [(body.faces, BODY), *((triangulate(g.faces), g.name) for g in garments)],
        settings,
        turn_rad=rig_turn(settings, static.name),
    )
    frames = [
        sampler.sample(
            [posed, *(worn.garments[g.name][frame] for g in garments)],
            cloud_rngs(settings, static.name, frame),
        )
        for frame, posed in enumerate(worn.body)
    ]
    return np.array([points for points, _ in frames]), np.array([labels for _, labels in frames])


class SkinnedSequence(NamedTuple):
    """One outfit of a folder that `write_skinned` wrote."""

    name: str  # of the static outfit
    split: str  # "train", "val" or "test"
    gender: str  # "female" or "male"
    shape: np.ndarray  # (10,)
    sample: str  # id of the simulated sample that it moves as
    number: np.ndarray  # (T,) of the frames in that sample
    poses: np.ndarray  # (T, 72) rad
    # points, labels: (T, P, 3) float32 and (T, P) uint8, memory-mapped.
    points: np.ndarray
    labels: np.ndarray
    # Name -> (T, V, 3) float32 root-relative vertices, memory-mapped.
    garments: dict[str, np.ndarray]


_SEQUENCES = {
    **dict.fromkeys(("name", "split", "gender", "sample"), "str n"),
    "shape": "float n 10",
    "number": "int n f",
    "poses": "float n f 72",
    "vertices": "int n *",
}


def load_skinned(folder: str | Path) -> Iterator[SkinnedSequence]:
    """Yield the sequences of a folder that `write_skinned` wrote.

    Raises:
        InputError: a file is missing or damaged, or the files do not fit together.
    """
    folder = Path(folder)
    names = read_json(folder / "about.json", {"garments": [[str]]})["garments"]
    table = load_npz(folder / "sequences.npz", _SEQUENCES, n=len(names))
    points, labels, cloth = open_arrays(
        folder, {"points": "float f p 3", "labels": "int f p", "cloth": "float * 3"}
    ).values()
    frames = table["number"].shape[1]
    wanted = (frames * len(names), frames * int(table["vertices"].sum()))
    if (len(points), len(cloth)) != wanted:
        raise InputError(
            f"{folder}: {len(points)} clouds and {len(cloth)} vertices, expected {wanted[0]} and"
            f" {wanted[1]} as in sequences.npz"
        )
    row = 0
    for index, worn in enumerate(names):
        garments = {}
        for name, count in zip(worn, table["vertices"][index], strict=False):
            garments[name] = cloth[row : row + frames * count].reshape(frames, count, 3)
            row += frames * int(count)
        part = slice(index * frames, (index + 1) * frames)
        yield SkinnedSequence(
            str(table["name"][index]),
            str(table["split"][index]),
            str(table["gender"][index]),
            table["shape"][index],
            str(table["sample"][index]),
            table["number"][index],
            table["poses"][index],
            points[part],
            labels[part],
            garments,
        )
