"""Compare finished files with the manifests that were written with them."""

import os
from collections.abc import Iterator
from pathlib import Path

from drapeline.dataset.record import SAMPLE_MANIFEST
from drapeline.errors import DamagedFile, InputError
from drapeline.manifest import MANIFEST, damages, read_manifest
from drapeline.rule_log import LOGGER, progress
from drapeline.storage import output_of

_SHOWN = 3  # damaged files in the message; the log has all


def verify_results(root: str | Path) -> int:
    """Read the dataset, the samples and the trained models below a folder and compare their sums.

    Returns:
        How many files were compared, all of them as they were written.

    Raises:
        InputError: names the damaged files and what to delete, so that it is made anew; or there is
            nothing to compare.
    """
    root = Path(root)
    manifests = dict(_manifests(root))
    if not manifests:
        raise InputError(f"{root}: no {MANIFEST} below it, expected a dataset or a trained model")
    count = 0
    found: list[DamagedFile] = []
    for folder, name in progress(manifests.items(), label="folders"):
        try:
            count += len(read_manifest(folder / name))
            found += damages(folder, name, sums=True)
        except DamagedFile as error:
            found.append(error)
    for damage in found:
        LOGGER.error("%s", damage)
    if found:
        raise InputError(_message(found, root))
    return count


def _manifests(root: Path) -> Iterator[tuple[Path, str]]:
    """Folders that have a manifest, and its name; what is below one is in it."""
    for place, folders, _ in os.walk(root):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in (MANIFEST, SAMPLE_MANIFEST):
            if (Path(place) / name).is_file():
                yield Path(place), name
                folders.clear()
                break


def _message(found: list[DamagedFile], root: Path) -> str:
    count = "1 file is" if len(found) == 1 else f"{len(found)} files are"
    shown = "; ".join(map(str, found[:_SHOWN])) + ("; ..." if len(found) > _SHOWN else "")
    outputs = sorted({str(output_of(damage.path, root)) for damage in found})
    return (
        f"{count} damaged ({shown}); delete {', '.join(outputs)} and give the command again that"
        " made them"
    )
