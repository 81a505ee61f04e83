"""Garments in motion: frames of simulated samples as memory-mapped arrays."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import rest_body, signed_tightness
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import STATUS
from drapeline.errors import InputError
from drapeline.frames import GENDERS, gender_names
from drapeline.learning_data.static import static_cvar
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.dynamic_offsets import (
    Version,
    dynamic_offsets,
    load_sample_garment,
)
from drapeline.registration.to_body.topology import topology_codes
from drapeline.rule_log import progress
from drapeline.storage import ArrayFiles, atomic_folder, load_npz, open_arrays, read_json, save_npz

# Poses that a frame may be conditioned on: its own and those of three before it, every third.
HISTORY_FRAMES, HISTORY_STEP = 4, 3

_GARMENT_KEYS = {
    **dict.fromkeys(("sample", "split"), "str g"),
    "garment": f"int<{len(GARMENTS)} g",
    "shape": "float g 10",
    "gender": f"int<{len(GENDERS)} g",
    "tightness": "float g 2",
}
# Mapped, since many samples do not fit into memory; a row is a frame, or a garment.
_FRAME_ARRAYS = {
    **dict.fromkeys(("offsets", "base"), "float n v 3"),
    "poses": f"float n {HISTORY_FRAMES} 72",
}
_GARMENT_ARRAYS = {"mask": "bool g v", "static": "float g v 3"}


@dataclass(frozen=True)
class _AcceptedSample:
    """A sample to collect: its garments, and the frames taken of each."""

    folder: Path
    registration: Path
    garments: list[str]
    frames: np.ndarray


@dataclass(frozen=True)
class _Recording:
    """A garment of a sample: what all of its frames share, and the frames."""

    about: dict[str, Any]
    mask: np.ndarray
    static: np.ndarray
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
        step: of the frames taken.

    Returns:
        Number of frames written.

    Raises:
        InputError: no sample was accepted, or a file is unusable.
    """
    accepted = [
        found
        for sample, registration in samples.items()
        for found in _accepted_sample(Path(sample), Path(registration), step)
    ]
    if not accepted:
        raise InputError(
            f"{output}: none of {len(samples)} samples was accepted, expected one or more"
        )
    frames = [sample.frames for sample in accepted for _ in sample.garments]
    counts = [len(numbers) for numbers in frames]
    vertices = (len(next(iter(bodies.values())).v_template), 3)
    with atomic_folder(output) as scratch:
        files = ArrayFiles(
            scratch,
            {
                "offsets": (np.float32, (sum(counts), *vertices)),
                "base": (np.float32, (sum(counts), *vertices)),
                "poses": (np.float32, (sum(counts), HISTORY_FRAMES, 72)),
                "mask": (np.bool_, (len(counts), vertices[0])),
                "static": (np.float32, (len(counts), *vertices)),
            },
        )
        about: list[dict[str, Any]] = []
        for sample in progress(accepted, label="samples"):
            for recording in _recordings(sample, bodies, version):
                files.append(**{key: getattr(recording, key) for key in _FRAME_ARRAYS})
                files.append(**{key: getattr(recording, key)[None] for key in _GARMENT_ARRAYS})
                about.append(recording.about)
        files.flush()
        save_npz(
            scratch / "frames.npz",
            frame=np.concatenate(frames),
            garment_index=np.repeat(np.arange(len(counts)), counts),
        )
        save_npz(
            scratch / "garments.npz",
            version=np.array(version),
            **{key: np.stack([row[key] for row in about]) for key in _GARMENT_KEYS},
        )
    return sum(counts)


def _accepted_sample(folder: Path, registration: Path, step: int) -> Iterator[_AcceptedSample]:
    if read_json(registration / "status.json", STATUS)["status"] == "accepted":
        with Sample(folder) as sample:
            frames = np.arange(0, sample.frame_count, step)
            yield _AcceptedSample(folder, registration, list(sample.garments), frames)


def _recordings(
    accepted: _AcceptedSample, bodies: Mapping[str, BodyModel], version: Version
) -> Iterator[_Recording]:
    status = read_json(accepted.registration / "status.json", STATUS)
    frames = accepted.frames
    with Sample(accepted.folder) as sample:
        info, body = sample.info, bodies[sample.gender]
        if info.tightness is None:
            raise InputError(f"{accepted.folder}: info.mat has no tightness, expected two numbers")
        tightness = signed_tightness(info.tightness, sample.gender).astype(np.float32)
        back = frames[:, None] - HISTORY_STEP * np.arange(HISTORY_FRAMES)
        poses = info.poses[np.maximum(back, 0)].astype(np.float32)  # (n, 4, 72)
        rest = rest_body(body, info.shape)
        for name in accepted.garments:
            garment = load_sample_garment(accepted.registration / f"{name}.npz")
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
                    "gender": np.int8(GENDERS.index(info.gender)),
                    "tightness": tightness,
                },
                mask=garment.mask,
                static=garment.offsets,
                poses=poses,
                offsets=dynamic_offsets(garment, cloth, body, info.shape, poses[:, 0], version),
                base=base.astype(np.float32),
            )


class DynamicData:
    """Frames of garments, as `collect_dynamic` writes them; a row is a frame of one garment.

    Attributes:
        version: "posed" or "unposed".
        offsets, base: (N, V, 3) float32 metres, memory-mapped: X, and what X is added to.
        poses: (N, 4, 72) rad, memory-mapped, of the frame and of three before it, each three
            frames earlier than the next.
        frame: (N,) number of the frame.
        garment_index: (N,) index of the frame's garment among the G garments.
        sample, split: (G,) names, of each garment.
        garment: (G,) its type, an index into `GARMENTS`.
        shape, gender, tightness: (G, 10), (G,) "female" or "male", (G, 2).
        mask, static: (G, V) bool and (G, V, 3) float32 metres, memory-mapped, of the rest pose.
    """

    offsets: np.ndarray
    base: np.ndarray
    poses: np.ndarray
    sample: np.ndarray
    split: np.ndarray
    garment: np.ndarray
    shape: np.ndarray
    gender: np.ndarray
    tightness: np.ndarray
    mask: np.ndarray
    static: np.ndarray

    def __init__(self, folder: str | Path) -> None:
        """Open a folder.

        Raises:
            InputError: a file is missing or lacks an array.
        """
        folder = Path(folder)
        garments = load_npz(folder / "garments.npz", {"version": "str", **_GARMENT_KEYS})
        count = len(garments["garment"])
        frames = load_npz(
            folder / "frames.npz", {"frame": "int n", "garment_index": "int<g n"}, g=count
        )
        self.frame, self.garment_index = frames["frame"], frames["garment_index"]
        self.version = cast(Version, str(garments.pop("version")))
        garments["gender"] = gender_names(garments["gender"])
        for key in _GARMENT_KEYS:
            setattr(self, key, garments[key])
        arrays = open_arrays(folder, _FRAME_ARRAYS | _GARMENT_ARRAYS, n=len(self.frame), g=count)
        for key, array in arrays.items():
            setattr(self, key, array)

    def __len__(self) -> int:
        return len(self.frame)

    def rows(self, split: str) -> np.ndarray:
        """Indices of the frames of "train", "val" or "test"."""
        return np.flatnonzero(self.split[self.garment_index] == split)

    def topology(self, rows: np.ndarray) -> np.ndarray:
        """(n,) codes of `TOPOLOGIES`."""
        return topology_codes(self.garment[self.garment_index[rows]])

    def rows_of(self, sample: str, garment: str) -> np.ndarray:
        """Indices of the frames of a sample's garment, one of `GARMENTS`, in their order."""
        wanted = (self.sample == sample) & (self.garment == GARMENTS.index(garment))
        return np.flatnonzero(np.isin(self.garment_index, np.flatnonzero(wanted)))

    def static_batch(self, garments: np.ndarray) -> dict[str, Any]:
        """Garments (g,) in the rest pose, as an SVAE takes them."""
        types = self.garment[garments]
        return {
            "offsets": np.asarray(self.static[garments]),
            "mask": np.asarray(self.mask[garments]),
            "cvar": self.cvar(garments),
            "topology": topology_codes(types),
            "names": [
                f"{sample}/{GARMENTS[garment_type]}"
                for sample, garment_type in zip(self.sample[garments], types, strict=True)
            ],
        }

    def cvar(self, garments: np.ndarray) -> np.ndarray:
        """(g, 13) static conditions of garments (g,)."""
        return static_cvar(self.shape[garments], self.gender[garments], self.tightness[garments])
