"""Held-out garments, scans and pictures of toys, as the files that the protocol is written from."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drapeline.bodies.model import BodyModel
from drapeline.bodies.settings import BodyFit
from drapeline.dataset.scan_bodies import scan_samples
from drapeline.dataset.settings import ScanSettings
from toys.bodies import save_toy_bodies
from toys.outfits_at_rest import save_static
from toys.pictured import save_registered
from toys.smplicit import toy_bodies, toy_outfits
from toys.tiny_sample import write_tiny_sample

SAMPLES = ("00001", "00002", "00003")  # of as many clips, so that there are intervals
EXACT = {"noise_m": 0, "pose_rad": 0, "place_m": 0, "joints_m": 0, "shape": 0}
TOLD = {
    "split": "test",
    "garments": ["Skirt"],
    "seed": 3,
    "samples": ["00001"],
    "pictures": 2,
    "others": ["00002"],
    "size_px": 48,
    "picture_seed": 4,
}


def save_cases(
    folder: Path, body: BodyModel, window: int, scanned: Sequence[str] = SAMPLES
) -> dict[str, Any]:
    """Files by name, of which scans are of so many frames."""
    (folder / "stages").mkdir(parents=True)
    samples = [
        write_tiny_sample(folder / "stages", body, name, "test", source=f"{name}.txt").folder
        for name in SAMPLES
    ]
    save_registered(folder / "data", body)
    save_static(folder / "outfits", toy_outfits())
    kinds = {
        "clean": ScanSettings(points=400, window=window, frames=2, **EXACT),
        "worse": ScanSettings(
            points=400, window=window, visibility="single", missing=0.3, noise_m=0.01, shape=0.5
        ),
    }
    fit = BodyFit(steps=1, joint_steps=1, points=100)
    samples = [path for path in samples if path.name in scanned]
    for kind, settings in kinds.items():
        scan_samples(
            folder / f"{kind}.npz", samples, toy_bodies(body), settings=settings, fit=fit, seed=1
        )
    return {
        **save_toy_bodies(folder / "bodies"),
        "data": folder / "data",
        "outfits": [folder / "outfits"],
        "samples": [folder / "stages" / "samples"],
        **{f"{kind}_scans": [folder / f"{kind}.npz"] for kind in kinds},
    }
