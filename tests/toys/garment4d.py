"""Skirts on the toy body in motion, as the stages of Garment4D before training leave them."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.kinematics import skin_points
from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.bodies.weight_transfer import interpolated_weights
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.learning_data.sequences import (
    GarmentSequence,
    SeenSequence,
    SequenceData,
    collect_clouds,
    collect_sequences,
)
from drapeline.models.garment4d.data import BodySequences, BodySet
from drapeline.models.garment4d.ours.body_maps import MapRegression
from drapeline.outfits.garment_types import LABELS
from drapeline.seeding import rng_for
from toys.tiny_sample import tube

GARMENT = "Skirt"
POINTS = 160
AROUND, ROWS = 12, 5


def skirt_faces() -> np.ndarray:
    """(F, 3) int32 of every toy skirt."""
    return triangulate(tube(0.25, -0.4, 0.05, AROUND, ROWS).faces)


def toy_sequence(
    body: BodyModel, number: int, *, frames: int, source: str, split: str
) -> GarmentSequence:
    """A skirt of its own width and length that follows the body and sways besides."""
    rng = rng_for(0, "toy skirt", number)
    shape = rng.uniform(-1, 1, 10)
    radius, bottom = rng.uniform(0.2, 0.3), rng.uniform(-0.6, -0.3)
    canonical = tube(radius, bottom, 0.05, AROUND, ROWS).vertices
    steps = np.cumsum(rng.normal(0, 0.02, (frames, 72)), axis=0)
    poses = REST_POSE + steps
    rest = rest_body(body, shape)
    weights = interpolated_weights(canonical, skirt_faces(), rest, body.weights, 16, 5)
    posed = skin_points(canonical, rest_to_pose(body, shape, poses), weights)
    sway = 0.02 * np.sin(0.5 * np.arange(frames) + number)
    posed[..., 0] += sway[:, None] * (canonical[:, 2] - 0.05) / bottom
    posed = posed.astype(np.float32)
    bodies, _ = posed_vertices(body, shape, poses)
    chosen = [rng.integers(len(x), size=POINTS // 2) for x in (bodies[0], canonical)]
    points = np.concatenate([bodies[:, chosen[0]], posed[:, chosen[1]]], 1)
    labels = np.repeat([0, LABELS.index(GARMENT)], POINTS // 2)
    order = rng.permutation(POINTS)
    return GarmentSequence(
        name=f"{number:05d}",
        source=source,
        split=split,
        clip=f"clip{number % 3}",
        gender="female",
        shape=shape,
        poses=poses,
        trans=np.zeros((len(poses), 3)),
        number=10 + np.arange(frames) * (3 if source == "skinned" else 1),
        points=points[:, order].astype(np.float32),
        labels=np.tile(labels[order], (frames, 1)),
        canonical=canonical,
        original=Mesh(canonical, skirt_faces()),
        garment=lambda: posed,
    )


def toy_sequences(body: BodyModel) -> list[GarmentSequence]:
    """Nine, of which the simulated ones are longer; the last is the only one of the test split."""
    sources = [
        *(("skinned", "train", 3),) * 4,
        *(("blender", "train", 8),) * 2,
        ("skinned", "val", 3),
        ("blender", "val", 7),
        ("blender", "test", 7),
    ]
    return [
        toy_sequence(body, number, frames=frames, source=source, split=split)
        for number, (source, split, frames) in enumerate(sources)
    ]


def save_toy_data(folder: Path, body: BodyModel) -> list[GarmentSequence]:
    """What the task `collect_data` leaves."""
    sequences = toy_sequences(body)
    collect_sequences(folder, GARMENT, sequences, skirt_faces(), 3, toy_bodies(body))
    return sequences


def without_skirt(sequence: GarmentSequence, name: str) -> SeenSequence:
    """The same person, whose points on the skirt are those of a top and trousers."""
    seen = {field.name: getattr(sequence, field.name) for field in fields(SeenSequence)}
    top, trousers = (LABELS.index(garment) for garment in ("Top", "Trousers"))
    worn = np.where(sequence.points[..., 2] > -0.2, top, trousers)
    labels = np.where(sequence.labels > 0, worn, 0)
    return SeenSequence(**{**seen, "name": name, "labels": labels})


def save_toy_tops(folder: Path, body: BodyModel) -> list[SeenSequence]:
    """What the task `labelled` leaves: clouds of the toy skirts, and of one who wears none."""
    other = toy_sequence(body, 20, frames=5, source="blender", split="train")
    sequences = [*toy_sequences(body), without_skirt(other, "00020")]
    collect_clouds(folder, sequences, toy_bodies(body))
    return sequences


def toy_bodies(body: BodyModel) -> dict[str, BodyModel]:
    """The same for both genders."""
    return dict.fromkeys(GENDERS, body)


def open_toy_data(folder: Path, body: BodyModel, body_points: int) -> BodySequences:
    """What `save_toy_data` left, with bodies of which networks are given so many vertices."""
    return BodySequences(SequenceData(folder), BodySet(toy_bodies(body), body_points))


def fill_regression(regression: MapRegression) -> None:
    """Random weights in place of fitted ones."""
    draw = torch.Generator().manual_seed(6)
    with torch.no_grad():
        regression.scale.fill_(1)
        regression.low.fill_(-9)
        regression.high.fill_(9)
        regression.weight.normal_(std=0.1, generator=draw)
        regression.bias.fill_(0.5)


# Settings of trainings that take seconds and still learn something.
_NETWORK = {
    "width": 1,
    "points": 6890,
    "layers": {
        "segmentation": [
            {"centres": 40, "radii": [0.2], "neighbours": [8], "widths": [[8, 16]]},
            {"centres": 12, "radii": [0.4], "neighbours": [8], "widths": [[16, 16]]},
        ],
        "propagation": [[16], [16]],
        "garment": [
            {"centres": 24, "radii": [0.3], "neighbours": [8], "widths": [[16, 16]]},
            {"centres": 8, "radii": [0.6], "neighbours": [8], "widths": [[16, 16]]},
        ],
        "overall": [32],
        "head": [16],
    },
}
CANONICAL = {
    "network": {**_NETWORK, "garment_points": 60},
    "loss": {"segmentation": 0.5, "interpenetration": 0.0, "balance": 0.5},
    "training": {
        "epochs": 12,
        "batch": 4,
        "learning_rate": 0.005,
        "schedule": "one_cycle",
        "frames": 3,
        "stride": 1,
        "sources": ["simulated", "skinned"],
    },
}
LABELLING = {
    "network": _NETWORK,
    "loss": {"balance": 0.5},
    "training": {**CANONICAL["training"], "learning_rate": 0.02},
}
POSED = {
    "network": {
        "iterations": 2,
        "hidden": 16,
        "layers": 3,
        "features": 8,
        "garment_radii_m": [0.1, 0.2, 0.4],
        "garment_counts": [6, 6, 6],
        "body_radii_m": [0.2],
        "body_counts": [6],
        "ball_layers": 2,
        "pull_neighbours": 0,
        "smooth_passes": 0,
    },
    "loss": {"interpenetration": 0.0, "laplacian": 0.0, "temporal": 0.0},
    "skinning": {"neighbours": 16, "passes": 5},
    "training": {**CANONICAL["training"], "epochs": 8},
}
