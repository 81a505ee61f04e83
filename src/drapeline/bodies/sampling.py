"""Which body each sample gets: shapes uniform, two women to one man (CLOTH3D 3 and 3.1)."""

import numpy as np

SHAPE_RANGE = 3.0
COMPONENTS = 10


def sample_shape(rng: np.random.Generator) -> np.ndarray:
    """Shape coefficients (10,), uniform in [-3, 3]."""
    return rng.uniform(-SHAPE_RANGE, SHAPE_RANGE, COMPONENTS)


def assign_genders(rng: np.random.Generator, count: int, female_share: float) -> np.ndarray:
    """Genders of `count` samples, 0 female and 1 male, in random order.

    The shares are met as closely as whole numbers allow, rather than drawn one by one, and with
    two samples or more both genders appear unless the share is 0 or 1: a small data set holds
    both too.

    Args:
        female_share: 2/3 in CLOTH3D, whose women's garments vary more.
    """
    women = round(count * female_share)
    if count > 1 and 0 < female_share < 1:
        women = min(max(women, 1), count - 1)
    genders = np.ones(count, dtype=np.int64)
    genders[:women] = 0
    return rng.permutation(genders)
