"""Time and memory that jobs ask a cluster for, from what they are expected to need."""

import math

# Nodes differ, and a job that is cut off costs more than one that waits.
TIME_MARGIN, MEMORY_MARGIN = 3.0, 1.5
LEAST_MINUTES, MOST_MINUTES = 10, 24 * 60
LEAST_MB = 1000


def asked_minutes(seconds: float, attempt: int = 1) -> int:
    """Minutes to ask for where so many seconds are expected: more at each further try.

    At most a day, which longer trainings are continued after.
    """
    minutes = max(math.ceil(TIME_MARGIN * seconds / 60), LEAST_MINUTES) * attempt
    return min(minutes, MOST_MINUTES)


def asked_mb(megabytes: float, attempt: int = 1) -> int:
    """Megabytes to ask for where so many are expected: more at each further try."""
    return max(math.ceil(MEMORY_MARGIN * megabytes / 500) * 500, LEAST_MB) * attempt


def cloth_factor(edge_length_m: float) -> float:
    """Vertices of a garment, as a multiple of one with edges of 2 cm."""
    return (0.02 / edge_length_m) ** 2
