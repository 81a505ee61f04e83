"""A sample in the layout that the earlier stages leave behind, made up in milliseconds."""

from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.sequence import BodySequence, ClipLabels, save_body_sequence
from drapeline.dataset.writer import write_sample
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.point_cache import write_point_cache
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.seeding import rng_for
from drapeline.storage import save_npz

GARMENTS = ("Tshirt", "Skirt")
TIGHTNESS = (-1.0, 0.25)  # as drawn, without the sign that the gender gives it


class TinySample(NamedTuple):
    """The written sample and the truth it was made from.

    Attributes:
        folder: the sample's folder.
        stages: folder with the files of the earlier stages.
        vertices: garment name -> (N, V, 3) float32 root-relative.
        meshes: garment name -> rest mesh.
        poses, trans, shape: what moves the body.
        status: what became of its simulation.
    """

    folder: Path
    stages: Path
    vertices: dict[str, np.ndarray]
    meshes: dict[str, Mesh]
    poses: np.ndarray
    trans: np.ndarray
    shape: np.ndarray
    status: dict[str, Any]


def tube(radius_m: float, bottom_m: float, top_m: float, around: int = 12, rows: int = 5) -> Mesh:
    """An open tube of quads about the Z axis, with a UV seam."""
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    heights = np.linspace(bottom_m, top_m, rows)
    ring = np.stack([radius_m * np.cos(angle), 0.6 * radius_m * np.sin(angle)], -1)
    vertices = np.concatenate([np.column_stack([ring, np.full(around, z)]) for z in heights])
    u, v = np.meshgrid(np.linspace(0, 1, around + 1), np.linspace(0, 1, rows))
    uv = np.stack([u.ravel(), v.ravel()], -1)
    row, column = np.mgrid[: rows - 1, :around].reshape(2, -1)
    # The tube's last column of faces closes on the first vertices, but not on the first UVs.
    faces, uv_faces = (
        np.stack(
            [
                row * width + column,
                row * width + (column + 1) % width,
                (row + 1) * width + (column + 1) % width,
                (row + 1) * width + column,
            ],
            axis=-1,
        )
        for width in (around, around + 1)
    )
    return Mesh(
        vertices.astype(np.float32),
        faces.astype(np.int32),
        uv.astype(np.float32),
        uv_faces.astype(np.int32),
    )


def write_stages(
    stages: Path,
    sample: str,
    *,
    frames: int = 6,
    seed: int = 0,
    status: str = "accepted",
    source: str = "walk.txt",
    gender: str = "female",
    prints: dict[str, dict[str, Any]] | None = None,
) -> TinySample:
    """Write bodies/, outfits/ and simulation/ of one sample under `stages`.

    `prints`: garment name -> what `prints.draw_print` takes; others are plain.
    """
    rng = rng_for(seed, "tiny sample", sample)
    poses = np.tile(REST_POSE, (frames, 1)) + rng.normal(0, 0.05, (frames, 72))
    start = np.array([0.3, -0.2, 0.9])
    trans = start + np.cumsum(rng.normal(0, 0.01, (frames, 3)), axis=0)
    shape = rng.uniform(-1, 1, 10)
    meshes = {"Tshirt": tube(0.25, 0.0, 0.5), "Skirt": tube(0.3, -0.4, 0.05, around=16)}
    vertices = {
        name: (mesh.vertices + rng.normal(0, 0.01, (frames, *mesh.vertices.shape))).astype("f4")
        for name, mesh in meshes.items()
    }
    unmeasured = {f.name: f.type() for f in fields(BodySequence) if f.type in (int, float, str)}
    save_body_sequence(
        stages / "bodies" / f"{sample}.npz",
        BodySequence(
            **{
                **unmeasured,
                "shape": shape,
                "gender": gender,
                "poses": poses,
                "trans": trans,
                "outcome": "removed",
                "removed_segments": np.array([22, 23], dtype=np.int32),
                "fix_frame": np.zeros(0, dtype=np.int32),
                "fix_vertex": np.zeros(0, dtype=np.int32),
                "fix_delta": np.zeros((0, 3), dtype=np.float32),
                "deepest_m": 0.01,
                "labels": ClipLabels(f"{Path(source).stem}_s0", "walk", "01", source),
            }
        ),
    )
    garments = tuple(
        Garment(
            name,
            mesh.vertices,
            mesh.faces,
            mesh.uv,
            mesh.uv_faces,
            pin=np.zeros(len(mesh.vertices), dtype=np.float32),
            elastic=np.zeros(len(mesh.vertices), dtype=np.float32),
            band=np.zeros(len(mesh.vertices), dtype=np.float32),
            attributes={
                "fabric": fabric,
                "elastic": {},
                "texture": {
                    "type": "pattern" if name in (prints or {}) else "color",
                    "data": [0.1, 0.5, 0.9],
                    **({"print": prints[name]} if name in (prints or {}) else {}),
                },
                "parameters": {"length": 0.5},
            },
        )
        for (name, mesh), fabric in zip(meshes.items(), ("jersey", "denim"), strict=True)
    )
    tightness = np.array(TIGHTNESS)
    outfit = Outfit(garments, shape, tightness, tightness, gender)
    outfit.save(stages / "outfits" / f"{sample}.npz", stages / "outfits" / f"{sample}.json")
    simulation = stages / "simulation" / sample
    for name, values in vertices.items():
        write_point_cache(simulation / f"{name}.f32", values)
    save_npz(simulation / "health.npz", inside_share=np.linspace(0, 0.01, frames))
    told = {
        "status": status,
        "reason": "" if status == "accepted" else "1.20 % of the vertices inside the body",
        "solver": {"name": "blender"},
        "attempts": [
            {
                **{"steps": 14, "gap_m": 0.004, "collider_share": 1.0, "floor": False},
                **{"shape_frames": 2, "pose_frames": 2, "settle_frames": 0},
            }
        ],
        "frames_per_second": 2.0,
        "versions": {"bpy": "4.5.15"},
    }
    folder = stages / "samples" / sample
    return TinySample(folder, stages, vertices, meshes, poses, trans, shape, told)


def write_tiny_sample(
    stages: Path, body: BodyModel, sample: str = "00001", split: str = "train", **stage_values
) -> TinySample:
    """All stages of one sample, the written sample included."""
    tiny = write_stages(stages, sample, **stage_values)
    write_sample(
        rng_for(stage_values.get("seed", 0), "scene", sample),
        tiny.folder,
        body=body,
        body_record=stages / "bodies" / f"{sample}.npz",
        outfit=stages / "outfits" / f"{sample}.npz",
        simulation=stages / "simulation" / sample,
        status=tiny.status,
        seed=stage_values.get("seed", 0),
        split=split,
    )
    return tiny


def body_truth(body: BodyModel, tiny: TinySample) -> np.ndarray:
    """(N, V, 3) body vertices in the world frame."""
    return posed_vertices(body, tiny.shape, tiny.poses, tiny.trans)[0]
