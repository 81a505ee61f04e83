"""A decoded garment through the motion of a sample's body."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.sequence import BodySequence, body_sequence_vertices
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.predictions import WornGarment
from drapeline.models.smplicit.repose import repose


def worn_clip(
    garment: Mesh,
    garment_type: str,
    body: BodyModel,
    record: BodySequence,
    frames: np.ndarray,
    *,
    skinning: str,
    push_out: bool,
) -> list[WornGarment]:
    """A garment on its moving wearer, in the world.

    Args:
        garment: triangles at rest on this wearer, root-relative metres.
        garment_type: one of `GARMENTS`.
        body: of the wearer.
        record: the wearer in motion.
        frames: (F,) which of its frames.
        skinning, push_out: see `repose`.
    """
    poses = record.poses[frames]
    moved = repose(garment, body, record.shape, poses, skinning=skinning, push_out=push_out)
    sheets = [Mesh(cloth, garment.faces) for cloth in moved]
    return place_clip(sheets, garment_type, body, record, frames)


def place_clip(
    sheets: Sequence[Mesh],
    garment_type: str,
    body: BodyModel,
    record: BodySequence,
    frames: np.ndarray,
) -> list[WornGarment]:
    """Posed sheets and their wearer, in the world.

    Args:
        sheets: one for each of the frames, root-relative metres.
        garment_type, body, record, frames: see `worn_clip`.
    """
    clip = []
    for sheet, frame in zip(sheets, frames, strict=True):
        place = record.trans[frame].astype(np.float32)
        (wearer,) = body_sequence_vertices(body, record, world=True, frames=slice(frame, frame + 1))
        clip.append(
            WornGarment(
                garment_type,
                Mesh(sheet.vertices + place, sheet.faces),
                Mesh(wearer, body.faces),
                record.poses[frame, :3],
            )
        )
    return clip


def save_clip(path: str | Path, frames: Sequence[WornGarment]) -> None:
    """Write consecutive frames of one garment on its wearer as an animated glTF file."""
    write_glb(
        path,
        [
            _part("Body", [worn.wearer for worn in frames], BODY_COLOUR),
            _part(frames[0].garment_type, [worn.garment for worn in frames], PLAIN_COLOUR),
        ],
    )


def _part(name: str, meshes: Sequence[Mesh], colour: tuple[float, float, float]) -> ScenePart:
    places = np.stack([mesh.vertices for mesh in meshes])
    return ScenePart(name, meshes[0], colour, lambda start, stop: places[start:stop], len(places))
