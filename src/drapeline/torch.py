"""Data sets for PyTorch: frames of a dataset, or windows of frames, as tensors.

    from drapeline.dataset.reader import Cloth3D
    from drapeline.torch import FrameDataset, make_loader

    train = FrameDataset(Cloth3D("results/dataset", "train"))
    for batch in make_loader(train, 16, seed=0, workers=4):
        batch.vertices  # of all garments of all frames, one after another

Meshes have different numbers of vertices. A batch therefore holds them packed: their vertices in
one tensor, and faces that count on from one mesh to the next, as PyTorch3D and PyTorch Geometric
have it.
"""

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset, Sampler

from drapeline.dataset.reader import Cloth3D, Frame, Sample
from drapeline.dataset.windows import window_starts
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.seeding import rng_for


class OutfitFrames(NamedTuple):
    """One sample in one frame, or in a window of T frames.

    `(T, ...)` stands for the shape of a window; a single frame lacks that dimension. All numbers
    are float32 and in metres or radians unless another type is named.

    Attributes:
        sample: its id.
        frame: number of the frame, or of the first one of the window.
        garments: names of G garments, innermost first.
        vertices: G tensors (T, V, 3).
        faces: G tensors (F, 3) int64, triangles, counter-clockwise seen from outside.
        rest: G tensors (V, 3), the garments in the rest pose, relative to the root joint.
        body: (T, B, 3), or None if the data set leaves bodies out.
        poses: (T, 72) SMPL's axis-angle as in `info.mat`.
        trans: (T, 3) world position of the root joint.
        shape: (10,) shape coefficients of the body.
        gender: int64 scalar, 0 female, 1 male.
        tightness: (2,) of the garments, NaN where a sample has none.
    """

    sample: str
    frame: int
    garments: tuple[str, ...]
    vertices: tuple[torch.Tensor, ...]
    faces: tuple[torch.Tensor, ...]
    rest: tuple[torch.Tensor, ...]
    body: torch.Tensor | None
    poses: torch.Tensor
    trans: torch.Tensor
    shape: torch.Tensor
    gender: torch.Tensor
    tightness: torch.Tensor


class OutfitBatch(NamedTuple):
    """B items of a data set with all their M garments; V and F count those of all garments.

    Attributes:
        sample: B ids.
        frame: (B,) int64 numbers of the frames, or of the first ones of windows.
        garment: M names.
        vertices: (T, V, 3).
        faces: (F, 3) int64 into `vertices`.
        rest: (V, 3).
        vertex_count, face_count: (M,) int64 of each garment.
        item: (M,) int64 which of the B items wears each garment.
        mesh: (V,) int64 which of the M garments each vertex belongs to.
        body: (B, T, N, 3), or None.
        poses: (B, T, 72).
        trans: (B, T, 3).
        shape: (B, 10).
        gender: (B,) int64.
        tightness: (B, 2).
    """

    sample: list[str]
    frame: torch.Tensor
    garment: list[str]
    vertices: torch.Tensor
    faces: torch.Tensor
    rest: torch.Tensor
    vertex_count: torch.Tensor
    face_count: torch.Tensor
    item: torch.Tensor
    mesh: torch.Tensor
    body: torch.Tensor | None
    poses: torch.Tensor
    trans: torch.Tensor
    shape: torch.Tensor
    gender: torch.Tensor
    tightness: torch.Tensor

    def to(self, device: torch.device | str, *, non_blocking: bool = False) -> "OutfitBatch":
        """The batch with its tensors on a device."""
        moved: dict[str, Any] = {
            name: part.to(device, non_blocking=non_blocking)
            for name, part in self._asdict().items()
            if isinstance(part, torch.Tensor)
        }
        return self._replace(**moved)

    def unpack(self, values: torch.Tensor) -> list[torch.Tensor]:
        """Values (..., V, C) of all vertices, such as predicted positions -> M tensors."""
        return list(values.split(self.vertex_count.tolist(), dim=-2))


class SequenceDataset(Dataset):
    """Windows of T consecutive frames.

    Samples with fewer frames are left out. The last window of a sample is shifted back to end with
    it. A data set may be used by several workers, each of which opens files of its own, and by
    several threads, which take turns.

    Args:
        frames: T.
        stride: from one window to the next, at most T; T if None.
        garments: types to read; all if None. Samples that wear none of them are left out.
        body: whether to read bodies.
        coordinates: "root" for positions relative to the root joint, or "world".
        keep: samples that each worker keeps open, with their meshes.

    Raises:
        InputError: nothing is left, or windows would leave out frames.
    """

    def __init__(
        self,
        data: Cloth3D,
        frames: int,
        *,
        stride: int | None = None,
        garments: Sequence[str] | None = None,
        body: bool = True,
        coordinates: Frame = "root",
        keep: int = 64,
    ) -> None:
        for name, value in (("frames", frames), ("keep", keep)):
            if value < 1:
                raise InputError(f"{name} is {value}, expected at least 1")
        if isinstance(garments, str):
            raise InputError(f"garments is '{garments}', expected a list, such as ['{garments}']")
        self.data, self.frames, self.body, self.coordinates = data, frames, body, coordinates
        self._wanted = None if garments is None else frozenset(garments)
        self._kept = _OpenSamples(data, self._wanted, keep)
        self._items: list[tuple[str, int]] = []
        for sample in data:
            with sample:
                if len(sample) >= frames and _worn(sample, self._wanted):
                    starts = window_starts(len(sample), frames, stride or frames, sample.id)
                    self._items += [(sample.id, start) for start in starts]
        if not self._items:
            worn = "any garment" if garments is None else " or ".join(garments)
            raise InputError(
                f"{data.root}: no sample wears {worn} in {frames} or more frames, expected one"
            )

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: int) -> OutfitFrames:
        with self._kept.lock:
            return self._read(*self._items[index])

    def _read(self, name: str, start: int) -> OutfitFrames:
        part = slice(start, start + self.frames)
        sample, garments, faces, rest = self._kept[name]
        where = (part.start, part.stop, self.coordinates)
        info = sample.info
        return OutfitFrames(
            sample=name,
            frame=start,
            garments=garments,
            vertices=tuple(torch.from_numpy(sample.vertices(one, *where)) for one in garments),
            faces=faces,
            rest=rest,
            body=torch.from_numpy(sample.body_vertices(*where)) if self.body else None,
            poses=_float(info.poses[part]),
            trans=_float(sample.root_positions(part.start, part.stop)),
            shape=_float(info.shape),
            gender=torch.tensor(GENDERS.index(info.gender)),
            tightness=_float(np.full(2, np.nan) if info.tightness is None else info.tightness),
        )


class FrameDataset(SequenceDataset):
    """Single frames.

    Args:
        step: every so many frames of a sample are read.
        garments, body, coordinates, keep: see `SequenceDataset`.

    Raises:
        InputError: nothing is left.
    """

    def __init__(
        self,
        data: Cloth3D,
        *,
        step: int = 1,
        garments: Sequence[str] | None = None,
        body: bool = True,
        coordinates: Frame = "root",
        keep: int = 64,
    ) -> None:
        if step < 1:
            raise InputError(f"step is {step}, expected at least 1")
        super().__init__(data, 1, garments=garments, body=body, coordinates=coordinates, keep=keep)
        self._items = [(name, frame) for name, frame in self._items if frame % step == 0]

    def __getitem__(self, index: int) -> OutfitFrames:
        window = super().__getitem__(index)
        return window._replace(
            vertices=tuple(x[0] for x in window.vertices),
            body=None if window.body is None else window.body[0],
            poses=window.poses[0],
            trans=window.trans[0],
        )


def collate(items: Sequence[OutfitFrames]) -> OutfitBatch:
    """Pack items into a batch; the `collate_fn` of a `DataLoader`."""
    vertices, faces, rest = (
        [x for item in items for x in getattr(item, key)] for key in ("vertices", "faces", "rest")
    )
    vertex_count = torch.tensor([len(x) for x in rest])
    first = vertex_count.cumsum(0) - vertex_count
    bodies = [item.body for item in items if item.body is not None]
    if 0 < len(bodies) < len(items):
        raise InputError(
            f"a batch has bodies in {len(bodies)} of {len(items)} items, expected all or none"
        )
    return OutfitBatch(
        sample=[item.sample for item in items],
        frame=torch.tensor([item.frame for item in items]),
        garment=[name for item in items for name in item.garments],
        vertices=torch.cat(vertices, dim=-2),
        faces=torch.cat([x + start for x, start in zip(faces, first, strict=True)]),
        rest=torch.cat(rest),
        vertex_count=vertex_count,
        face_count=torch.tensor([len(x) for x in faces]),
        item=torch.repeat_interleave(torch.tensor([len(item.garments) for item in items])),
        mesh=torch.repeat_interleave(vertex_count),
        body=torch.stack(bodies) if bodies else None,
        **{
            key: torch.stack([getattr(item, key) for item in items])
            for key in ("poses", "trans", "shape", "gender", "tightness")
        },
    )


class SeededOrder(Sampler):
    """Every pass over the data set in another order, which depends on seed and epoch alone.

    Attributes:
        epoch: of the next pass; set it to go on with a training that was stopped.
    """

    def __init__(self, count: int, seed: int) -> None:
        self.count, self.seed, self.epoch = count, seed, 0

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[int]:
        order = rng_for(self.seed, "epoch", self.epoch).permutation(self.count)
        self.epoch += 1
        return iter(order.tolist())


def make_loader(
    data: SequenceDataset, batch: int, *, seed: int | None = None, workers: int = 0, **options: Any
) -> DataLoader:
    """Batches of a data set; the same ones for any number of workers.

    Args:
        data: frames or windows.
        batch: items per batch; the last one of a pass may have fewer.
        seed: of the order, see `SeededOrder`; None keeps the order of the data set.
        workers: processes that read ahead; 0 reads in this one.
        options: further arguments of `DataLoader`, such as `pin_memory` or `drop_last`.
    """
    return DataLoader(
        data,
        batch,
        sampler=None if seed is None else SeededOrder(len(data), seed),
        num_workers=workers,
        collate_fn=collate,
        persistent_workers=workers > 0,
        **options,
    )


class _Opened(NamedTuple):
    """A sample with its garments, and what all of its frames share."""

    sample: Sample
    garments: tuple[str, ...]
    faces: tuple[torch.Tensor, ...]
    rest: tuple[torch.Tensor, ...]


class _OpenSamples:
    """The samples that were used last, open; to parse a mesh takes longer than to read a frame."""

    def __init__(self, data: Cloth3D, wanted: frozenset[str] | None, keep: int) -> None:
        self._data, self._wanted, self._keep = data, wanted, keep
        self._open: OrderedDict[str, _Opened] = OrderedDict()
        self.lock = Lock()  # held while a sample is read, which another thread may close else

    def __reduce__(self) -> tuple:
        return _OpenSamples, (self._data, self._wanted, self._keep)  # a worker opens its own

    def __getitem__(self, name: str) -> _Opened:
        if name not in self._open:
            sample = self._data[name]
            garments = _worn(sample, self._wanted)
            meshes = [sample.mesh(garment) for garment in garments]
            faces = tuple(torch.from_numpy(mesh.triangles.astype(np.int64)) for mesh in meshes)
            self._open[name] = _Opened(
                sample, garments, faces, tuple(_float(mesh.vertices) for mesh in meshes)
            )
        self._open.move_to_end(name)
        if len(self._open) > self._keep:
            self._open.popitem(last=False)[1].sample.close()
        return self._open[name]


def _worn(sample: Sample, wanted: frozenset[str] | None) -> tuple[str, ...]:
    return tuple(name for name in sample.garments if wanted is None or name in wanted)


def _float(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float32))
