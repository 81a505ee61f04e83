"""Garments in motion for the DVAE: frames of simulated samples as arrays that are mapped."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.dataset.reader import Sequence as Sample
from drapeline.errors import InputError
from drapeline.nets.checkpoints import load_vae
from drapeline.nets.fitting import BEST
from drapeline.nets.gcvae_data import Batch, as_tensors
from drapeline.nets.gcvae_training import GarmentVae
from drapeline.outfits.fit import rest_body, signed_tightness
from drapeline.outfits.kinds import GARMENTS
from drapeline.registration.dynamic import Version, dynamic_offsets, load_sample_garment
from drapeline.registration.topology import topology_codes
from drapeline.rule_log import progress
from drapeline.storage import load_npz, mapped, read_json, save_npz, whole_folder

# A condition on f frames is on the pose of the frame and of f - 1 before it, every third.
HISTORY_FRAMES, HISTORY_STEP = 4, 3
_GARMENT_KEYS = ("sample", "split", "garment", "shape", "gender", "tightness", "mask", "static")


@dataclass(frozen=True)
class _Recording:
    """One garment of one sample: what does not change from frame to frame, and its frames."""

    about: dict[str, Any]
    frames: np.ndarray
    poses: np.ndarray
    offsets: np.ndarray
    base: np.ndarray


def collect_dynamic(
    output: str | Path,
    samples: Mapping[str | Path, str | Path],
    bodies: Mapping[str, BodyModel],
    *,
    version: Version,
    step: int,
) -> int:
    """Write every `step`-th frame of all accepted samples' garments as arrays.

    Args:
        output: folder, replaced as a whole.
        samples: sample's folder -> its registration's folder.
        bodies: super-resolved, by gender.
        version: of the offsets.
        step: of the frames taken.

    Returns:
        Number of frames written.

    Raises:
        InputError: no sample was accepted, or a file is unusable.
    """
    found = [
        recording
        for sample, registration in progress(samples.items(), total=len(samples), label="samples")
        for recording in _recordings(Path(sample), Path(registration), bodies, version, step)
    ]
    if not found:
        raise InputError(
            f"{output}: none of {len(samples)} samples was accepted, expected one or more"
        )
    counts = [len(recording.frames) for recording in found]
    with whole_folder(output) as scratch:
        for key in ("offsets", "base"):
            np.save(scratch / f"{key}.npy", np.concatenate([getattr(r, key) for r in found]))
        save_npz(
            scratch / "frames.npz",
            frame=np.concatenate([r.frames for r in found]),
            poses=np.concatenate([r.poses for r in found]),
            wearer=np.repeat(np.arange(len(found)), counts),
        )
        save_npz(
            scratch / "garments.npz",
            version=np.array(version),
            **{key: np.stack([r.about[key] for r in found]) for key in _GARMENT_KEYS},
        )
    return sum(counts)


def _recordings(
    folder: Path,
    registration: Path,
    bodies: Mapping[str, BodyModel],
    version: Version,
    step: int,
) -> Iterator[_Recording]:
    status = read_json(registration / "status.json")
    if status["status"] != "accepted":
        return
    with Sample(folder) as sample:
        info, body = sample.info, bodies[sample.gender]
        frames = np.arange(0, sample.frame_count, step)
        back = frames[:, None] - HISTORY_STEP * np.arange(HISTORY_FRAMES)
        poses = info.poses[np.maximum(back, 0)].astype(np.float32)  # (n, 4, 72)
        rest = rest_body(body, info.shape)
        for name in sample.garments:
            garment = load_sample_garment(registration / f"{name}.npz")
            cloth = sample.vertices(name, frame="root")[frames]
            if version == "posed":
                base = posed_vertices(body, info.shape, poses[:, 0])[0]
            else:
                base = np.repeat((rest + garment.offsets)[None], len(frames), 0)
            yield _Recording(
                about={
                    "sample": np.array(status["id"]),
                    "split": np.array(status["split"]),
                    "garment": np.int8(GARMENTS.index(name)),
                    "shape": np.asarray(info.shape, dtype=np.float32),
                    "gender": np.int8(info.gender),
                    "tightness": signed_tightness(sample.tightness, sample.gender).astype(
                        np.float32
                    ),
                    "mask": garment.mask,
                    "static": garment.offsets,
                },
                frames=frames,
                poses=poses,
                offsets=dynamic_offsets(garment, cloth, body, info.shape, poses[:, 0], version),
                base=base.astype(np.float32),
            )


class DynamicData:
    """What `collect_dynamic` wrote; a row is one frame of one garment.

    Attributes:
        version: "posed" or "unposed".
        offsets, base: (N, V, 3) float32 metres, memory-mapped: X, and what X is added to.
        frame: (N,) number of the frame.
        poses: (N, 4, 72) rad, of the frame and of three before it, each three frames earlier.
        wearer: (N,) index into what follows.
        sample, split, garment: (G,) of each garment.
        shape, gender, tightness: (G, 10), (G,), (G, 2).
        mask, static: (G, V) bool and (G, V, 3) float32 metres, of the rest pose.
    """

    def __init__(self, folder: str | Path) -> None:
        """Open a folder.

        Raises:
            InputError: a file is missing or lacks an array.
        """
        folder = Path(folder)
        frames = load_npz(folder / "frames.npz", "frame", "poses", "wearer")
        garments = load_npz(folder / "garments.npz", "version", *_GARMENT_KEYS)
        self.frame, self.poses, self.wearer = (frames[k] for k in ("frame", "poses", "wearer"))
        self.version = str(garments.pop("version"))
        for key in _GARMENT_KEYS:
            setattr(self, key, garments[key])
        self.offsets, self.base = (mapped(folder / f"{key}.npy") for key in ("offsets", "base"))

    def __len__(self) -> int:
        return len(self.frame)

    def rows(self, split: str) -> np.ndarray:
        """Indices of the frames of "train", "val" or "test"."""
        return np.flatnonzero(self.split[self.wearer] == split)

    def topology(self, rows: np.ndarray) -> np.ndarray:
        """(n,) codes of `TOPOLOGIES`."""
        return topology_codes(self.garment[self.wearer[rows]])

    def static_batch(self) -> Batch:
        """All garments in the rest pose, as an SVAE takes them."""
        return {
            "offsets": self.static,
            "mask": self.mask,
            "cvar": self.static_cvar(),
            "topology": topology_codes(self.garment),
            "garment": self.garment,
            "names": [
                f"{sample}/{GARMENTS[kind]}"
                for sample, kind in zip(self.sample, self.garment, strict=True)
            ],
        }

    def static_cvar(self) -> np.ndarray:
        """(G, 13) shape, gender and signed tightness."""
        parts = (self.shape, self.gender[:, None], self.tightness)
        return np.concatenate(parts, 1).astype(np.float32)


class DynamicGarments:
    """Rows of a `DynamicData` with their conditions, for training, encoding and decoding.

    Args:
        data: frames.
        codes: (G, Z) static code z_s of each garment.
        frames: f, how many poses are conditioned on; 1 to 4.
    """

    def __init__(self, data: DynamicData, codes: np.ndarray, frames: int) -> None:
        self.data, self.codes, self.frames = data, codes, frames

    def rows(self, split: str) -> np.ndarray:
        """Indices of the frames of a split."""
        return self.data.rows(split)

    def topology(self, rows: np.ndarray) -> np.ndarray:
        """(n,) codes of `TOPOLOGIES`."""
        return self.data.topology(rows)

    def cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, 13 + 72 f + Z) float32: static conditions, poses, static code."""
        wearer = self.data.wearer[rows]
        poses = self.data.poses[rows, : self.frames].reshape(len(rows), -1)
        return np.concatenate([self.data.static_cvar()[wearer], poses, self.codes[wearer]], 1)

    def batch(self, rows: np.ndarray) -> Batch:
        """Arrays of rows."""
        data, wearer = self.data, self.data.wearer[rows]
        return {
            "offsets": np.asarray(data.offsets[rows]),
            "base": np.asarray(data.base[rows]),
            "mask": data.mask[wearer],
            "cvar": self.cvar(rows),
            "topology": self.topology(rows),
            "garment": data.garment[wearer],
            "names": [
                f"{data.sample[w]}/{GARMENTS[data.garment[w]]}/{frame}"
                for w, frame in zip(wearer, data.frame[rows], strict=True)
            ],
        }


def static_codes(model: GarmentVae, data: DynamicData) -> np.ndarray:
    """(G, Z) float32: mean static code of each garment."""
    batch = data.static_batch()
    parts = []
    for start in range(0, len(data.garment), 16):
        rows = slice(start, start + 16)
        part = as_tensors({key: value[rows] for key, value in batch.items()})
        parts.append(model.encode(part).mean.numpy())
    return np.concatenate(parts)


def dynamic_garments(folder: str | Path, static: str | Path, frames: int) -> DynamicGarments:
    """Frames with their conditions.

    Args:
        folder: of the rule `collect_dynamic`.
        static: folder of the trained SVAE that gives z_s.
        frames: f, how many poses are conditioned on; 1 to 4.
    """
    data, model = DynamicData(folder), load_vae(Path(static) / BEST)
    return DynamicGarments(data, static_codes(model, data), frames)
