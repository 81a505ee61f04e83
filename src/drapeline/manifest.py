"""Manifests: sizes and SHA-256 sums of the files of a folder, by which damage is noticed."""

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from drapeline.errors import DamagedFile, InputError
from drapeline.storage import atomic_file, read_text

MANIFEST = "manifest.tsv"
_CHUNK = 1 << 20


class FileSum(NamedTuple):
    """Size that a file should have, and the hexadecimal digits of its SHA-256 sum."""

    bytes: int
    sha256: str


def sum_file(path: str | Path) -> FileSum:
    """Size and sum of a file as it is."""
    digest, size = hashlib.sha256(), 0
    with open(path, "rb") as stream:
        while chunk := stream.read(_CHUNK):
            digest.update(chunk)
            size += len(chunk)
    return FileSum(size, digest.hexdigest())


def check_sum(path: str | Path, expected: str) -> None:
    """Refuse a file whose SHA-256 sum is another one.

    Raises:
        InputError: it is.
    """
    found = sum_file(path).sha256
    if found != expected:
        raise InputError(f"{path}: has the SHA-256 sum {found}, expected {expected}")


def write_manifest(
    folder: str | Path, name: str = MANIFEST, known: Mapping[str, FileSum] | None = None
) -> None:
    """List the files in and below a folder; hidden ones do not count.

    Args:
        folder: whose files are listed by their paths within it, with "/".
        name: of the manifest, within the folder.
        known: sums of files that are not read again.
    """
    known = known or {}
    lines = [_HEADING]
    for file in sorted(_files(Path(folder))):
        if file != name:
            size, digest = known.get(file) or sum_file(Path(folder) / file)
            lines.append(f"{file}\t{size}\t{digest}")
    with atomic_file(Path(folder) / name) as scratch:
        scratch.write_text("\n".join(lines) + "\n")


def _files(folder: Path) -> Iterator[str]:
    for place, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            if not name.startswith("."):
                yield (Path(place) / name).relative_to(folder).as_posix()


def read_manifest(path: str | Path) -> dict[str, FileSum]:
    """File -> what it should be.

    Raises:
        DamagedFile: the manifest is missing or is none, or names a file outside its folder.
    """
    heading, *lines = read_text(path, "a manifest").removesuffix("\n").split("\n")
    if heading != _HEADING:
        raise DamagedFile(path, f"begins with '{heading:.100}', expected '{_HEADING}'")
    found = {}
    for number, line in enumerate(lines, 2):
        row = _ROW.fullmatch(line)
        if row is None or not {"", ".", ".."}.isdisjoint(row[1].split("/")):
            raise DamagedFile(
                path,
                f"line {number} is '{line:.100}', expected a file in its folder, a size and a sum",
            )
        found[row[1]] = FileSum(int(row[2]), row[3])
    return found


_HEADING = "file\tbytes\tsha256"
_ROW = re.compile(r"([^\t]+)\t([0-9]{1,19})\t([0-9a-f]{64})")


def damages(folder: str | Path, name: str = MANIFEST, *, sums: bool) -> Iterator[DamagedFile]:
    """List damages to the files of a folder; files that the manifest does not list may be there.

    Args:
        name: of the manifest, within the folder.
        sums: whether to read the files; otherwise only their sizes are compared.

    Raises:
        DamagedFile: the manifest itself is not usable.
    """
    manifest = f"{folder}/{name}"
    for file, wanted in read_manifest(manifest).items():
        path = f"{folder}/{file}"
        try:
            size = os.stat(path).st_size
            found = sum_file(path) if sums and size == wanted.bytes else wanted
        except OSError as error:
            yield DamagedFile(path, f"cannot be read ({error.strerror}), but {manifest} lists it")
            continue
        if size != wanted.bytes:
            yield DamagedFile(path, f"{size} bytes, expected {wanted.bytes} as in {manifest}")
        elif found != wanted:
            yield DamagedFile(path, f"its SHA-256 sum is not the one in {manifest}")
