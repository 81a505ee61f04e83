"""Training of the network that regresses codes from pictures."""

from pathlib import Path

import numpy as np

from drapeline.bodies.rest_body import signed_tightness
from drapeline.frames import GENDERS
from drapeline.job import Job
from drapeline.learning_data.static import StaticData, static_cvar
from drapeline.models.gcvae.codec import GarmentCodec, encode_rows
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.pictures.data import PictureData, PictureRows, class_code
from drapeline.models.gcvae.pictures.network import CodeSpace, PictureCoder
from drapeline.models.gcvae.settings import PictureNetwork
from drapeline.models.pictures.read import CLASSES, GARMENT_CLASSES
from drapeline.models.training.batches import Batch, TrainingBatches
from drapeline.models.training.checkpoints import tensors_digest
from drapeline.models.training.lightning import TrainingRun, fit
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENT_TYPES, GARMENTS

_FLOOR = 1e-3  # of the deviation of a number that hardly varies


def types_of_class(name: str) -> list[str]:
    """The garment types that a garment of a class may be; whatever is worn above, any such."""
    region = GARMENT_TYPES[GARMENT_CLASSES[name]].region
    if region == "upper":
        return [garment for garment, kind in GARMENT_TYPES.items() if kind.region == region]
    return [GARMENT_CLASSES[name]]


def mean_tightness(data: StaticData) -> np.ndarray:
    """(2,) float32 mean of the training garments', without the gender's sign."""
    rows = data.rows("train")
    pairs = zip(data.tightness[rows], data.gender[rows], strict=True)
    return np.mean([signed_tightness(own, gender) for own, gender in pairs], 0).astype(np.float32)


def conditions_of(shape: np.ndarray, gender: np.ndarray, tightness: np.ndarray) -> np.ndarray:
    """(n, 13) float32 conditions of wearers (n, 10) and (n,), with one tightness (2,) for all."""
    signed = {name: signed_tightness(tightness, name) for name in GENDERS}
    return static_cvar(shape, gender, np.stack([signed[str(name)] for name in gender]))


def encode_untold(codec: GarmentCodec, data: StaticData, tightness: np.ndarray) -> np.ndarray:
    """(N, Z) codes of all garments as if all had the same tightness (2,)."""

    def read(rows: np.ndarray) -> Batch:
        cvar = conditions_of(data.shape[rows], data.gender[rows], tightness)
        return {**data.batch(rows), "cvar": cvar}

    return encode_rows(codec, read, np.arange(len(data))).mean


def code_space(codec: GarmentCodec, data: StaticData) -> tuple[CodeSpace, np.ndarray]:
    """The codes (N, Z) of all garments, and what is known of the training garments' codes."""
    tightness = mean_tightness(data)
    codes, rows = encode_untold(codec, data, tightness), data.rows("train")
    means = np.zeros((len(CLASSES), codes.shape[1]), np.float32)
    known = np.zeros(len(CLASSES), bool)
    for name in GARMENT_CLASSES:
        types = [GARMENTS.index(garment) for garment in types_of_class(name)]
        own = rows[np.isin(data.garment[rows], types)]
        if len(own):
            known[CLASSES.index(name)] = True
            means[CLASSES.index(name)] = codes[own].mean(axis=0)
    kinds = [class_code(GARMENTS[garment]) for garment in data.garment[rows]]
    spread = np.maximum((codes[rows] - means[kinds]).std(axis=0), _FLOOR).astype(np.float32)
    digest = tensors_digest(codec.state_dict())
    return CodeSpace(means, known, spread, tightness, digest), codes


def train(job: Job) -> None:
    """The network that regresses codes from pictures."""
    given, data = job.input, StaticData(job.input.data)
    settings = PictureNetwork(**job.params.settings)
    space, codes = code_space(load_codec(Path(given.model) / BEST), data)
    pictures, training = PictureData(given.pictures, len(data)), settings.training
    rows = PictureRows(pictures, codes, data)
    fit(
        PictureCoder(settings, pictures.size_px, space),
        TrainingBatches(rows, batch=training.batch, seed=training.seed),
        TrainingRun.of(job),
        monitor="val_loss",
        settings={**settings.plain(), "size_px": pictures.size_px, "model": space.model},
    )
