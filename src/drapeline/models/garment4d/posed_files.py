"""What the folder of a posed stage holds beside its checkpoint: all that its use takes.

With these files garments are reconstructed without the data of the training.
"""

from pathlib import Path
from typing import NamedTuple

from drapeline.bodies.model import load_body, save_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.models.garment4d.body_input import BodySet
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.garment4d.windows import BodySequences
from drapeline.models.garment4d.worn_statistics import (
    WornGarmentStatistics,
    training_worn_statistics,
)
from drapeline.storage import load_npz, save_npz

_SIZES, _BODIES = "reconstruction.npz", "bodies"


class PosedFiles(NamedTuple):
    """What reconstruction needs besides the networks.

    Attributes:
        bodies: of both genders.
        points: P, number per cloud that the networks were trained on.
        worn_statistics: of the simulated training sequences; None where there were none.
    """

    bodies: BodySet
    points: int
    worn_statistics: WornGarmentStatistics | None


def save_posed_files(folder: Path, sequences: BodySequences, skinning: SkinningSettings) -> None:
    """Complete the folder of a training.

    Args:
        folder: of the training.
        sequences: that the stage was trained on.
        skinning: of its proposals.
    """
    bodies = sequences.bodies
    for gender, body in bodies.models.items():
        save_body(folder / _BODIES / f"{gender}.npz", body)
    worn = training_worn_statistics(sequences, skinning)
    save_npz(
        folder / _SIZES,
        body_points=bodies.count,
        points=sequences.data.points.shape[1],
        **({} if worn is None else worn._asdict()),
    )


def load_posed_files(folder: str | Path) -> PosedFiles:
    """Read what `save_posed_files` wrote.

    Raises:
        InputError: a file is missing or damaged.
    """
    folder = Path(folder)
    names = WornGarmentStatistics._fields
    found = load_npz(
        folder / _SIZES,
        {"body_points": "int", "points": "int", **{f"{name}?": "float *" for name in names}},
    )
    for name in ("body_points", "points"):
        if found[name] < 1:
            raise InputError(
                f"{folder / _SIZES}: '{name}' is {int(found[name])}, expected at least 1"
            )
    bodies = {gender: load_body(folder / _BODIES / f"{gender}.npz") for gender in GENDERS}
    worn = WornGarmentStatistics(*(found[name] for name in names)) if names[0] in found else None
    return PosedFiles(BodySet(bodies, int(found["body_points"])), int(found["points"]), worn)
