"""Registered toy skirts, and pictures of them as they are worn, as the files that jobs read."""

from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel, save_body
from drapeline.frames import GENDERS, REST_POSE, gender_codes
from drapeline.learning_data.skinned import SampleMotion
from drapeline.learning_data.static import CONDITIONS, StaticData
from drapeline.models.gcvae.pictures.data import collect_pictures
from drapeline.models.gcvae.settings import PictureViews
from drapeline.models.gcvae.vae import StaticVae
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from drapeline.storage import save_npz
from toys.gcvae_files import SETTINGS, save_model, shaken, template_on_body, torso_registration
from toys.smplicit import toy_bodies, toy_outfits

VIEWS = PictureViews(size_px=32, per_outfit=2)
# A solver whose garments hang at once.
HANGING = {
    "solver": "drapeline.xpbd.solver",
    "hanging": {
        "edge_length_m": 0.05,
        "simulation": {
            "steps_min": 4,
            "steps_max": 4,
            "shape_frames": 1,
            "pose_frames": 1,
            "settle_frames": 0,
        },
    },
}


def toy_motions() -> list[SampleMotion]:
    """A motion of each split that skirts are worn in."""
    rng = rng_for(0, "toy motions")
    return [
        SampleMotion(split, split, REST_POSE + rng.normal(0, 0.1, (5, 72)))
        for split in ("train", "val")
    ]


def save_registered(folder: Path, body: BodyModel) -> StaticData:
    """The toy outfits' skirts as if registered to the toy body."""
    outfits = toy_outfits()
    garment = torso_registration(body, np.zeros(10))
    folder.mkdir(parents=True)
    np.save(folder / "offsets.npy", np.stack([garment.offsets] * len(outfits)))
    np.save(folder / "mask.npy", np.stack([garment.mask] * len(outfits)))
    save_npz(
        folder / "rows.npz",
        shape=np.stack([one.outfit.shape for one in outfits]).astype(np.float32),
        gender=gender_codes(np.array([one.outfit.gender for one in outfits])),
        tightness=rng_for(0, "toy tightness").uniform(-1, 1, (len(outfits), 2)),
        garment=np.full(len(outfits), GARMENTS.index("Skirt"), dtype=np.int8),
        outfit=np.array([one.name for one in outfits]),
        split=np.array([one.split for one in outfits]),
    )
    rest = np.zeros_like(garment.offsets)
    save_npz(folder / "statistics.npz", body_mean=rest, body_std=rest + 1)
    return StaticData(folder)


def save_toy_pictures(folder: Path, body: BodyModel) -> dict[str, Path]:
    """Files by name: bodies, registered skirts, a static model of them, and their pictures."""
    files = {name: folder / name for name in ("data", "model", "pictures")}
    for gender in GENDERS:
        files[gender] = folder / f"{gender}.npz"
        save_body(files[gender], body)
    data = save_registered(files["data"], body)
    save_model(files["model"], shaken(StaticVae(SETTINGS, template_on_body(body, CONDITIONS))))
    outfits = [one for one in toy_outfits() if one.split != "test"]
    bodies = toy_bodies(body)
    collect_pictures(files["pictures"], outfits, toy_motions(), data, bodies, VIEWS)
    return files
