import pytest

from drapeline.dataset.windows import window_starts
from drapeline.errors import InputError


@pytest.mark.parametrize(
    ("count", "frames", "stride", "starts"),
    [
        (8, 4, 4, [0, 4]),
        (7, 4, 4, [0, 3]),
        (9, 4, 4, [0, 4, 5]),
        (4, 4, 2, [0]),
        (6, 3, 1, [0, 1, 2, 3]),
    ],
)
def test_windows_cover_every_frame_without_padding(count, frames, stride, starts):
    assert window_starts(count, frames, stride, "s") == starts
    covered = {start + k for start in starts for k in range(frames)}
    assert covered == set(range(count))


def test_windows_that_would_leave_out_frames_are_refused():
    with pytest.raises(InputError, match="sequence walk has 3 frames, expected at least 4"):
        window_starts(3, 4, 4, "walk")
    with pytest.raises(InputError, match="sequence walk: windows of 3 frames have a stride of 4"):
        window_starts(9, 3, 4, "walk")
