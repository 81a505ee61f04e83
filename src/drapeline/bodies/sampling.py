"""Which body each sample gets."""

import numpy as np

COMPONENTS = 10


def sample_shape(rng: np.random.Generator, shape_range: float) -> np.ndarray:
    """Shape coefficients (10,), uniform within plus or minus `shape_range` (3 in CLOTH3D 3.1)."""
    return rng.uniform(-shape_range, shape_range, COMPONENTS)
