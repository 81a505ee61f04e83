"""Somebody dressed in motion, as files that other programs open, by the suffixes of their names."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drapeline.dataset.gltf import write_glb
from drapeline.dataset.mesh_files import write_caches, write_obj_sequence
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.errors import InputError
from drapeline.generation.moving_outfits import SimulatedOutfit, write_outfit
from drapeline.report.colours import garment_colour
from drapeline.report.dataset.people import render_people
from drapeline.report.dataset.viewer import write_viewer
from drapeline.storage import atomic_folder, copy_folder

_PICTURE = (480, 640)  # pixels


def save_outfit(path: str | Path, worn: SimulatedOutfit, *, folder_format: str = "cloth3d") -> None:
    """Write somebody in clothes in motion, as `drapeline dress` does.

    Args:
        path: .glb; .html, a page that plays; .webp, a moving picture of 48 frames or more; .usdc
            (with usd-core or bpy); .abc (with bpy); or a folder.
        worn: what `simulate` or `StaticModel.animate` returns; each garment type has its colour.
        folder_format: what a path without a suffix is: "cloth3d", a sample in CLOTH3D's format;
            "obj", OBJ files, one for each frame; "pc2" or "mdd", caches of points beside an OBJ.

    Raises:
        InputError: the suffix or format is unknown, or what writes its files is not installed.
    """
    path = Path(path)
    check_output(path)
    if folder_format not in _FOLDERS:
        raise InputError(
            f"folder_format: '{folder_format}', expected one of {', '.join(FOLDER_FORMATS)}"
        )
    with TemporaryDirectory(prefix="drapeline-") as name:
        sample = Path(name, path.stem or "dressed")
        write_outfit(sample, worn, {kind: garment_colour(kind) for kind in worn.garments})
        write_output(path, sample, folder_format)


def check_output(path: Path) -> None:
    """Refuse a name of no known format before anything is done.

    Raises:
        InputError: the suffix is unknown, or what writes its files is not installed.
    """
    if path.suffix and path.suffix.lower() not in _FILES:
        raise InputError(
            f"{path}: '{path.suffix}' is unknown, expected {', '.join(_FILES)} or a folder"
        )
    if path.suffix.lower() in _NEEDS:
        package, test = _NEEDS[path.suffix.lower()]
        try:
            test()
        except ImportError as error:
            raise InputError(f"{path}: needs {package} ({error})") from error
    if path.is_dir() and path.suffix:
        raise InputError(f"{path}: a folder, expected a file")


def write_output(path: Path, sample: Path, folder_format: str) -> None:
    """Write a sample to a file by its suffix, or to a folder in one of `FOLDER_FORMATS`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix:
        _FILES[path.suffix.lower()](path, sample)
    else:
        _FOLDERS[folder_format](path, sample)


def _write_scene(write: Callable[..., Any]) -> Callable[[Path, Path], None]:
    def write_parts(path: Path, sample: Path) -> None:
        with Sample(sample) as opened:
            write(path, scene_parts(opened))

    return write_parts


def _usd() -> Callable[..., None]:
    from drapeline.blender.usd import write_usd  # here, because few have USD's library

    return write_usd


def _alembic() -> Callable[..., None]:
    from drapeline.blender.export import write_alembic  # here, because few have Blender

    return write_alembic


def _write_folder(write: Callable[..., None]) -> Callable[[Path, Path], None]:
    def write_parts(path: Path, sample: Path) -> None:
        with Sample(sample) as opened, atomic_folder(path) as scratch:
            write(scratch, scene_parts(opened))

    return write_parts


def _late(writer: Callable[[], Callable[..., None]]) -> Callable[[Path, Path], None]:
    return lambda path, sample: _write_scene(writer())(path, sample)


_FILES: dict[str, Callable[[Path, Path], Any]] = {
    ".glb": _write_scene(write_glb),
    ".html": write_viewer,
    ".webp": lambda path, sample: render_people(path, [sample], size=_PICTURE),
    ".usdc": _late(_usd),
    ".abc": _late(_alembic),
}
_NEEDS: dict[str, tuple[str, Callable[[], Any]]] = {
    ".usdc": ("USD's library, usd-core or bpy", _usd),
    ".abc": ("Blender, bpy", _alembic),
}
_FOLDERS: dict[str, Callable[[Path, Path], Any]] = {
    "cloth3d": lambda path, sample: copy_folder(sample, path),
    "obj": _write_folder(write_obj_sequence),
    "pc2": _write_folder(lambda folder, parts: write_caches(folder, parts, ".pc2")),
    "mdd": _write_folder(lambda folder, parts: write_caches(folder, parts, ".mdd")),
}
FOLDER_FORMATS = sorted(_FOLDERS)
