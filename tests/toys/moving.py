"""Garments in motion over the torso, and the files of samples that wear them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from drapeline.bodies.kinematics import skin_points
from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.frames import REST_POSE
from drapeline.learning_data.moving import MovingGarment
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.dynamic_offsets import dynamic_offsets
from drapeline.seeding import rng_for
from drapeline.storage import write_json
from toys.gcvae_files import torso_registration
from toys.tiny_sample import TinySample, write_tiny_sample


def moving_garment(body, split, name, *, wrinkle=0.0, seed=0, clip=""):
    """Cloth 2 cm over the torso that the body's own weights carry, wrinkles along X in rest."""
    rng = rng_for(seed, "moving", split, name)
    shape = rng.uniform(-1, 1, 10)
    poses = np.tile(REST_POSE, (6, 1)) + rng.normal(0, 0.2, (6, 72))
    registered = torso_registration(body, shape)
    vertex = registered.vertex
    still = rest_body(body, shape)[vertex] + registered.offsets[vertex] + [wrinkle, 0, 0]
    cloth = skin_points(still, rest_to_pose(body, shape, poses), registered.weights)
    return MovingGarment(
        f"{split}{seed}",
        split,
        name,
        "blender",
        clip or f"clip{seed}",
        "female",
        shape,
        poses,
        registered,
        np.zeros((0, 3), dtype=np.int32),
        cloth.astype(np.float32),
    )


def moving_data(garments: Sequence[MovingGarment], body: BodyModel) -> SimpleNamespace:
    """Every frame of garments with pose-invariant offsets, like a `DynamicData`."""
    counts = [len(one.poses) for one in garments]
    index = np.repeat(np.arange(len(garments)), counts)
    shapes = np.stack([one.shape for one in garments]).astype(np.float32)
    poses = np.concatenate([one.poses for one in garments]).astype(np.float32)
    names = {key: np.array([getattr(one, key) for one in garments]) for key in ("sample", "split")}
    garment = np.array([GARMENTS.index(one.name) for one in garments])
    return SimpleNamespace(
        **names,
        version="unposed",
        garment=garment,
        garment_index=index,
        frame=np.concatenate([np.arange(count) for count in counts]),
        poses=np.repeat(poses[:, None], 4, 1),
        mask=np.stack([one.registered.mask for one in garments]),
        static=np.stack([one.registered.offsets for one in garments]),
        offsets=np.concatenate(
            [
                dynamic_offsets(one.registered, one.cloth, body, one.shape, one.poses, "unposed")
                for one in garments
            ]
        ),
        base=np.zeros((len(index), 0)),
        rows=lambda split: np.flatnonzero(names["split"][index] == split),
        rows_of=lambda sample, name: np.flatnonzero(
            (names["sample"][index] == sample) & (garment[index] == GARMENTS.index(name))
        ),
        topology=lambda rows: np.zeros(len(rows), dtype=int),
        cvar=lambda own: np.concatenate([shapes[own], np.zeros((len(own), 3), np.float32)], 1),
    )


class SampleFiles(NamedTuple):
    """A tiny sample and the folder of its registrations."""

    tiny: TinySample
    registration: Path


def write_registered_sample(
    stages: Path, body: BodyModel, name: str, split: str, status: str = "accepted"
) -> SampleFiles:
    """A tiny sample, and registrations of its garments if it was accepted."""
    tiny = write_tiny_sample(stages, body, name, split, status=status)
    folder = stages / "registration" / name
    write_json(folder / "status.json", {"id": name, "status": status, "split": split})
    if status == "accepted":
        made = torso_registration(body, tiny.shape)
        for garment, mesh in tiny.meshes.items():
            corner = made.corner % len(mesh.vertices)
            replace(made, corner=corner).save(folder / f"{garment}.npz")
    return SampleFiles(tiny, folder)
