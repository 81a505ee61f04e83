"""The files of the pictures that a user names; for planning, so it imports little."""

from collections.abc import Sequence
from pathlib import Path

from drapeline.errors import InputError
from drapeline.storage import check_name, read_json


def picture_files(paths: Sequence[str | Path]) -> list[Path]:
    """The JSON files of pictures: those named, and all in folders that are named but hidden ones.

    Raises:
        InputError: there is none, two of them have one name, or a name may not become part of
            paths, see `storage.NAME_RULE`.
    """
    found: dict[str, Path] = {}
    for path in map(Path, paths):
        files = sorted(path.glob("[!.]*.json")) if path.is_dir() else [path]
        if not files:
            raise InputError(f"{path}: contains no .json, expected one per picture")
        for file in files:
            check_name(file.name.removesuffix(".json"), f"{file}: the picture's name")
            if file.stem in found:
                raise InputError(
                    f"{file}: a picture of that name is also in {found[file.stem].parent},"
                    " expected different names"
                )
            found[file.stem] = file
    return list(found.values())


def files_of_picture(path: str | Path) -> list[Path]:
    """The JSON and the images that it names, for those who wait for changes of any.

    Raises:
        InputError: it is not readable as JSON with entries by name.
    """
    path = Path(path)
    given = read_json(path, dict)
    people = given["people"] if isinstance(given.get("people"), list) else []
    named = [given.get(key) for key in ("segmentation", "photo", "instances")]
    named += [one.get("mask") for one in people if isinstance(one, dict)]
    return [path, *(path.parent / name for name in named if isinstance(name, str))]
