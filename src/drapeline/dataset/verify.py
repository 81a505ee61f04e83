"""Compare finished files with the manifests that were written with them, and read all others."""

import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from drapeline.dataset.record import SAMPLE_MANIFEST
from drapeline.errors import DamagedFile, InputError, refuse_damage
from drapeline.manifest import MANIFEST, damages, read_manifest
from drapeline.rule_log import LOGGER, progress
from drapeline.storage import open_arrays, output_of, read_json

_SHOWN = 3  # damaged files in the message; the log has all


class Verified(NamedTuple):
    """How many files are as they were written, by their sums, and how many could be read."""

    compared: int
    read: int


def verify_results(root: str | Path) -> Verified:
    """Compare the dataset, the samples and the trained models below a folder with their sums.

    All other `.npz` and `.npy` files and JSON below it are read: an `.npz` has a sum of each array,
    an `.npy` has the size that its header says, JSON is whole.

    Raises:
        InputError: names the damaged files and what to delete, so that it is made anew; or there is
            nothing to compare.
    """
    root = Path(root)
    manifests, others = _finished(root)
    if not manifests:
        raise InputError(f"{root}: no {MANIFEST} below it, expected a dataset or a trained model")
    count = 0
    found: list[DamagedFile] = []
    for folder, name in progress(manifests, label="folders"):
        try:
            count += len(read_manifest(folder / name))
            found += damages(folder, name, sums=True)
        except DamagedFile as error:
            found.append(error)
    for path in progress(others, label="files"):
        try:
            _READERS[path.suffix](path)
        except DamagedFile as error:
            found.append(error)
    for damage in found:
        LOGGER.error("%s", damage)
    if found:
        raise InputError(_message(found, root))
    return Verified(count, len(others))


def _read_archive(path: Path) -> None:
    with refuse_damage(path, "arrays"), zipfile.ZipFile(path) as archive:
        if (damaged := archive.testzip()) is not None:
            raise DamagedFile(path, f"'{damaged}' is not as it was written")


def _read_array(path: Path) -> None:
    open_arrays(path.parent, {path.stem: "any|nan ..."})


_READERS: dict[str, Callable[[Path], object]] = {
    ".npz": _read_archive,
    ".npy": _read_array,
    ".json": read_json,
}


def _finished(root: Path) -> tuple[list[tuple[Path, str]], list[Path]]:
    """Folders that have a manifest, and its name; and files below none that can be read."""
    manifests, others = [], []
    for place, folders, files in os.walk(root):
        listed = next((n for n in (MANIFEST, SAMPLE_MANIFEST) if Path(place, n).is_file()), None)
        if listed is not None:
            manifests.append((Path(place), listed))
            folders.clear()  # what is below is in it
            continue
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        seen = sorted(name for name in files if not name.startswith("."))
        others += [Path(place, name) for name in seen if Path(name).suffix in _READERS]
    return manifests, others


def _message(found: list[DamagedFile], root: Path) -> str:
    count = "1 file is" if len(found) == 1 else f"{len(found)} files are"
    shown = "; ".join(map(str, found[:_SHOWN])) + ("; ..." if len(found) > _SHOWN else "")
    outputs = sorted({str(output_of(damage.path, root)) for damage in found})
    return (
        f"{count} damaged ({shown}); delete {', '.join(outputs)} and give the command again that"
        " made them"
    )
