"""Templates of Garment4D's garment types: the mesh that all garments of a type are brought to."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drapeline.storage import load_npz, save_npz

# The openings of each type, in the order of their numbers.
LOOP_NAMES = {
    "Skirt": ("waist", "hem"),
    "Tshirt": ("neck", "hem", "left_cuff", "right_cuff"),
    "Trousers": ("waist", "left_cuff", "right_cuff"),
}
_ARRAYS = {
    "vertices": "float n 3",
    "faces": "int<n * 3",
    "loop": "int n",
    "loop_names": "str *",
}


@dataclass(frozen=True)
class GarmentTemplate:
    """A garment whose topology stands for its whole type.

    Attributes:
        vertices: (N, 3) float32 metres, root frame, in `REST_POSE` on the mean body.
        faces: (F, 3) int32, counter-clockwise seen from outside.
        loop: (N,) int32, -1 within the cloth, else the number of the opening it lies on.
        loop_names: name of each opening: "waist", "hem", "neck", "left_cuff", "right_cuff".
    """

    vertices: np.ndarray
    faces: np.ndarray
    loop: np.ndarray
    loop_names: tuple[str, ...]

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        save_npz(path, **{name: np.asarray(getattr(self, name)) for name in _ARRAYS})


def load_template(path: str | Path) -> GarmentTemplate:
    """Read what `GarmentTemplate.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    a = load_npz(path, _ARRAYS)
    return GarmentTemplate(
        a["vertices"], a["faces"], a["loop"], tuple(str(name) for name in a["loop_names"])
    )


def named_loops(
    vertices: np.ndarray, loops: list[np.ndarray], names: tuple[str, ...]
) -> dict[str, np.ndarray]:
    """Tell which boundary loop is which opening, by its place on the body.

    Args:
        vertices: (V, 3) in the rest pose, root frame.
        loops: ordered vertex ids of each.
        names: openings of the garment's type.

    Returns:
        Name -> loop. Cuffs lie furthest to either side; of the other loops the highest is the
        waist or neck and the lowest the hem. Missing openings are left out, and surplus loops are
        ignored.
    """
    rest = list(loops)
    middle = {id(loop): vertices[loop].mean(axis=0) for loop in loops}
    named = {}

    def take(name: str, axis: int, sign: float) -> None:
        if name in names and rest:
            best = max(range(len(rest)), key=lambda k: sign * middle[id(rest[k])][axis])
            named[name] = rest.pop(best)

    take("waist", 2, 1.0)
    if "left_cuff" in names and len(rest) >= 2:
        take("left_cuff", 0, 1.0)
        take("right_cuff", 0, -1.0)
    take("neck", 2, 1.0)
    take("hem", 2, -1.0)
    return named
