"""Read CLOTH3D-format datasets: drapeline's own and the original download."""

import os
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from drapeline.bodies.model import BodyModel, free_body, load_body, posed_vertices
from drapeline.dataset.info_mat import Placement, SampleInfo, read_info, read_placement
from drapeline.dataset.record import (
    BODY_MASKS,
    EXTRAS,
    GARMENT_MASKS,
    HEALTH,
    META,
    SAMPLE_MANIFEST,
    body_fingerprint,
    meta_path,
)
from drapeline.errors import DamagedFile, InputError, refuse_damage
from drapeline.frames import FPS
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import load_obj
from drapeline.geometry.point_cache import PointCache
from drapeline.manifest import MANIFEST, damages
from drapeline.outfits.garment_types import BODY
from drapeline.storage import load_npz, read_json

Frame = Literal["world", "root"]
_BLOCK = 32  # points


def open_dataset(
    root: str | Path,
    split: str | None = None,
    *,
    bodies: "Mapping[str, BodyModel | str | Path] | None" = None,
    rest_turned: bool = True,
) -> "Cloth3D":
    """Open a dataset in CLOTH3D's format, drapeline's own or the original download.

    Nothing is read before it is asked for.

    Args:
        root: contains samples (`{id}/info.mat`) or folders of samples (`train/{id}/info.mat`).
        split: the folder under `root` to read, such as "train"; all folders if None.
        bodies: gender -> body, or its file, such as SMPL's `.npz` or `.pkl`, for datasets that
            store no bodies, as the original download does not.
        rest_turned: whether the rest meshes of samples without a `meta.json` are rotated by
            `zrot`: True for the full CLOTH3D release, False for the samples of its starter kit.

    Raises:
        InputError: the folder does not exist or contains no sample, or a body cannot be read.
    """
    models = {
        gender: load_body(body) if isinstance(body, str | Path) else body
        for gender, body in (bodies or {}).items()
    }
    return Cloth3D(root, split, bodies=models, rest_turned=rest_turned)


class Cloth3D:
    """A dataset: a folder of CLOTH3D samples, or of splits that contain samples.

    Supports `len`, iteration, and indexing by position or id, which give `Sample` objects. Samples
    read their files only when the data is accessed.
    """

    def __init__(
        self,
        root: str | Path,
        split: str | None = None,
        *,
        bodies: Mapping[str, BodyModel] | None = None,
        rest_turned: bool = True,
    ) -> None:
        """Find the samples of a dataset.

        Args:
            root: contains samples (`{id}/info.mat`) or folders of samples (`train/{id}/info.mat`).
            split: the folder under `root` to read; all folders if None.
            bodies: gender -> body model used to rebuild the bodies from poses and shape, for
                example SMPL for the original download, which stores no bodies.
            rest_turned: whether the rest meshes of samples without a `meta.json` are rotated by
                `zrot`: True for the full CLOTH3D release, False for the samples of its starter kit.

        Raises:
            InputError: the folder does not exist or contains no sample.
        """
        self.root = Path(root)
        self._bodies = dict(bodies or {})
        self._rest_turned = rest_turned
        if not self.root.is_dir():
            raise InputError(f"{self.root}: no such folder, expected a CLOTH3D dataset")
        self._folders = _sample_folders(self.root, split)
        if not self._folders:
            place = self.root if split is None else self.root / split
            raise InputError(f"{place}: no folder with an info.mat, expected CLOTH3D samples")
        self.ids = sorted(self._folders)

    def __len__(self) -> int:
        return len(self.ids)

    def __contains__(self, sample: str) -> bool:
        return sample in self._folders

    def __getitem__(self, key: int | str) -> "Sample":
        sample = key if isinstance(key, str) else self.ids[key]
        if sample not in self._folders:
            raise KeyError(f"{self.root}: no sample {sample}")
        return Sample(self._folders[sample], bodies=self._bodies, rest_turned=self._rest_turned)

    def __iter__(self) -> Iterator["Sample"]:
        return (self[sample] for sample in self.ids)

    def verify(self) -> None:
        """Read all files and compare their sums with the manifests, where there are any.

        Raises:
            DamagedFile: the first file that is missing or not as it was written.
        """
        if (self.root / MANIFEST).is_file():
            for damage in damages(self.root, sums=True):
                raise damage
        else:
            for sample in self:
                sample.verify()


def _sample_folders(root: Path, split: str | None) -> dict[str, Path]:
    """Map ids to folders, for samples directly under `root` and one level below."""
    places = [root / split] if split is not None else [root, *_folders_in(root)]
    found: dict[str, Path] = {}
    for place in places:
        for folder in _folders_in(place):
            if (folder / "info.mat").is_file():
                if folder.name in found:
                    raise InputError(
                        f"{folder}: sample {folder.name} is also in {found[folder.name].parent},"
                        " expected each id once (pass a split to read only one of them)"
                    )
                found[folder.name] = folder
    return found


def _folders_in(place: Path) -> list[Path]:
    if not place.is_dir():
        return []
    with os.scandir(place) as entries:
        # Hidden ones are what a job is writing, or wrote when it was killed.
        return sorted(
            Path(entry.path)
            for entry in entries
            if entry.is_dir() and not entry.name.startswith(".")
        )


class Sample:
    """One sample: an outfit in rest pose and its simulated frames on a moving body.

    Only the requested frames are read, from files that stay open. Samples may lack tightness and
    fabrics (the test sets of the original), bodies or a `meta.json`.
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        bodies: Mapping[str, BodyModel] | None = None,
        rest_turned: bool = True,
    ) -> None:
        """Refer to the sample in `folder`; see `Cloth3D` for the other arguments."""
        self.folder = Path(folder)
        self.id = self.folder.name
        self._bodies = dict(bodies or {})
        self._rest_turned = rest_turned
        self._caches: dict[str, PointCache] = {}
        self._sizes_checked = False

    @cached_property
    def info(self) -> SampleInfo:
        """Contents of `info.mat`."""
        self._refuse_damage(sums=False)
        return read_info(self.folder / "info.mat")

    @cached_property
    def _placement(self) -> Placement:
        """The part of `info.mat` that vertices need; the rest is not read."""
        if "info" in vars(self):
            return Placement(tuple(self.info.outfit), self.info.trans, self.info.zrot)
        self._refuse_damage(sums=False)
        return read_placement(f"{self.folder}/info.mat")

    @cached_property
    def meta(self) -> dict[str, Any] | None:
        """Contents of `extras/meta.json`, or None if there is none, as in the original."""
        path = meta_path(self.folder)
        return read_json(path, META) if path.is_file() else None

    @cached_property
    def garments(self) -> tuple[str, ...]:
        """Names of the garments, innermost first (for the original: in the stored order)."""
        return self._placement.garments or tuple(
            sorted(path.stem for path in self.folder.glob("*.obj"))
        )

    @property
    def frame_count(self) -> int:
        """Number of frames."""
        return len(self._placement.trans)

    def __len__(self) -> int:
        return self.frame_count

    @property
    def fps(self) -> int:
        """Frames per second."""
        return FPS

    @property
    def gender(self) -> str:
        """`"female"` or `"male"`."""
        return self.info.gender

    @property
    def split(self) -> str:
        """Name of the folder that contains the sample."""
        return self.folder.parent.name

    @property
    def fabrics(self) -> dict[str, str | None]:
        """Garment name -> fabric, or None if it is not stored.

        `info.mat` has one of CLOTH3D's four words for each; `extras/meta.json` its own name.
        """
        worn = (self.meta or {}).get("outfit", {}).get("garments", [])
        told = {garment["name"]: garment.get("fabric") for garment in worn}
        return {
            name: told.get(name) or self.info.outfit.get(name, {}).get("fabric")
            for name in self.garments
        }

    @property
    def tightness(self) -> np.ndarray | None:
        """(2,) tightness, or None if it is not stored."""
        return self.info.tightness

    @cached_property
    def health(self) -> dict[str, np.ndarray]:
        """Health measures of every frame by name; empty if none are stored."""
        self._refuse_damage(sums=False)
        path = self._extras / "health.npz"
        return load_npz(path, HEALTH) if path.is_file() else {}

    @property
    def has_body(self) -> bool:
        """Whether body vertices are available: stored, or rebuilt by a given body model."""
        return bool(self._bodies) or (self._extras / f"{BODY}.pc16").is_file()

    def mesh(self, garment: str) -> Mesh:
        """Rest mesh of a garment with faces and texture coordinates, root-relative, facing -Y.

        Raises:
            InputError: the OBJ is missing or damaged.
            KeyError: there is no such garment.
        """
        self._check_garment(garment)
        return self._rest_mesh(self.folder / f"{garment}.obj")

    def texture(self, garment: str) -> Path | None:
        """The picture of a garment's print, on its texture coordinates; None if it is plain.

        Raises:
            KeyError: there is no such garment.
        """
        self._check_garment(garment)
        path = self.folder / f"{garment}.png"
        return path if path.is_file() else None

    def body_mesh(self) -> Mesh:
        """Body in rest pose, in the same frame as the rest garments.

        Raises:
            InputError: there is neither an `extras/Body.obj` nor a body model for this gender.
        """
        stored = self._extras / f"{BODY}.obj"
        if stored.is_file():
            return self._rest_mesh(stored)
        from drapeline.frames import REST_POSE

        body = self.body_model
        rest, _ = posed_vertices(body, self.info.shape, REST_POSE[None].copy())
        return Mesh(rest[0], body.faces, body.vt, body.ft)

    def vertices(
        self, garment: str, start: int = 0, stop: int | None = None, frame: Frame = "world"
    ) -> np.ndarray:
        """Garment vertices of frames [start, stop), (stop - start, V, 3) float32 metres.

        The single-precision cache is used if there is one, otherwise the half-precision cache.

        Args:
            garment: one of `garments`.
            stop: frame after the last; the end of the sequence if None.
            frame: "world", or "root" for positions relative to the root joint before `zrot`.

        Raises:
            InputError: the file is missing, damaged, or has another number of frames.
            IndexError: the range is not within the sequence.
        """
        return self._place(self._read(garment, start, stop), start, frame)

    def body_vertices(
        self, start: int = 0, stop: int | None = None, frame: Frame = "world"
    ) -> np.ndarray:
        """Body vertices of frames [start, stop), (stop - start, V, 3) float32 metres.

        They are rebuilt from poses and shape if a body model was given, otherwise read from
        `extras/Body.pc16`. Of our own samples they are those that the cloth met: parts that
        overlapped are pressed apart.

        Raises:
            InputError: neither is available, or the sample was made with another body model.
            IndexError: the range is not within the sequence.
        """
        if not self._bodies:
            return self._place(self._read(BODY, start, stop), start, frame)
        from drapeline.bodies.sequence import press_apart

        chosen = self._range(start, stop)
        poses = self.info.poses[chosen]
        points, _ = posed_vertices(self.body_model, self.info.shape, poses)
        if fix := self.masks(BODY):
            press_apart(
                points,
                np.arange(chosen.start, chosen.stop),
                *(fix[f"fix_{name}"] for name in ("frame", "vertex", "delta")),
            )
        return self._place(points, start, frame)

    def joints(self, start: int = 0, stop: int | None = None, frame: Frame = "world") -> np.ndarray:
        """The body's 24 joints in frames [start, stop), (stop - start, 24, 3) float32 metres.

        They are computed from poses and shape by `body_model`.

        Raises:
            InputError: there is no body model for this sample.
            IndexError: the range is not within the sequence.
        """
        poses = self.info.poses[self._range(start, stop)]
        _, joints = posed_vertices(self.body_model, self.info.shape, poses)
        return self._place(joints, start, frame)

    def masks(self, name: str) -> dict[str, np.ndarray]:
        """What is said of the vertices of a garment, or of "Body"; nothing if nothing is stored.

        A garment has `elastic`, `held` and `band` (V,) float32, 0-1: how much of an elastic a
        vertex has, how firmly it was held, and how much of a stiff band it is. The body has
        `collides` (V,) bool, and where its parts were pressed apart: `fix_delta` (m, 3) metres,
        `fix_frame` and `fix_vertex` (m,).

        Raises:
            InputError: the file is damaged.
            KeyError: there is no such garment.
        """
        if name != BODY:
            self._check_garment(name)
        path = self._extras / f"{name}.npz"
        if not path.is_file():
            return {}
        if name == BODY:
            return dict(load_npz(path, BODY_MASKS, frames=self.frame_count))
        return dict(load_npz(path, GARMENT_MASKS, vertices=self._cache(name).vertex_count))

    def root_positions(self, start: int = 0, stop: int | None = None) -> np.ndarray:
        """World position of the root joint in frames [start, stop), (stop - start, 3) float64."""
        return self._placement.trans[start:stop] @ rotation_z(self._placement.zrot).T

    def verify(self) -> None:
        """Read all files and compare their sums with the sample's manifest, if it has one.

        Sizes of those that are there are compared whenever a sample is read.

        Raises:
            DamagedFile: the first file that is not as it was written.
        """
        self._refuse_damage(sums=True)

    def _refuse_damage(self, *, sums: bool) -> None:
        if sums or not self._sizes_checked:
            if os.path.isfile(f"{self.folder}/{SAMPLE_MANIFEST}"):
                for damage in damages(self.folder, SAMPLE_MANIFEST, sums=sums):
                    # A part of a sample may be all that its user keeps.
                    if sums or damage.path.exists():
                        raise damage
            self._sizes_checked = True

    def close(self) -> None:
        """Close the files; this also happens when the object is garbage-collected."""
        for cache in self._caches.values():
            cache.close()
        self._caches.clear()

    def __enter__(self) -> "Sample":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def _extras(self) -> Path:
        return self.folder / EXTRAS

    def _rest_mesh(self, path: Path) -> Mesh:
        self._refuse_damage(sums=False)
        mesh = load_obj(path)
        turned = (
            self._rest_turned
            if self.meta is None
            else self.meta["conventions"]["rest_obj_is_turned_by_zrot"]
        )
        zrot = self._placement.zrot
        if not turned or zrot == 0:
            return mesh
        vertices = mesh.vertices @ rotation_z(zrot).astype(np.float32)  # = Rz(-zrot) v
        return Mesh(vertices, mesh.faces, mesh.uv, mesh.uv_faces)

    def _check_garment(self, name: str) -> None:
        if name not in self.garments:
            raise KeyError(f"{self.folder}: no garment {name}, only {', '.join(self.garments)}")

    def _rest_count(self, name: str) -> int | None:
        """Vertices of a garment's OBJ where there is one and no manifest vouches for it."""
        path = Path(f"{self.folder}/{name}.obj")
        if name == BODY or not path.is_file():
            return None
        if os.path.isfile(f"{self.folder}/{SAMPLE_MANIFEST}"):
            return None
        with refuse_damage(path, "a Wavefront OBJ"):
            return (b"\n" + path.read_bytes()).count(b"\nv ")

    def _read(self, name: str, start: int, stop: int | None) -> np.ndarray:
        """Frames [start, stop) of a cache, all of them numbers."""
        cache = self._cache(name)
        points = cache.frames(start, stop)
        if not np.isfinite(points.sum()):  # in a tenth of the time of all
            raise DamagedFile(cache.path, "a position is not finite or is huge, expected metres")
        return points

    def _cache(self, name: str) -> PointCache:
        if name not in self._caches:
            if name != BODY:
                self._check_garment(name)
            # As text, since paths take longer to join than files to open.
            single = f"{self.folder}/{EXTRAS}/{name}.f32"
            half = f"{self.folder}/{EXTRAS if name == BODY else '.'}/{name}.pc16"
            if name == BODY and not os.path.isfile(half):
                raise InputError(
                    f"{half}: no such file, expected this file or a body model for gender"
                    f" {self.gender}"
                )
            cache = PointCache(half, self._rest_count(name))
            if os.path.isfile(single):
                # The header of the half-precision cache saves parsing the OBJ for its vertices.
                count = cache.vertex_count
                cache.close()
                cache = PointCache(single, count)
            if len(cache) != self.frame_count:
                raise InputError(
                    f"{cache.path}: {len(cache)} frames, expected {self.frame_count} as in info.mat"
                )
            self._caches[name] = cache
        return self._caches[name]

    def _range(self, start: int, stop: int | None) -> slice:
        """The frames [start, stop)."""
        stop = self.frame_count if stop is None else stop
        if not 0 <= start <= stop <= self.frame_count:
            raise IndexError(
                f"{self.folder}: frames [{start}, {stop}) requested, expected a range within"
                f" [0, {self.frame_count})"
            )
        return slice(start, stop)

    @cached_property
    def body_model(self) -> BodyModel:
        """The body model that was given for the sample's gender, or else the one that comes along.

        Raises:
            InputError: there is none, or the sample was made with another one.
        """
        if self.gender in self._bodies:
            body = self._bodies[self.gender]
        elif self._bodies or self.meta is None:
            raise InputError(
                f"{self.folder}: no body model for gender {self.gender},"
                f" only for {', '.join(self._bodies) or 'none'}"
            )
        else:
            body = load_body(free_body(self.gender))
        made_with = self.meta["body"] if self.meta is not None else None
        if made_with is not None and body_fingerprint(body) != made_with["fingerprint"]:
            raise InputError(
                f"{self.folder}: made with body '{made_with['model']}', but the body model"
                f" '{body.name}' has different arrays"
            )
        return body

    def _place(self, points: np.ndarray, start: int, frame: Frame) -> np.ndarray:
        """Take root-relative points (n, V, 3) of the frames from `start` on to the given frame."""
        if frame == "root":
            return points
        if frame != "world":
            raise ValueError(f"frame is '{frame}', expected 'world' or 'root'")
        _shift(points, self._placement.trans[start : start + len(points)].astype(np.float32))
        if self._placement.zrot:
            points = points @ rotation_z(self._placement.zrot).T.astype(np.float32)
        return points


def _shift(points: np.ndarray, trans: np.ndarray) -> None:
    """Add (n, 3) to points (n, V, 3) in place.

    In blocks of points, since NumPy takes as long for a row of three numbers as for a hundred.
    """
    whole = points.shape[1] - points.shape[1] % _BLOCK
    blocks = points[:, :whole].reshape(len(points), whole // _BLOCK, 3 * _BLOCK)
    blocks += np.concatenate([trans] * _BLOCK, axis=1)[:, None]
    points[:, whole:] += trans[:, None]


def rotation_z(angle: float) -> np.ndarray:
    """(3, 3) rotation about +Z by an angle in radians."""
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
