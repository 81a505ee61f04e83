"""Windows of a few frames each that cover a whole sequence."""

from drapeline.errors import InputError


def window_starts(count: int, frames: int, stride: int, name: str) -> list[int]:
    """First frames of windows; the last one is shifted back to end with the sequence, not padded.

    Args:
        count: frames of the sequence.
        frames: T.
        stride: from one window to the next, at most T.

    Raises:
        InputError: the sequence is shorter than a window, or windows would leave out frames.
    """
    if count < frames:
        raise InputError(f"sequence {name} has {count} frames, expected at least {frames}")
    if stride > frames:
        raise InputError(
            f"sequence {name}: windows of {frames} frames have a stride of {stride}, expected at"
            f" most {frames}"
        )
    starts = list(range(0, count - frames + 1, stride))
    return starts if starts[-1] == count - frames else [*starts, count - frames]
