"""Lengths of pieces of a clip that are slower or faster than the recording."""

import math


def piece_frames(span: int, speed: float) -> int:
    """Frames that a piece of `span` frames of a clip takes at a speed, both ends included."""
    # Rounding must not lose the last frame of a span that a whole number of steps fills.
    return int((span - 1) / speed + 1e-6) + 1


def piece_span(frames: int, speed: float) -> int:
    """Frames of a clip that a piece of so many frames needs at a speed."""
    return math.ceil((frames - 1) * speed - 1e-6) + 1
