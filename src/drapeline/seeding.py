"""Independent, reproducible random streams; every random function takes a generator first."""

import hashlib

import numpy as np


def rng_for(seed: int, *names: str | int) -> np.random.Generator:
    """Random stream for a single purpose, independent of all others and of the order of calls.

    Args:
        seed: the experiment's seed; 0 is a seed like any other.
        names: what the stream is for, such as ``("shape", "00012")``.

    Returns:
        A generator that depends only on `seed` and `names`.
    """
    digest = hashlib.sha256("\x1f".join(str(name) for name in (seed, *names)).encode()).digest()
    return np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))
