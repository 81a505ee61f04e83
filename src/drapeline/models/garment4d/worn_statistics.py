"""How the worn garments of a type differ from their skinned proposals, over training sequences.

F frames, N vertices, K springs.
"""

from collections.abc import Iterable

import numpy as np

from drapeline.learning_data.sequences import SIMULATED
from drapeline.models.garment4d.dressed import propose_garment
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.garment4d.windows import BodySequences
from drapeline.registration.springs import spring_lengths, springs
from drapeline.registration.worn_garments import WornGarmentStatistics

_SMALL_M = 1e-9


def training_worn_statistics(
    sequences: BodySequences, skinning: SkinningSettings
) -> WornGarmentStatistics | None:
    """Statistics of the simulated training sequences of a type; None where there are none.

    Static outfits in motion follow their skinning, so they would tell nothing of cloth.

    Args:
        sequences: of the type.
        skinning: of the proposals that garments are compared with.
    """
    data = sequences.data
    chosen = data.of_split("train", (SIMULATED,))
    if not len(chosen):
        return None
    return measure_worn_garments(
        (data.garment[data.rows(sequence)] for sequence in chosen),
        (
            propose_garment(
                sequences.body(sequence),
                data.poses[data.rows(sequence)],
                data.canonical[sequence],
                data.space.faces,
                skinning,
            )
            for sequence in chosen
        ),
        (data.canonical[sequence] for sequence in chosen),
        data.space.faces,
    )


def measure_worn_garments(
    garments: Iterable[np.ndarray],
    proposals: Iterable[np.ndarray],
    canonicals: Iterable[np.ndarray],
    faces: np.ndarray,
) -> WornGarmentStatistics:
    """Means over training sequences and one more that has the mean at all vertices and springs.

    Cloth loses length to wrinkles finer than the template, and some parts of a garment are held by
    the body while others hang.

    Args:
        garments: (F, N, 3) worn garments of each sequence, simulated, metres.
        proposals: (F, N, 3) the same garments by skinning alone.
        canonicals: (N, 3) of the same sequences.
        faces: (E, 3).
    """
    pairs = springs(faces)[0]
    share, squared, products, squares = [], [], 0.0, 0.0
    for garment, proposal, rest in zip(garments, proposals, canonicals, strict=True):
        worn = spring_lengths(garment, pairs).mean(axis=0)
        share.append(worn / np.maximum(spring_lengths(rest, pairs), _SMALL_M))
        squared.append(((garment - proposal) ** 2).sum(-1).mean(axis=0))
        made, true = np.diff(proposal, 2, axis=0), np.diff(garment, 2, axis=0)
        products, squares = products + (made * true).sum((0, 2)), squares + (made**2).sum((0, 2))
    follow = (products + np.mean(products) / len(share)) / np.maximum(
        squares + np.mean(squares) / len(share), _SMALL_M**2
    )
    return WornGarmentStatistics(
        _with_mean(share), np.sqrt(_with_mean(squared)), np.clip(follow, 0, 1)
    )


def _with_mean(rows: list[np.ndarray]) -> np.ndarray:
    return (np.sum(rows, axis=0) + np.mean(rows)) / (len(rows) + 1)
