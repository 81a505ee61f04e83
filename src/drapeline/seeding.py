"""Independent, reproducible random streams; every random function takes a generator first."""

import hashlib

import numpy as np


def rng_for(seed: int, *names: str | float) -> np.random.Generator:
    """Generator for a single purpose that depends on `seed` and `names`, and on no other calls.

    Args:
        seed: the experiment's seed; 0 is a seed like any other.
        names: what the stream is for, such as ``("shape", "00012")``.
    """
    digest = hashlib.sha256("\x1f".join(str(name) for name in (seed, *names)).encode()).digest()
    return np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))
