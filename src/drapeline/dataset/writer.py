"""Write samples as CLOTH3D folders, with extra files in a subfolder."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from drapeline import __version__
from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.sequence import (
    BodySequence,
    body_sequence_vertices,
    collides,
    load_body_sequence,
)
from drapeline.dataset.info_mat import SampleInfo, sample_scene, write_info
from drapeline.dataset.record import EXTRAS, HEALTH, SAMPLE_MANIFEST, body_fingerprint, meta_path
from drapeline.dataset.worst_frame import find_worst_frame, write_worst_frame
from drapeline.errors import InputError
from drapeline.frames import FPS, JOINT_NAMES, REST_POSE
from drapeline.geometry.mesh import Mesh, edges
from drapeline.geometry.obj import save_obj
from drapeline.geometry.point_cache import PointCache, point_cache_writer
from drapeline.manifest import write_manifest
from drapeline.outfits.fabrics import cloth3d_name
from drapeline.outfits.finish import draw_cloth
from drapeline.outfits.garment_types import BODY
from drapeline.outfits.outfit import OUTFIT_JSON, Garment, load_outfit
from drapeline.storage import atomic_folder, link_or_copy, load_npz, read_json, save_npz, write_json

META_VERSION = 1
CONVENTIONS = {
    "length": "metre",
    "angle": "radian",
    "up": "+Z",
    "rest_body_faces": "-Y",
    "frames_per_second": FPS,
    "vertices": "relative to the root joint; world = Rz(zrot) (vertex + trans[frame])",
    "trans": "world position of the root joint",
    "rest_pose": "zero but root x +pi/2, joint 1 z +0.15, joint 2 z -0.15",
    "rest_obj_is_turned_by_zrot": False,
    "gender": "0 female, 1 male",
    "quad_to_triangles": "(0, 1, 2), (0, 2, 3)",
}
_CHUNK = 32  # frames held in memory at once
_PACKAGES = ("numpy", "scipy", "torch")


def write_sample(
    rng: np.random.Generator,
    folder: str | Path,
    *,
    body: BodyModel,
    body_record: str | Path,
    outfit: str | Path,
    simulation: str | Path,
    status: Mapping[str, Any],
    seed: int,
    split: str,
) -> dict[str, Any]:
    """Write `info.mat`, the OBJ and PC16 files and the `extras/` of a simulated sample.

    `extras/manifest.tsv` has the sums of all its files.

    A sample that was not accepted gets only a `meta.json` with its status and reason, and the worst
    frame that was simulated. Memory use does not grow with the number of frames.

    Args:
        rng: draws the camera and the lights.
        folder: replaced as a whole; its name is the sample's id.
        body_record: `.npz` with shape, gender, poses, trans and the labels of the motion.
        outfit: `.npz` with the rest meshes, next to a `.json` of the same stem.
        simulation: folder with `{Garment}.f32` and `health.npz`, where anything was simulated.
        status: what became of the simulation: "accepted" or another word (`status`), why (`reason`)
            and whatever else is to be recorded.
        seed: the experiment's seed, to be recorded in `meta.json`.
        split: "train", "val" or "test".

    Returns:
        The contents of `meta.json`.

    Raises:
        InputError: the inputs do not match, or simulated vertices are not finite.
    """
    folder, simulation = Path(folder), Path(simulation)
    record = load_body_sequence(body_record)
    description = read_json(Path(outfit).with_suffix(".json"), OUTFIT_JSON)
    meta = {
        "format": {"name": "drapeline sample", "version": META_VERSION},
        "id": folder.name,
        "status": status["status"],
        "reason": status.get("reason", ""),
        "split": split,
        "seed": seed,
        "conventions": CONVENTIONS,
        "body": {
            "model": body.name,
            "fingerprint": body_fingerprint(body),
            "gender": record.gender,
            "vertices": len(body.v_template),
        },
        "motion": _motion(record),
        "self_collision": _self_collision(record),
        "outfit": description,
        "simulation": dict(status),
        "versions": {"drapeline": __version__, **_package_versions()},
    }
    with atomic_folder(folder) as scratch:
        (scratch / EXTRAS).mkdir()
        if status["status"] == "accepted":
            garments = load_outfit(outfit, Path(outfit).with_suffix(".json")).garments
            write_info(scratch / "info.mat", _info(record, description, rng))
            meta["garments"] = {
                garment.name: _write_garment(scratch, garment, simulation, len(record.poses))
                for garment in garments
            }
            _write_masks(scratch, body, record, garments)
            # The body that the cloth met: its parts pressed apart.
            _write_body(
                scratch,
                body,
                record.shape,
                (
                    body_sequence_vertices(body, record, frames=part)
                    for part in _parts(record.poses)
                ),
            )
            health = load_npz(simulation / "health.npz", HEALTH, frames=len(record.poses))
            save_npz(scratch / EXTRAS / "health.npz", **health)
            meta["health"] = summarise_health(health)
        elif (simulation / "health.npz").is_file():
            _write_worst(scratch, body, record, outfit, simulation, meta["reason"])
        write_json(meta_path(scratch), meta)
        write_manifest(scratch, SAMPLE_MANIFEST)
    return meta


def _write_worst(
    folder: Path,
    body: BodyModel,
    record: BodySequence,
    outfit: str | Path,
    simulation: Path,
    reason: str,
) -> None:
    health = load_npz(simulation / "health.npz", {"*": "any|nan frames ..."})
    if not len(next(iter(health.values()), ())):
        return
    frame = find_worst_frame(health, reason)
    (skin,) = body_sequence_vertices(body, record, frames=slice(frame, frame + 1))
    garments = load_outfit(outfit, Path(outfit).with_suffix(".json")).garments
    pose = record.poses[frame]
    _, (rest_joints, joints) = posed_vertices(body, record.shape, np.stack([REST_POSE, pose]))
    write_worst_frame(
        folder, simulation, frame, reason, pose[:3], skin, joints, rest_joints, body.faces, garments
    )


def summarise_health(health: Mapping[str, np.ndarray]) -> dict[str, dict[str, float]]:
    """Mean, minimum and maximum of the finite values of each measure, (N,) or (N, garments)."""
    summary = {}
    for name, values in health.items():
        if values.ndim in (1, 2) and values.dtype.kind in "biuf":
            values = values.astype(np.float64)
            values = values[np.isfinite(values)]
            if values.size:
                summary[name] = {
                    "mean": float((values / values.size).sum()),  # a sum may be too large
                    "min": float(values.min()),
                    "max": float(values.max()),
                }
    return summary


def _package_versions() -> dict[str, str]:
    """Of the packages that are installed; a sample can be made without torch."""
    found = {}
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def _motion(record: BodySequence) -> dict[str, Any]:
    labels = record.labels
    return {
        "sequence": labels.sequence,
        "source": labels.source,
        "subject": labels.subject,
        "action": labels.action,
        "start_frame": labels.start_frame,
        "speed": labels.speed,
        "mirrored": labels.mirrored,
        "frames": len(record.poses),
        "floor_penetration_m": record.penetration_m,
        "contact_sliding_m_s": record.sliding_m_s,
        "longest_hover_s": record.hover_s,
        "possible_flight_s": record.flight_s,
    }


def _self_collision(record: BodySequence) -> dict[str, Any]:
    return {
        "outcome": record.outcome,
        "reason": record.reason,
        "thinned": record.thinned,
        "redrawn": record.redrawn,
        "removed_segments": [JOINT_NAMES[int(segment)] for segment in record.removed_segments],
        "collided_frames": record.collided_frames,
        "deepest_m": record.deepest_m,
        "overlap_share": record.overlap_share,
        "overlap_depth_m": record.overlap_depth_m,
    }


def _info(
    record: BodySequence, description: Mapping[str, Any], rng: np.random.Generator
) -> SampleInfo:
    camera, lights = sample_scene(rng)
    return SampleInfo(
        poses=record.poses,
        trans=record.trans,
        shape=record.shape,
        gender=record.gender,
        outfit={
            garment["name"]: {
                "texture": _cloth3d_texture(garment["texture"]),
                "fabric": cloth3d_name(garment["fabric"]),
            }
            for garment in description["garments"]
        },
        tightness=np.asarray(description["tightness"]),
        camera_location=camera,
        lights=lights,
    )


def _cloth3d_texture(texture: Mapping[str, Any]) -> dict[str, Any]:
    """What `info.mat` says of a texture: the colour of a plain one alone."""
    if texture["type"] == "pattern":
        return {"type": "pattern"}
    return {"type": texture["type"], "data": texture["data"]}


def _write_garment(
    folder: Path, garment: Garment, simulation: Path, frame_count: int
) -> dict[str, float]:
    name = garment.name
    mesh = Mesh(garment.vertices, garment.faces, garment.uv, garment.uv_faces)
    save_obj(folder / f"{name}.obj", mesh)
    if "print" in garment.attributes["texture"]:
        Image.fromarray(draw_cloth(garment)).save(folder / f"{name}.png")
    source = simulation / f"{name}.f32"
    with PointCache(source, len(mesh.vertices)) as cache:
        if len(cache) != frame_count:
            raise InputError(
                f"{source}: {len(cache)} frames of {len(mesh.vertices)} vertices,"
                f" expected {frame_count} as in the body's poses"
            )
        with point_cache_writer(folder / f"{name}.pc16", len(mesh.vertices)) as half:
            for start in range(0, frame_count, _CHUNK):
                frames = cache.frames(start, min(start + _CHUNK, frame_count))
                if not np.isfinite(frames).all():
                    bad = start + int(np.argmin(np.isfinite(frames).all(axis=(1, 2))))
                    raise InputError(
                        f"{source}: frame {bad} holds NaN or infinity, expected finite positions"
                    )
                half.append(frames)
    link_or_copy(source, folder / EXTRAS / f"{name}.f32")
    ends = mesh.vertices[edges(mesh.faces)]
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "edge_m": float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()),
    }


def _parts(frames: np.ndarray) -> Iterator[slice]:
    """Slices of frames (N, ...), of no more than are held in memory."""
    return (slice(start, start + _CHUNK) for start in range(0, len(frames), _CHUNK))


def _write_body(
    folder: Path, body: BodyModel, shape: np.ndarray, frames: Iterable[np.ndarray]
) -> None:
    """Write the body at rest, and its vertices (n, V, 3) in motion, root-relative."""
    rest, _ = posed_vertices(body, shape, REST_POSE[None].copy())
    save_obj(folder / EXTRAS / f"{BODY}.obj", Mesh(rest[0], body.faces, body.vt, body.ft))
    with point_cache_writer(folder / EXTRAS / f"{BODY}.pc16", len(body.v_template)) as writer:
        for part in frames:
            writer.append(part)


def _write_masks(
    folder: Path, body: BodyModel, record: BodySequence, garments: Sequence[Garment]
) -> None:
    """Write what of a body collided, where it was pressed apart, and what of garments was held."""
    save_npz(
        folder / EXTRAS / f"{BODY}.npz",
        collides=collides(body, record),
        fix_frame=record.fix_frame,
        fix_vertex=record.fix_vertex,
        fix_delta=record.fix_delta,
    )
    for garment in garments:
        save_npz(
            folder / EXTRAS / f"{garment.name}.npz",
            elastic=np.asarray(garment.elastic, dtype=np.float32),
            held=np.asarray(garment.pin, dtype=np.float32),
            band=np.asarray(garment.band, dtype=np.float32),
        )


class GarmentAnimation(NamedTuple):
    """A garment in motion that was not simulated, such as a reconstruction."""

    name: str  # one of CLOTH3D's garment types
    rest: Mesh  # mesh in the rest pose, root-relative metres
    frames: np.ndarray  # (F, V, 3) root-relative metres


def write_reconstruction(
    folder: str | Path,
    body: BodyModel,
    info: SampleInfo,
    garments: Sequence[GarmentAnimation],
    surface: np.ndarray | None = None,
) -> None:
    """Write garments and their body as a CLOTH3D folder without `meta.json`, like the original.

    Args:
        folder: replaced as a whole; its name is the sample's id.
        info: F frames, with an outfit entry for each garment.
        garments: F frames each.
        surface: (F, B, 3) root-relative metres of a body whose parts were pressed apart; None takes
            it as its joints pose it.
    """
    with atomic_folder(folder) as scratch:
        (scratch / EXTRAS).mkdir()
        write_info(scratch / "info.mat", info)
        for name, rest, frames in garments:
            save_obj(scratch / f"{name}.obj", rest)
            with point_cache_writer(scratch / f"{name}.pc16", len(rest.vertices)) as half:
                half.append(frames)
            single = scratch / EXTRAS / f"{name}.f32"
            with point_cache_writer(single, len(rest.vertices)) as full:
                full.append(frames)
        posed = (
            posed_vertices(body, info.shape, info.poses[part])[0]
            if surface is None
            else surface[part]
            for part in _parts(info.poses)
        )
        _write_body(scratch, body, info.shape, posed)
