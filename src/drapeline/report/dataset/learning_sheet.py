"""A sheet of samples of the learning group, for a look at what networks learn from."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.dataset.record import read_record
from drapeline.errors import InputError
from drapeline.rendering.picture_grid import save_contact_sheet
from drapeline.report.dataset.gallery import render_still
from drapeline.rule_log import progress

_SIZE = (210, 280)
_COLUMNS = 8


def plot_learning(path: str | Path, samples: Sequence[str | Path], *, most: int) -> int:
    """Draw the middle frames of accepted samples, spread evenly over all of them.

    Args:
        path: the PNG.
        samples: folders of all samples of the group.
        most: samples to show at most.

    Returns:
        Number of samples shown.

    Raises:
        InputError: no sample was accepted, or a file is unusable.
    """
    records = [record for record in map(read_record, samples) if record.accepted]
    if not records:
        raise InputError(
            f"{path}: none of {len(samples)} samples was accepted, expected one or more to show"
        )
    rows = np.linspace(0, len(records) - 1, min(most, len(records))).round().astype(int)
    shown = [records[row] for row in rows]
    pictures = [
        (render_still(record.folder, _SIZE), _caption(record.meta))
        for record in progress(shown, total=len(shown), label="samples")
    ]
    save_contact_sheet(path, pictures, min(_COLUMNS, len(pictures)), letter=11)
    return len(pictures)


def _caption(meta: Mapping[str, Any]) -> str:
    motion = meta["motion"]
    clip, turned = motion["sequence"].rpartition("_")[0], ", mirrored" if motion["mirrored"] else ""
    return f"{meta['id']}: {clip} at {motion['speed']:.2f}{turned}"
