"""Tubes around the toy body's legs as skirts, with their fields, and settings of tiny networks."""

from functools import cache
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.garment_fields import FieldData, collect_fields, sample_fields
from drapeline.learning_data.occlusion import texture_pixels
from drapeline.models.pictures.read import CLASSES, Person, Picture
from drapeline.models.smplicit.garments import FIELD_MODELS, MODEL_OF_GARMENT
from drapeline.models.smplicit.settings import FieldSettings, FitImage, Meshing
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static import StaticOutfit
from drapeline.rendering.camera import Camera
from drapeline.storage import save_npz

BOXES = {garment: FIELD_MODELS[model].box for garment, model in MODEL_OF_GARMENT.items()}
SPLITS = ("train",) * 4 + ("val",) * 2 + ("test",) * 2
RESOLUTION, CLUSTERS, POINTS = 32, 20, 64
PICTURE_PX = 120
# Of fits to pictures, and of what they find.
QUICK = FitImage(points=4000, rays=40, starts=3, rounds=2, steps=2)
MESHING = Meshing(cell_m=0.04, threshold_m=0.028)


def tube(radius_m: float, low_m: float, high_m: float, around: int = 32, rings: int = 9) -> Mesh:
    """An open upright cylinder whose faces look outwards."""
    turn, height = np.meshgrid(
        np.arange(around) * 2 * np.pi / around, np.linspace(low_m, high_m, rings)
    )
    vertices = np.stack([radius_m * np.cos(turn), radius_m * np.sin(turn), height], axis=-1)
    ring, step = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    a, b = (ring * around + step).ravel(), (ring * around + (step + 1) % around).ravel()
    faces = np.concatenate([np.c_[a, b, b + around], np.c_[a, b + around, a + around]])
    return Mesh(vertices.reshape(-1, 3).astype(np.float32), faces.astype(np.int32))


def toy_outfits() -> list[StaticOutfit]:
    """A skirt each, of two lengths and widths, on bodies of several shapes."""
    outfits = []
    for index, split in enumerate(SPLITS):
        mesh = tube(0.3 + 0.05 * (index % 2), -0.4 - 0.2 * (index // 2 % 2), 0.0)
        garment = Garment(
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
        shape = np.zeros(10)
        shape[0] = index / 4 - 1
        outfit = Outfit((garment,), shape, np.zeros(2), np.zeros(2), GENDERS[index % 2])
        outfits.append(StaticOutfit(f"s{index}", split, outfit))
    return outfits


def toy_bodies(body: BodyModel) -> dict[str, BodyModel]:
    return dict.fromkeys(GENDERS, body)


@cache
def toy_shard(body_of) -> dict[str, np.ndarray]:
    """Fields of all toy outfits on the body that `body_of()` gives."""
    body = body_of()
    return sample_fields(
        toy_outfits(),
        toy_bodies(body),
        texture_pixels(body, RESOLUTION),
        BOXES,
        seed=0,
        near=POINTS,
        space=POINTS,
    )


def toy_fields(folder: Path, body_of) -> FieldData:
    """The same, collected."""
    save_npz(folder / "shard.npz", **toy_shard(body_of))
    body = body_of()
    collect_fields(
        folder / "data",
        [folder / "shard.npz"],
        ["Skirt"],
        toy_bodies(body),
        texture_pixels(body, RESOLUTION),
        clusters=CLUSTERS,
    )
    return FieldData(folder / "data")


def toy_settings(**training) -> FieldSettings:
    """Networks that learn in seconds."""
    return FieldSettings(
        network={"cut": 2, "style": 3, "width": 0.1, "encoder_width": 2},
        training={
            "epochs": 100,
            "visits": 1,
            "batch": 2,
            "near": 32,
            "space": 32,
            "schedule": "constant",
            **training,
        },
    )


def toy_camera() -> Camera:
    """Looks along +Y at the origin from 2.5 m away."""
    intrinsics = np.array([[150, 0, PICTURE_PX / 2], [0, 150, PICTURE_PX / 2], [0, 0, 1.0]])
    to_camera = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 2.5], [0, 0, 0, 1]])
    return Camera(intrinsics, to_camera, PICTURE_PX, PICTURE_PX)


def skirt_pixels() -> np.ndarray:
    """(H, W) bool, a skirt's silhouette in its picture."""
    shown = np.zeros((PICTURE_PX, PICTURE_PX), dtype=bool)
    shown[60:85, 40:80] = True
    return shown


def street(skirt: np.ndarray, *outfits: tuple[str, ...]) -> Picture:
    """A picture of people with pixels (H, W) of a skirt, each in some classes of garments."""
    everywhere = np.ones_like(skirt)
    people = tuple(
        Person(
            "male",
            np.zeros(10),
            REST_POSE.copy(),
            np.zeros(3),
            toy_camera(),
            everywhere,
            ~everywhere,
            garments,
        )
        for garments in outfits
    )
    classes = np.where(skirt, CLASSES.index("skirt"), 0).astype(np.uint8)
    return Picture("street", classes, None, people)
