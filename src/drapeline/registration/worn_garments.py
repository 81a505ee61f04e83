"""What is known of how the garments of a type are worn.

N vertices, K springs.
"""

from typing import NamedTuple

import numpy as np


class WornGarmentStatistics(NamedTuple):
    """How worn garments of a type differ from their skinned proposals.

    Attributes:
        shares: (K,) lengths of `springs` when worn, over those in the canonical
            garment.
        error_m: (N,) root mean square error of the proposals, metres.
        follow: (N,) share of the proposals' accelerations that the garments follow, 0 to 1.
    """

    shares: np.ndarray
    error_m: np.ndarray
    follow: np.ndarray
