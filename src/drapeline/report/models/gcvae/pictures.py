"""Figure 11 of the CLOTH3D paper for our models: garments at rest from pictures of them worn."""

import colorsys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import Mesh
from drapeline.job import Job
from drapeline.metrics.predictions import BODY, TRUE, Fits, load_fitted_picture, load_fitted_scans
from drapeline.outfits.garment_types import layered
from drapeline.rendering.pictures import GridCell, save_grid
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.scene import (
    PICTURE_SIZE,
    Scene,
    fit_scene,
    label_colours,
    spread_frames,
    worn_parts,
)
from drapeline.rule_log import progress
from drapeline.storage import load_npz

PICTURES, GARMENTS_AT_REST = "pictures.npz", "garments.npz"
FITTED = "fitted"
# What is drawn beside a picture -> its title.
COLUMNS = {
    TRUE: "true, at rest",
    "network": "from the picture",
    "nearest": "nearest picture",
    FITTED: "SMPLicit's fit",
}
_TITLE = "segments\nand silhouettes"
_ARRAYS = {"name": "str n", "labels": "int n h w", "segments": f"int<{1 + len(JOINT_NAMES)} n h w"}
_GOLDEN = 0.618  # of hues, of which each is far from those before


class SegmentedPicture(NamedTuple):
    """A picture as the network is told of it, but for what lies beneath the cloth."""

    name: str
    labels: np.ndarray  # (H, W) uint8, see `metrics.predictions`
    segments: np.ndarray  # (H, W) uint8, 0 or 1 + the joint of the body's segment that is seen


def load_pictures(path: str | Path) -> list[SegmentedPicture]:
    """Read the pictures that an evaluation left.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    arrays = load_npz(path, _ARRAYS)
    return [
        SegmentedPicture(str(name), labels, segments)
        for name, labels, segments in zip(*(arrays[key] for key in _ARRAYS), strict=True)
    ]


def segment_colours() -> np.ndarray:
    """(1 + joints, 3) uint8 colours of the body's segments, paler than garments; 0 is white."""
    hues = [_GOLDEN * joint % 1 for joint in range(len(JOINT_NAMES))]
    pale = [colorsys.hsv_to_rgb(hue, 0.3, 0.95 - 0.2 * (k % 2)) for k, hue in enumerate(hues)]
    return np.round(255 * np.array([(1, 1, 1), *pale])).astype(np.uint8)


def plot_pictures(path: str | Path, rows: Sequence[tuple[SegmentedPicture, Fits]]) -> None:
    """Write a row for each picture: what is seen in it, then garments at rest on their wearer.

    What nobody has found leaves its place empty.
    """
    cells = [
        [GridCell(_seen(picture)), *(_at_rest(fits, variant) for variant in COLUMNS)]
        for picture, fits in progress(rows, total=len(rows), label="pictures")
    ]
    labels = [picture.name.replace("_", "\nframe ") for picture, _ in rows]
    save_grid(path, cells, columns=[_TITLE, *COLUMNS.values()], labels=labels)


def _seen(picture: SegmentedPicture) -> np.ndarray:
    skin = (picture.segments > 0)[..., None]
    image = np.where(skin, segment_colours()[picture.segments], label_colours(picture.labels))
    width, height = PICTURE_SIZE
    side = min(PICTURE_SIZE)
    sheet = Image.new("RGB", PICTURE_SIZE, (255, 255, 255))
    scaled = Image.fromarray(image).resize((side, side), Image.Resampling.LANCZOS)
    sheet.paste(scaled, ((width - side) // 2, (height - side) // 2))
    return np.asarray(sheet)


def _at_rest(fits: Fits, variant: str) -> GridCell | None:
    if not fits.get(variant):
        return None
    wearer = fits[BODY][BODY]
    scene = fit_scene(Scene(floor_z=float(wearer.vertices[:, 2].min())), [wearer.vertices])
    layers = {name: fits[variant][name] for name in layered(fits[variant])}
    return GridCell(scene.picture(worn_parts(wearer, layers)))


def plot_evaluated(job: Job) -> None:
    """Garments at rest from pictures of held-out samples, as figure 11 of the paper."""
    evaluated, fitted = Path(job.input.evaluated), Path(job.input.fitted)
    pictures = load_pictures(evaluated / PICTURES)
    found = load_fitted_scans(evaluated / GARMENTS_AT_REST)
    rows = []
    for index in spread_frames(len(pictures), job.params.most):
        picture = pictures[index]
        fits: dict[str, Mapping[str, Mesh]] = dict(found[picture.name])
        file = fitted / f"{picture.name}.npz"
        if file.is_file():
            fits[FITTED] = load_fitted_picture(file).people[0].rest
        rows.append((picture, fits))
    with ray_share(job.params.rays):
        plot_pictures(job.output[0], rows)
