"""A model of skirts that are tubes, whose codes say how long and how wide they are."""

from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.model import BodyModel, save_body
from drapeline.bodies.rest_body import SHAPES, rest_basis
from drapeline.frames import GENDERS, gender_codes, gender_names
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.model import TRAINING_CODES, GarmentCodes, body_file
from drapeline.models.smplicit.network import GarmentField
from drapeline.models.smplicit.settings import FieldNetwork, FieldSettings
from drapeline.models.training.checkpoints import write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static import StaticOutfit
from drapeline.seeding import rng_for
from drapeline.storage import save_npz
from toys.outfits_at_rest import save_static

SETTINGS = FieldSettings(network=FieldNetwork(width=0.05, encoder_width=2))
LATENT = SETTINGS.network.cut + SETTINGS.network.style
_CLIP_M = 0.03


def tube_size(z: np.ndarray) -> tuple[float, float, float]:
    """Heights of the hem and of the waist, and the radius, in metres."""
    return -0.45 - 0.1 * float(z[0]), 0.02 + 0.2 * float(z[2]), 0.27 + 0.02 * float(z[1])


class TubeField:
    """The exact field of the open tube of a code, clipped."""

    clip_m = _CLIP_M

    def __init__(self, z: np.ndarray) -> None:
        self._hem, self._top, self._radius = tube_size(z)

    def gradients(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = np.asarray(points, dtype=np.float64)
        around = np.linalg.norm(points[:, :2], axis=1)
        out = around - self._radius
        beyond = points[:, 2] - np.clip(points[:, 2], self._hem, self._top)
        distance = np.hypot(out, beyond)
        slope = (
            np.concatenate(
                [(out / np.maximum(around, 1e-9))[:, None] * points[:, :2], beyond[:, None]], axis=1
            )
            / np.maximum(distance, 1e-9)[:, None]
        )
        far = distance > _CLIP_M
        slope[far] = 0
        return np.minimum(distance, _CLIP_M).astype(np.float32), slope.astype(np.float32)

    def distances(self, points: np.ndarray) -> np.ndarray:
        return self.gradients(points)[0]


def tube_mesh(z: np.ndarray, around: int = 48, down: int = 24) -> Mesh:
    """The same tube as a mesh."""
    hem, top, radius = tube_size(z)
    turn = 2 * np.pi * np.arange(around) / around
    rings = [
        np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(around, height)], axis=1)
        for height in np.linspace(hem, top, down)
    ]
    grid = np.arange(around * down).reshape(down, around)
    beside = np.roll(grid, -1, axis=1)
    low = np.stack([grid[:-1], beside[:-1], beside[1:]], axis=-1).reshape(-1, 3)
    high = np.stack([grid[:-1], beside[1:], grid[1:]], axis=-1).reshape(-1, 3)
    faces = np.concatenate([low, high])
    return Mesh(np.concatenate(rings).astype(np.float32), faces.astype(np.int32))


def training_codes(count: int = 44) -> GarmentCodes:
    """Codes in which every number varies, the first one most."""
    z = rng_for(0, "codes").normal(size=(count, LATENT)) * [1.0, 0.7, *[0.1] * (LATENT - 2)]
    return GarmentCodes(
        z.astype(np.float32),
        np.full(count, GARMENTS.index("Skirt")),
        np.array([f"s{row:05d}" for row in range(count)]),
        np.zeros((count, SHAPES), np.float32),
        gender_names(np.arange(count) % 2),
    )


def save_toy_model(folder: Path, body: BodyModel, codes: GarmentCodes) -> None:
    """What the training leaves, with an untrained network."""
    folder.mkdir(parents=True)
    basis = rest_basis(dict.fromkeys(GENDERS, body))[:, ::400].astype(np.float32)
    network = GarmentField("skirt", SETTINGS, torch.from_numpy(basis), len(codes.z))
    write_checkpoint(folder / BEST, network.state_dict(), network.checkpoint_metadata())
    arrays = codes._asdict() | {"gender": gender_codes(codes.gender)}
    save_npz(folder / TRAINING_CODES, **arrays)
    for gender in GENDERS:
        save_body(body_file(folder, gender), body)


def save_toy_outfits(shard: Path, codes: GarmentCodes) -> None:
    """The tubes of the codes as static outfits."""
    save_static(shard, toy_outfits(codes))


def toy_outfits(codes: GarmentCodes) -> list[StaticOutfit]:
    """The tubes of the codes."""
    return [
        StaticOutfit(
            str(name),
            "train",
            Outfit(
                (_garment(tube_mesh(z)),),
                np.zeros(SHAPES),
                np.zeros(2),
                np.zeros(2),
                gender,
            ),
        )
        for z, name, gender in zip(codes.z, codes.outfit, codes.gender, strict=True)
    ]


def _garment(mesh: Mesh) -> Garment:
    return Garment(
        "Skirt",
        mesh.vertices,
        mesh.faces,
        uv=np.zeros((0, 2), np.float32),
        uv_faces=np.zeros((0, 4), np.int32),
        pin=np.zeros(0, np.float32),
        elastic=np.zeros(0, np.float32),
        band=np.zeros(0, np.float32),
        attributes={},
    )
