"""All registered static garments in memory-mapped arrays."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS, gender_codes, gender_names
from drapeline.learning_data.vertex_moments import body_statistics
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import topology_codes
from drapeline.rule_log import progress
from drapeline.storage import ArrayFiles, atomic_folder, load_npz, open_arrays, save_npz

_ROWS = {
    "shape": "float n 10",
    "gender": f"int<{len(GENDERS)} n",
    "tightness": "float n 2",
    "garment": f"int<{len(GARMENTS)} n",
    "outfit": "str n",
    "split": "str n",
}
_OFFSETS = {"offsets": "float n v 3", "mask": "bool n v"}


def collect_static(
    output: str | Path, shards: Sequence[str | Path], bodies: dict[str, BodyModel]
) -> int:
    """Join registered shards into one folder with statistics of the training rows' bodies.

    Args:
        output: folder, replaced as a whole.
        shards: `.npz` files of `register_shard`.
        bodies: super-resolved, by gender.

    Returns:
        Number of garments.

    Raises:
        InputError: a shard lacks arrays or has another number of vertices than the bodies, or no
            row is for training.
    """
    about = [load_npz(path, _ROWS) for path in shards]
    rows = {key: np.concatenate([part[key] for part in about]) for key in _ROWS}
    chosen = np.flatnonzero(rows["split"] == "train")
    if not len(chosen):
        raise InputError(f"{output}: no garment is for training, expected one or more")
    count = len(next(iter(bodies.values())).v_template)
    _, first = np.unique(rows["outfit"][chosen], return_index=True)  # each body once
    body_mean, body_std = body_statistics(
        rest_body(bodies[GENDERS[rows["gender"][row]]], rows["shape"][row])
        for row in progress(chosen[first], label="bodies")
    )
    with atomic_folder(output) as scratch:
        shape = (len(rows["split"]), count)
        files = ArrayFiles(
            scratch, {"offsets": (np.float32, (*shape, 3)), "mask": (np.bool_, shape)}
        )
        for path, own in progress(
            zip(shards, about, strict=True), total=len(shards), label="shards"
        ):
            part = load_npz(path, _OFFSETS, n=len(own["split"]))
            for array in part.values():
                if array.shape[1] != count:
                    raise InputError(
                        f"{path}: counts {array.shape[1]} body vertices, expected {count};"
                        " register it anew"
                    )
            files.append(**part)
        files.flush()
        save_npz(scratch / "rows.npz", **rows)
        save_npz(scratch / "statistics.npz", body_mean=body_mean, body_std=body_std)
    return len(rows["split"])


CONDITIONS = 13  # of a garment at rest


def static_cvar(shape: np.ndarray, gender: np.ndarray, tightness: np.ndarray) -> np.ndarray:
    """Static conditions (n, 13) float32: shape (n, 10), gender (n,), signed tightness (n, 2)."""
    codes = gender_codes(gender)[:, None]
    return np.concatenate([shape, codes, tightness], axis=1).astype(np.float32)


class StaticData:
    """Static garments, as `collect_static` wrote them.

    Attributes:
        offsets: (N, V, 3) float32 metres, memory-mapped.
        mask: (N, V) bool, memory-mapped.
        shape: (N, 10) float32.
        gender: (N,) "female" or "male".
        tightness: (N, 2) float32, with the gender's sign.
        garment: (N,) int8, index into `GARMENTS`.
        outfit, split: (N,) str.
        body_mean, body_std: (V, 3) float32 of the rest bodies, over training rows.
    """

    def __init__(self, folder: str | Path) -> None:
        """Open a folder of the rule `collect_static`.

        Raises:
            InputError: a file is missing or the files count different rows.
        """
        self.folder = Path(folder)
        rows = load_npz(self.folder / "rows.npz", _ROWS)
        statistics = load_npz(
            self.folder / "statistics.npz",
            dict.fromkeys(("body_mean", "body_std"), "float v 3"),
        )
        self.shape, self.tightness = rows["shape"], rows["tightness"]
        self.gender = gender_names(rows["gender"])
        self.garment, self.outfit, self.split = rows["garment"], rows["outfit"], rows["split"]
        self.body_mean, self.body_std = statistics["body_mean"], statistics["body_std"]
        arrays = open_arrays(self.folder, _OFFSETS, n=len(self), v=len(self.body_mean))
        self.offsets, self.mask = arrays["offsets"], arrays["mask"]

    def __len__(self) -> int:
        return len(self.garment)

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of "train", "val" or "test"."""
        return np.flatnonzero(self.split == split)

    def cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, 13) float32 conditions: shape, gender, signed tightness."""
        return static_cvar(self.shape[rows], self.gender[rows], self.tightness[rows])

    def mirrored_cvar(self, rows: np.ndarray) -> np.ndarray:
        """(n, 13) float32 conditions of the rows' mirror images: those of the rows."""
        return self.cvar(rows)

    def topology(self, rows: np.ndarray) -> np.ndarray:
        """(n,) codes of `TOPOLOGIES`."""
        return topology_codes(self.garment[rows])

    def names(self, rows: np.ndarray) -> list[str]:
        """Outfit and garment of rows, for messages."""
        return [
            f"{outfit}/{GARMENTS[garment]}"
            for outfit, garment in zip(self.outfit[rows], self.garment[rows], strict=True)
        ]

    def batch(self, rows: np.ndarray) -> dict[str, np.ndarray | list[str]]:
        """Arrays of rows: `offsets`, `mask`, `cvar`, `topology` and `names`."""
        return {
            "offsets": np.asarray(self.offsets[rows]),
            "mask": np.asarray(self.mask[rows]),
            "cvar": self.cvar(rows),
            "topology": self.topology(rows),
            "names": self.names(rows),
        }
