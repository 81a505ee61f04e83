"""One frame of a garment from a sample that is opened for it, beside an `.npz` of all frames."""

import os
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from side_by_side import Comparison, compare, cpu_seconds

from drapeline.dataset.info_mat import SampleInfo, write_info
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import EXTRAS, SAMPLE_MANIFEST
from drapeline.geometry.point_cache import write_point_cache
from drapeline.manifest import write_manifest

FRAMES, VERTICES, FRAME = 300, 10_000, 123


def write_both(folder: Path) -> None:
    """A sample of one garment with all that its reader looks at, and `all.npz`."""
    rng = np.random.default_rng(0)
    frames = rng.normal(0, 0.3, (FRAMES, VERTICES, 3)).astype(np.float16)
    np.savez(folder / "all.npz", vertices=frames)
    sample = folder / "sample"
    (sample / EXTRAS).mkdir(parents=True)
    outfit = {"Dress": {"texture": {"type": "color", "data": [0.1, 0.2, 0.3]}, "fabric": "silk"}}
    poses, trans = rng.normal(0, 0.3, (FRAMES, 72)), rng.normal(0, 1, (FRAMES, 3))
    info = SampleInfo(poses, trans, np.zeros(10), 0, outfit=outfit, tightness=np.zeros(2))
    write_info(sample / "info.mat", info)
    write_point_cache(sample / "Dress.pc16", frames.astype(np.float32))
    write_point_cache(sample / EXTRAS / "Dress.f32", frames.astype(np.float32))
    write_manifest(sample, SAMPLE_MANIFEST)


def rows(results: Path) -> Iterator[Comparison]:
    """A frame of a sample opened anew, and of one that is open."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_both(folder)

        def anew() -> np.ndarray:
            with Sample(folder / "sample") as sample:
                return sample.vertices("Dress", FRAME, FRAME + 1)

        def packed() -> np.ndarray:
            with np.load(folder / "all.npz") as arrays:
                return arrays["vertices"][FRAME].astype(np.float32)

        def bare() -> None:
            """The system calls of `anew`."""
            for name in (SAMPLE_MANIFEST, "info.mat", "Dress.pc16", f"{EXTRAS}/Dress.f32"):
                file = os.open(folder / "sample" / name, os.O_RDONLY)
                os.stat(file)
                os.read(file, 1 << 12)
                os.close(file)

        with Sample(folder / "sample") as sample:
            shift = sample.info.trans[FRAME].astype(np.float32)
            np.testing.assert_array_equal(anew()[0], packed() + shift)
            size = f"a frame of {FRAMES} of {VERTICES:,} vertices"
            yield compare(
                f"{size}, the sample opened for it",
                "`.npz`",
                packed,
                anew,
                goal=50,
                note="four files are opened and the sizes of three checked; that takes the system"
                f" {1000 * cpu_seconds(bare, 1000):.3f} ms, the rest is Python",
            )
            yield compare(
                f"{size}, the sample open",
                "`.npz`",
                packed,
                lambda: sample.vertices("Dress", FRAME, FRAME + 1),
                goal=200,
            )
