"""Simulated skirts whose displacement is known, and settings of tiny networks that learn it."""

from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.rest_skinning import straighten, tpose_motions
from drapeline.bodies.skinning import skin_points
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.dataset.writer import write_sample
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import triangulate
from drapeline.geometry.point_cache import write_point_cache
from drapeline.learning_data.pose_displacements import (
    DisplacementData,
    collect_displacements,
    encode_poses,
)
from drapeline.models.smplicit.displacement_settings import DisplacementSettings
from drapeline.seeding import rng_for
from toys.smplicit import toy_bodies
from toys.tiny_sample import TinySample, write_stages

FRAMES, CLUSTERS = 6, np.arange(0, 600, 20)
SPLITS = ("train", "train", "val", "test")
# What a skirt is displaced by, metres: always, and per unit of the second number of the pose.
ALWAYS_M, SLOPE_M = np.array([0.0, 0.02, -0.01]), np.array([0.05, 0.0, 0.0])


def known_displacement(poses: np.ndarray) -> np.ndarray:
    """(N, 1, 3) metres, the same for all vertices."""
    return (ALWAYS_M + encode_poses(poses)[:, 1:2] * SLOPE_M)[:, None]


def write_moving_skirt(stages: Path, body: BodyModel, sample: str, split: str) -> TinySample:
    """A sample whose skirt is skinned after the known displacement; its t-shirt is noise."""
    tiny = write_stages(stages, sample, frames=FRAMES)
    poses = np.tile(REST_POSE, (FRAMES, 1))
    poses[:, 3:] += rng_for(0, "poses", sample).normal(0, 0.2, (FRAMES, 69))
    rest = tiny.meshes["Skirt"]
    faces = triangulate(rest.faces)
    weights = interpolated_weights(rest.vertices, faces, rest_body(body, tiny.shape), body.weights)
    straight = straighten(rest.vertices, weights, body, tiny.shape) + known_displacement(poses)
    cloth = skin_points(straight, tpose_motions(body, tiny.shape, poses), weights)
    write_point_cache(stages / "simulation" / sample / "Skirt.f32", cloth.astype(np.float32))
    record = dict(np.load(stages / "bodies" / f"{sample}.npz"))
    np.savez(stages / "bodies" / f"{sample}.npz", **{**record, "poses": poses})
    write_sample(
        rng_for(0, "scene", sample),
        tiny.folder,
        body=body,
        body_record=stages / "bodies" / f"{sample}.npz",
        outfit=stages / "outfits" / f"{sample}.npz",
        simulation=stages / "simulation" / sample,
        seed=0,
        split=split,
    )
    return tiny._replace(poses=poses, vertices={**tiny.vertices, "Skirt": cloth})


def write_moving_skirts(folder: Path, body: BodyModel, splits=SPLITS) -> list[TinySample]:
    """A sample for each of some splits."""
    return [
        write_moving_skirt(folder, body, f"{number:05d}", split)
        for number, split in enumerate(splits, 1)
    ]


def collect_skirts(
    output: Path, samples: list[TinySample], body: BodyModel, frame_step: int = 1
) -> DisplacementData:
    """Displacements of the skirts of samples."""
    collect_displacements(
        output,
        [tiny.folder for tiny in samples],
        ["Skirt"],
        toy_bodies(body),
        frame_step=frame_step,
    )
    return DisplacementData(output)


def toy_displacement_settings(**training) -> DisplacementSettings:
    """Networks that learn in seconds."""
    return DisplacementSettings(
        network={"code": 3, "width": 0.1},
        training={"epochs": 100, "batch": 4, "edges": 16, "schedule": "constant", **training},
    )
