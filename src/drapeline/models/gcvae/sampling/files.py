"""Files of sampled garments."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import load_obj, save_obj
from drapeline.metrics.garment import shape_measures
from drapeline.models.gcvae.body_template import wearer_mesh
from drapeline.models.gcvae.sampling.draw import PRIOR, SampledGarment
from drapeline.storage import atomic_folder, load_npz, save_npz


def sample_table(
    sampled: Sequence[SampledGarment], body_faces: np.ndarray
) -> list[dict[str, str | float]]:
    """A row per sample: what was asked for, what came of it, and measures before and after."""
    rows = []
    for sample in sampled:
        before = shape_measures(sample.decoded, sample.body, body_faces)
        after = shape_measures(sample.mesh, sample.body, body_faces)
        rows.append(
            {
                "name": sample.name,
                "asked": sample.request.garment,
                "garment": sample.garment,
                "gender": sample.request.gender,
                "draws": sample.draws,
                "vertices": len(sample.mesh.vertices),
                "pieces_before": int(before["pieces"]),
                "pieces": int(after["pieces"]),
                "kept_share": sample.kept_share,
                "inside_1cm_share_before": before["inside_1cm_share"],
                "inside_1cm_share": after["inside_1cm_share"],
                "inside_share": after["inside_share"],
                "inside_depth_mm": after["inside_depth_mm"],
                "tightness_0": float(sample.request.tightness[0]),
                "tightness_1": float(sample.request.tightness[1]),
            }
        )
    return rows


def save_samples(
    folder: str | Path,
    sampled: Sequence[SampledGarment],
    bodies: Mapping[str, BodyModel],
    body_faces: np.ndarray,
) -> list[dict[str, str | float]]:
    """Write `{name}.obj` and `{name}.glb` (with its wearer) per sample, `samples.tsv`, `codes.npz`.

    A code that decodes to nothing has no OBJ file, and its glTF file holds only the wearer.

    Args:
        folder: to write.
        bodies: gender -> the whole body.
        body_faces: (F, 3) of the body that garments were decoded on.

    Returns:
        The rows of `samples.tsv`.
    """
    rows = sample_table(sampled, body_faces)
    with atomic_folder(folder) as scratch:
        for sample in sampled:
            parts = [_still_part("Body", wearer_mesh(bodies, sample.request.cvar), BODY_COLOUR)]
            if len(sample.mesh.faces):
                save_obj(scratch / f"{sample.name}.obj", sample.mesh)
                parts.append(_still_part(sample.garment, sample.mesh, PLAIN_COLOUR))
            write_glb(scratch / f"{sample.name}.glb", parts)
        save_npz(
            scratch / "codes.npz",
            name=np.array([s.name for s in sampled]),
            garment=np.array([s.garment for s in sampled]),
            asked=np.array([s.request.garment != PRIOR for s in sampled]),
            z=np.stack([s.z for s in sampled]).astype(np.float32),
            cvar=np.stack([s.request.cvar for s in sampled]),
        )
        with open(scratch / "samples.tsv", "w", newline="") as stream:
            writer = csv.DictWriter(stream, rows[0], delimiter="\t", lineterminator="\n")
            writer.writeheader()
            for row in rows:
                writer.writerow(
                    {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()}
                )
    return rows


class SavedSample(NamedTuple):
    """A sample as read from its files.

    Attributes:
        name: of the sample.
        garment: its type.
        asked: whether that type was asked for; if not, the code came from the prior.
        mesh: the garment; without faces if nothing was decoded.
        cvar: (13,) conditions.
    """

    name: str
    garment: str
    asked: bool
    mesh: Mesh
    cvar: np.ndarray


_ARRAYS = {"name": "str n", "cvar": "float n *", "garment": "str n", "asked": "bool n"}


def load_samples(folder: str | Path) -> list[SavedSample]:
    """Read what `save_samples` wrote.

    Raises:
        InputError: a file is missing or damaged.
    """
    folder = Path(folder)
    about = load_npz(folder / "codes.npz", _ARRAYS)
    nothing = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    samples = []
    for name, garment, asked, cvar in zip(
        *(about[key] for key in ("name", "garment", "asked", "cvar")), strict=True
    ):
        path = folder / f"{name}.obj"
        mesh = load_obj(path) if path.is_file() else nothing
        samples.append(SavedSample(str(name), str(garment), bool(asked), mesh, cvar))
    return samples


def _still_part(name: str, mesh: Mesh, colour: tuple[float, float, float]) -> ScenePart:
    return ScenePart(name, mesh, colour, lambda start, stop: mesh.vertices[None], 1)
