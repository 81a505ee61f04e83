"""Every loader of files that users have, and an honest file for each.

`LOADERS` is the list. Files are made once, by `make_files`, from the toys of the other tests.
"""

import base64
import json
import pickle
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import torch
import trimesh
import yaml
from PIL import Image

from drapeline.bodies.model import (
    BodyModel,
    free_body,
    keep_body,
    load_body,
    load_kept_body,
    save_body,
)
from drapeline.bodies.moved_body import BodyState
from drapeline.bodies.sequence import load_body_sequence
from drapeline.bodies.smpl_files import convert_to_pickle, read_body_arrays
from drapeline.dataset.animated_gltf import read_gltf
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.info_mat import read_info, read_placement
from drapeline.dataset.moving_meshes import read_moving_meshes
from drapeline.dataset.point_clouds import load_clouds, write_clouds
from drapeline.dataset.reader import Cloth3D, Sample
from drapeline.dataset.record import outfit_text, read_record
from drapeline.dataset.scans import read_body_parameters, read_frames
from drapeline.dataset.scene_part import ScenePart
from drapeline.dataset.segmented_scans import ScanWindow, SegmentedScan, load_scans, save_scans
from drapeline.dataset.settings import CloudSettings
from drapeline.dataset.worst_frame import read_worst_frame
from drapeline.dataset.writer import write_sample
from drapeline.experiment.checks import refuse_contradictions
from drapeline.experiment.config import fill_settings
from drapeline.experiment.source_digest import Sources
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import load_obj, save_obj
from drapeline.geometry.point_cache import PointCache, write_point_cache
from drapeline.learning_data.dynamic import DynamicData, collect_dynamic
from drapeline.learning_data.garment_fields import FieldData, collect_fields
from drapeline.learning_data.moving import load_moving
from drapeline.learning_data.occlusion import texture_pixels
from drapeline.learning_data.sequences import CloudData, SequenceData
from drapeline.learning_data.settings import SkinnedSettings
from drapeline.learning_data.skinned import load_skinned, write_skinned
from drapeline.learning_data.static import StaticData, collect_static
from drapeline.manifest import damages, write_manifest
from drapeline.metrics.cost import Cost, read_costs, write_costs
from drapeline.metrics.predictions import (
    FittedPicture,
    PersonShown,
    Reconstruction,
    load_fitted_picture,
    load_fitted_scans,
    load_reconstruction,
    save_fitted_scans,
)
from drapeline.metrics.table import read_metrics, write_metrics
from drapeline.models.garment4d.ours.labels import LabelStage
from drapeline.models.garment4d.stages import (
    CanonicalStage,
    PosedStage,
    keep_bodies,
    load_seen_forms,
    load_stage,
    save_seen_forms,
)
from drapeline.models.gcvae.codec import load_codes
from drapeline.models.gcvae.load import load_codec, load_training_codes
from drapeline.models.gcvae.pictures.data import PictureData, collect_pictures
from drapeline.models.gcvae.pictures.network import CodeSpace, PictureCoder, load_coder
from drapeline.models.gcvae.ppca import StaticPpca
from drapeline.models.gcvae.sample import load_samples
from drapeline.models.gcvae.settings import PictureNetwork, PpcaSettings
from drapeline.models.gcvae.train import load_conditioning
from drapeline.models.gcvae.vae import StaticVae
from drapeline.models.load import load
from drapeline.models.pictures.files import files_of_picture, picture_files
from drapeline.models.pictures.read import CLASSES, read_picture
from drapeline.models.smplicit.decoder import load_released
from drapeline.models.smplicit.encoder import ImageEncoder, load_encoder_weights
from drapeline.models.smplicit.gallery.files import CODES, load_gallery, posed_prototype
from drapeline.models.smplicit.model import load_training_codes as load_field_codes
from drapeline.models.smplicit.model import save_model_files
from drapeline.models.smplicit.network import load_field, new_field
from drapeline.models.smplicit.representation import HeldOut, load_held_out, save_held_out
from drapeline.models.training.checkpoints import read_checkpoint, write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.motions.importing import frame_count, import_motion
from drapeline.motions.joint_map import BUILT_IN, load_joint_map
from drapeline.motions.motion import Cycle, save_motion
from drapeline.motions.table import MotionTable
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.outfit import load_outfit
from drapeline.outfits.settings import own_garments
from drapeline.outfits.static import load_static
from drapeline.outfits.templates import build_templates, load_templates
from drapeline.outfits.user_garment import load_user_garment
from drapeline.registration.to_body.dynamic_offsets import load_sample_garment
from drapeline.registration.to_body.hierarchy import Hierarchy, load_hierarchy, save_hierarchy
from drapeline.registration.to_body.topology import (
    TOPOLOGIES,
    Topology,
    load_topology,
    save_topology,
)
from drapeline.registration.to_template.garment_space import load_space
from drapeline.registration.to_template.garment_template import load_template
from drapeline.registration.to_template.remesh import RemeshTable, load_tables
from drapeline.report.models.gcvae.pictures import load_pictures
from drapeline.report.models.smplicit.tables import read_gallery_tables
from drapeline.schema import Column, Schema, read_table
from drapeline.seeding import rng_for
from drapeline.storage import save_npz, write_rows
from fuzz.runs import Loader
from toys.bodies import toy_body
from toys.garment4d import CANONICAL, LABELLING, POSED, open_toy_data, save_toy_data, save_toy_tops
from toys.garment4d_stages import build_canonical, fit_toy_model
from toys.gcvae import toy_template
from toys.gcvae_files import SETTINGS, TypedGarments, save_model, save_static_data
from toys.metric_rows import metric_row, metric_table
from toys.motion_files import (
    amc_text,
    asf_text,
    smooth_turns,
    standing_motion,
    write_bvh,
)
from toys.moving import write_registered_sample
from toys.outfits_at_rest import save_static
from toys.pictured import VIEWS, save_registered, toy_motions
from toys.schema import SCHEMA
from toys.smplicit import RESOLUTION, toy_fields, toy_outfits, toy_settings, toy_shard
from toys.smplicit import tube as sheet
from toys.templates import toy_template as toy_garment_template
from toys.tiny_sample import tube, write_tiny_sample

ROOT = Path(__file__).parents[2]
_CELL_M = 0.06  # a coarse body, so that files are small


@cache
def body() -> BodyModel:
    """The coarse body, read from a file so that the toy is not built in every process."""
    return load_body(_FILES["bodies"] / "body.npz")


def bodies() -> dict[str, BodyModel]:
    """The same for both genders."""
    return dict.fromkeys(GENDERS, body())


_FILES: dict[str, Path] = {}


def make_files(root: Path, loaders: "list[Loader]") -> None:
    """Write every loader's honest files to its folder under `root`, unless they are there."""
    open_files(root)
    target = root / "bodies" / "body.npz"
    if not target.is_file():
        save_body(target, replace(toy_body(_CELL_M), name="toy"))
    for loader in loaders:
        folder = root / loader.name
        if not (root / f"{loader.name}.made").is_file():
            folder.mkdir(exist_ok=True)
            loader.make(folder)
            (root / f"{loader.name}.made").touch()


def open_files(root: Path) -> None:
    """Use the files that `make_files` wrote."""
    _FILES["bodies"] = root / "bodies"


# ---- motions --------------------------------------------------------------------------------


def _make_motion(folder: Path) -> None:
    motion = standing_motion(40, height=0.9, cycle=Cycle(0.1, np.array([0.1, 0.0])))
    save_motion(folder / "walk.npz", motion)


def _make_amass(folder: Path) -> None:
    poses = np.tile(np.concatenate([[np.pi / 2], np.zeros(155)]), (40, 1))
    np.savez(
        folder / "walk.npz",
        poses=poses,
        trans=np.zeros((40, 3)),
        betas=np.zeros(16),
        mocap_framerate=np.array(60.0),
        gender=np.array("female"),
    )


def _make_bvh(folder: Path) -> None:
    turns = smooth_turns(rng_for(0, "fuzz bvh"), 12, 24, 0.3)
    write_bvh(folder / "walk.bvh", turns, np.tile([0.0, 0.9, 0.0], (12, 1)))


def _make_amc(folder: Path) -> None:
    (folder / "07.asf").write_text(asf_text())
    (folder / "07_01.amc").write_text(amc_text([{}] * 8))


def _import(folder: Path) -> Any:
    path = next(p for p in sorted(folder.iterdir()) if p.suffix in (".npz", ".bvh", ".amc"))
    return import_motion(path, frames=30)


def _count(folder: Path) -> Any:
    path = next(p for p in sorted(folder.iterdir()) if p.suffix in (".npz", ".bvh", ".amc"))
    return frame_count(path, frames=None)


def _make_motion_table(folder: Path) -> None:
    _make_motion(folder)
    _make_amc(folder)
    header = "name\tfile\taction\tsubject\tloop\tjoint_map\tasf\tamc_fps\n"
    (folder / "clips.tsv").write_text(
        header + "walk\twalk.npz\twalk\t01\tyes\t\t\t\ntake\t07_01.amc\t\t\tno\t\t07.asf\t120\n"
    )


# ---- config ---------------------------------------------------------------------------------


def _load_config(folder: Path) -> Any:
    from drapeline.errors import InputError

    path = folder / "config.yaml"
    try:  # Snakemake's own reading, whose errors are its own
        given = yaml.safe_load(path.read_bytes())
    except (yaml.YAMLError, ValueError, RecursionError, TypeError) as error:
        raise InputError(f"{path}: not YAML") from error
    if not isinstance(given, dict):
        return None
    settings = fill_settings(given, SCHEMA, str(path))
    refuse_contradictions(settings)
    own_garments(settings["outfits"]["own_garments"])
    return settings


# ---- bodies ---------------------------------------------------------------------------------


def _make_pickle(folder: Path, protocol: int) -> None:
    arrays = read_body_arrays(_FILES["bodies"] / "body.npz")
    with open(folder / "body.pkl", "wb") as stream:
        pickle.dump({k: v for k, v in arrays.items() if k != "name"}, stream, protocol=protocol)


# ---- samples --------------------------------------------------------------------------------


def _make_sample(folder: Path) -> None:
    write_tiny_sample(folder, body(), "00001")


def _use_sample(folder: Path) -> None:
    """Everything that a sample has."""
    with Sample(folder / "samples" / "00001", bodies=bodies()) as sample:
        _ = sample.meta, sample.health, sample.fabrics, sample.gender, sample.tightness
        for garment in sample.garments:
            _ = sample.mesh(garment)
            sample.vertices(garment, 0, sample.frame_count)
        sample.body_mesh()
        sample.body_vertices(0, sample.frame_count)


def _use_dataset(folder: Path) -> None:
    for sample in Cloth3D(folder / "samples"):
        _ = sample.frame_count, sample.garments


def _write_again(folder: Path) -> None:
    write_sample(
        rng_for(0, "again"),
        folder / "again" / "00001",
        body=body(),
        body_record=folder / "bodies" / "00001.npz",
        outfit=folder / "outfits" / "00001.npz",
        simulation=folder / "simulation" / "00001",
        status={"status": "accepted", "reason": ""},
        seed=0,
        split="train",
    )


def _load_record(folder: Path) -> None:
    record = read_record(folder / "samples" / "00001")
    _ = record.accepted
    outfit_text(record.meta)


def _make_info(folder: Path) -> None:
    from drapeline.dataset.info_mat import SampleInfo, sample_scene, write_info

    camera, lights = sample_scene(rng_for(3, "scene"))
    texture = {"texture": {"type": "color", "data": np.array([0.1, 0.2, 0.3])}, "fabric": "silk"}
    write_info(
        folder / "info.mat",
        SampleInfo(
            np.zeros((4, 72)),
            np.zeros((4, 3)),
            np.zeros(10),
            "male",
            0.5,
            {"Top": texture},
            np.zeros(2),
            camera,
            lights,
        ),
    )


def _make_packed_info(folder: Path) -> None:
    _make_info(folder)
    loaded = scipy.io.loadmat(folder / "info.mat")
    values = {k: v for k, v in loaded.items() if not k.startswith("__")}
    scipy.io.savemat(folder / "info.mat", values, do_compression=True)


def _make_clouds(folder: Path) -> None:
    write_tiny_sample(folder / "stages", body(), "00001")
    write_clouds(
        folder / "clouds", folder / "stages" / "samples" / "00001", CloudSettings(points=60)
    )


def _make_cache(folder: Path, suffix: str) -> None:
    write_point_cache(folder / f"cache{suffix}", np.zeros((4, 20, 3), np.float32))


# ---- scans ----------------------------------------------------------------------------------


def _make_parameters(folder: Path) -> None:
    poses = np.tile(REST_POSE, (3, 1))
    save_npz(
        folder / "body.npz",
        poses=poses,
        trans=np.zeros((3, 3)),
        shape=np.zeros(10),
        gender="female",
    )


def _make_ply(folder: Path, encoding: str) -> None:
    shown = body()
    mesh = trimesh.Trimesh(
        shown.v_template[:300], shown.faces[(shown.faces < 300).all(1)], process=False
    )
    (folder / "f1.ply").write_bytes(mesh.export(file_type="ply", encoding=encoding))


# ---- garments, registrations, learning data -------------------------------------------------


def _make_garment(folder: Path) -> None:
    save_obj(folder / "skirt.obj", tube(0.3, -0.4, 0.05, around=16))


def _moving_part() -> ScenePart:
    mesh = tube(0.3, -0.4, 0.05, around=16)
    points = np.stack([mesh.vertices + [0, 0, 0.1 * k] for k in range(3)]).astype(np.float32)
    return ScenePart("Skirt", mesh, (0.5, 0.5, 0.5), lambda a, b: points[a:b], 3)


def _make_gltf(folder: Path) -> None:
    write_glb(folder / "a.glb", [_moving_part()])


def _make_gltf_text(folder: Path) -> None:
    corners = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]).tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(corners).decode()
    document = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0, "translation": [0, 0, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": uri}],
    }
    (folder / "a.gltf").write_text(json.dumps(document))


def _make_moving_arrays(folder: Path) -> None:
    part = _moving_part()
    save_npz(folder / "a.npz", vertices=part.read(0, 3), faces=part.mesh.faces)


def _read_moving(path: Path) -> object:
    with ExitStack() as opened:
        return [part.read(0, part.frame_count) for part in read_moving_meshes(path, opened)]


def _make_worst_frame(folder: Path) -> None:
    mesh = tube(0.3, -0.4, 0.05, around=16)
    (folder / "extras").mkdir()
    arrays = {"vertices": mesh.vertices, "faces": mesh.triangles}
    save_npz(
        folder / "extras" / "worst_frame.npz",
        frame=3,
        root_rotation=np.zeros(3),
        body=mesh.vertices,
        body_faces=mesh.triangles,
        **{f"Skirt/{name}": value for name, value in arrays.items()},
        **{"Skirt/wrong": np.zeros(len(mesh.vertices), bool)},
    )


def _make_untidy_obj(folder: Path) -> None:
    text = ["# a comment", "o skirt"]
    mesh = tube(0.3, -0.4, 0.05)
    text += [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    text += [f"vt {u} {v}" for u, v in mesh.uv]
    text += ["vn 0 0 1"]
    for face, corners in zip(mesh.faces, mesh.uv_faces, strict=True):
        text.append(
            "f " + " ".join(f"{a + 1}/{b + 1}/1" for a, b in zip(face, corners, strict=True))
        )
    (folder / "mesh.obj").write_text("\n".join(text) + "\n")


def _make_hierarchy(folder: Path) -> None:
    rng = rng_for(0, "fuzz hierarchy")
    counts = [40, 20, 12, 8, 6, 4]
    level = {
        "parents": [rng.integers(b, size=a).astype(np.int32) for a, b in pairwise(counts)],
        "edges": [np.array([[0, 1], [1, 2]], np.int32)] * 6,
        "positions": [rng.normal(size=(n, 3)).astype(np.float32) for n in counts],
        "vertices": [np.arange(n, dtype=np.int32) for n in counts],
    }
    save_hierarchy(
        folder / "hierarchy.npz", Hierarchy(*(dict.fromkeys(TOPOLOGIES, level[k]) for k in level))
    )


def _make_topology(folder: Path) -> None:
    faces = body().faces
    count = len(body().v_template)
    save_topology(
        folder / "topology.npz",
        Topology(
            faces=faces,
            skirt_faces=faces,
            joining=np.int32(4),
            inner_leg=np.zeros(count, bool),
            segments=np.zeros(count, np.int32),
            corners=np.zeros((count, 3), np.int32),
            shares=np.full((count, 3), 1 / 3),
            rest=body().v_template,
        ),
    )


TABLE = Schema("a table", {"id": Column(), "value": Column(float)})


def _make_tables(folder: Path) -> None:
    corner = np.array([[0, 1, 2], [2, 2, 0]], dtype=np.int32)
    share = np.array([[0.25, 0.5, 0.25], [0.5, 0.5, 0.0]], dtype=np.float32)
    arrays = RemeshTable(corner, share)._asdict()
    save_npz(folder / "tables.npz", **{f"s1/{key}": value for key, value in arrays.items()})


def _make_moving(folder: Path) -> None:
    write_registered_sample(folder, body(), "00001", "train")


def _load_moving(folder: Path) -> Any:
    return list(load_moving([folder / "samples"], [folder / "registration"], ["train"])["train"])


def _make_dynamic(folder: Path) -> None:
    made = write_registered_sample(folder / "stages", body(), "00001", "train")
    collect_dynamic(
        folder / "data", {made.tiny.folder: made.registration}, bodies(), version="posed", step=2
    )


def _use_dynamic(folder: Path) -> None:
    data = DynamicData(folder / "data")
    rows = data.rows("train")
    data.topology(rows)
    data.static_batch(np.unique(data.garment_index[rows]))


def _use_static(folder: Path) -> None:
    data = StaticData(folder / "data")
    rows = data.rows("train")
    data.cvar(rows), data.topology(rows), data.names(rows)


def _make_static_shard(folder: Path) -> None:
    count, vertices = 6, len(body().v_template)
    save_npz(
        folder / "shard.npz",
        offsets=np.zeros((count, vertices, 3), np.float32),
        mask=np.ones((count, vertices), bool),
        shape=np.zeros((count, 10), np.float32),
        gender=np.zeros(count, np.int8),
        tightness=np.zeros((count, 2), np.float32),
        garment=np.arange(count, dtype=np.int8),
        outfit=np.array([f"s{row}" for row in range(count)]),
        split=np.array(["train"] * 4 + ["val", "test"]),
    )


def _make_field_shard(folder: Path) -> None:
    save_npz(folder / "shard.npz", **toy_shard(body))


def _collect_fields(folder: Path) -> None:
    pixels = texture_pixels(body(), RESOLUTION)
    shards = [folder / "shard.npz"]
    collect_fields(folder / "data", shards, ["Skirt"], bodies(), pixels, clusters=20)


def _use_fields(folder: Path) -> None:
    data = FieldData(folder / "data")
    rows = data.rows("train")
    data.batch(rows), data.names(rows)


def _make_skinned(folder: Path) -> None:
    stages = folder / "stages"
    write_tiny_sample(stages, body(), "00001", "train")
    outfits = toy_outfits()[:1]
    save_static(stages / "outfits_at_rest", outfits)
    write_skinned(
        folder / "out",
        stages / "outfits_at_rest",
        [stages / "samples" / "00001"],
        bodies(),
        SkinnedSettings(frames=3, step=1, clouds=CloudSettings(points=60)),
    )


def _use_clouds(folder: Path) -> None:
    data = CloudData(folder / "data")
    for sequence in range(len(data)):
        data.rows(sequence)
    data.windows("train", 3, 1)
    data.label_share("train")
    data.arrays()


def _use_sequences(folder: Path) -> None:
    data = SequenceData(folder / "data")
    for sequence in range(len(data)):
        data.rows(sequence)
    _ = data.originals
    data.windows("train", 3, 1)
    data.label_share("train")
    data.arrays()


# ---- models ---------------------------------------------------------------------------------


def _make_svae(folder: Path) -> None:
    save_model(folder / "svae", garments=save_static_data(folder / "data"))
    for path in sorted((folder / "data").iterdir()):
        path.unlink()
    (folder / "data").rmdir()


def _make_ppca(folder: Path) -> None:
    garments = TypedGarments()
    model = StaticPpca(PpcaSettings(latent=4), toy_template())
    model.fit(garments)
    save_model(folder / "ppca", model.eval(), garments)


def _make_pictures(folder: Path) -> None:
    data = save_registered(folder / "registered", body())
    outfits = toy_outfits()[:2]
    collect_pictures(folder / "pictures", outfits, toy_motions(), data, bodies(), VIEWS)
    shutil.rmtree(folder / "registered")


def _use_pictures(folder: Path) -> None:
    pictures = PictureData(folder / "pictures", len(toy_outfits()))
    for split in ("train", "val"):
        pictures.images(pictures.rows(split)[:4])


def _make_coder(folder: Path) -> None:
    means = np.zeros((len(CLASSES), 3), np.float32)
    known = np.ones(len(CLASSES), bool)
    space = CodeSpace(means, known, np.ones(3, np.float32), np.zeros(2, np.float32), "abc")
    coder = PictureCoder(PictureNetwork(width=2), VIEWS.size_px, space)
    write_checkpoint(folder / BEST, coder.state_dict(), coder.checkpoint_metadata())


def _make_segmented(folder: Path) -> None:
    plain = np.zeros((2, 8, 8), np.uint8)
    save_npz(folder / "pictures.npz", name=np.array(["a", "b"]), labels=plain, segments=plain)


def _make_conditioning(folder: Path) -> None:
    weights = StaticVae(SETTINGS, toy_template()).conditioning.state_dict()
    state = {f"autoencoder.{name}": value for name, value in weights.items()}
    write_checkpoint(folder / BEST, state, {"checkpoint_type": "conditioning"})


def _load_conditioning(folder: Path) -> None:
    path = folder / BEST
    load_conditioning(read_checkpoint(path), StaticVae(SETTINGS, toy_template()).conditioning, path)


def _make_codes(folder: Path) -> None:
    rng = rng_for(0, "fuzz codes")
    save_npz(
        folder / "codes.npz",
        mean=rng.normal(size=(5, 4)).astype(np.float32),
        log_variance=rng.normal(size=(5, 4)).astype(np.float32),
        garment=np.arange(5),
        outfit=np.array([f"s{k}" for k in range(5)]),
        split=np.array(["train"] * 5),
    )


def _make_samples(folder: Path) -> None:
    save_npz(
        folder / "codes.npz",
        name=np.array(["001", "002"]),
        garment=np.array(["Skirt", "Top"]),
        asked=np.array([True, False]),
        cvar=np.zeros((2, 13), np.float32),
        z=np.zeros((2, 4), np.float32),
    )
    save_obj(folder / "001.obj", tube(0.3, -0.4, 0.05))


def _make_stages(folder: Path) -> None:
    """Untrained stages of Garment4D, and our model with labels that are not trained either."""
    save_toy_data(folder / "data", body())
    sequences = open_toy_data(folder / "data", body(), 30)
    canonical = build_canonical(sequences, CANONICAL)
    posed = PosedStage(PosedStage.SETTINGS(**POSED), canonical)
    labels = LabelStage(LabelStage.SETTINGS(**LABELLING))
    for name, stage in (("canonical", canonical), ("posed", posed), ("labels", labels)):
        out = folder / name
        out.mkdir()
        write_checkpoint(out / BEST, stage.state_dict(), stage.checkpoint_metadata())
    save_seen_forms(folder / "posed", sequences)
    keep_bodies(folder / "labels", bodies())
    save_toy_tops(folder / "labelled", body())
    fit_toy_model(folder / "ours", folder / "labels", sequences, CloudData(folder / "labelled"))


def _make_field_model(folder: Path) -> None:
    data = toy_fields(folder / "fields", body)
    model = new_field("skirt", data, bodies(), toy_settings())
    out = folder / "skirt"
    out.mkdir()
    write_checkpoint(out / BEST, model.state_dict(), model.checkpoint_metadata())
    save_model_files(out, model, data, bodies())


def _make_released(folder: Path) -> None:
    from drapeline.models.smplicit.decoder import FieldDecoder, export_released

    export_released(folder / "decoder.pth", FieldDecoder(20, 2, 3, rng=torch.Generator()), 1.0)


def _encoder() -> ImageEncoder:
    return ImageEncoder(4, width=2, rng=torch.Generator().manual_seed(0))


def _make_encoder(folder: Path) -> None:
    torch.save(_encoder().state_dict(), folder / "resnet.pth")


def _make_gallery(folder: Path) -> None:
    names = np.array(["001", "002"])
    save_npz(
        folder / CODES,
        z=np.zeros((2, 5), np.float32),
        shape=np.zeros((2, 10), np.float32),
        gender=np.array(["female", "male"]),
        sheet=np.array(["prototypes"] * 2),
        row=np.array(["a", "b"]),
        column=np.array(["x", "y"]),
        caption=np.array(["one", "two"]),
        garment=np.array(["Skirt", "Skirt"]),
        name=names,
    )
    for name in names:
        save_obj(folder / f"{name}.obj", tube(0.3, -0.4, 0.05))


def _use_gallery(folder: Path) -> None:
    load_gallery(folder, bodies())
    posed_prototype(folder)


def _make_gallery_tables(folder: Path) -> None:
    for name in ("garments", "correlations", "regressions"):
        write_rows(folder / f"{name}.tsv", [{"model": "skirt", "name": "001", "value": 0.5}] * 2)


def _make_held_out(folder: Path) -> None:
    kinds = np.array([GARMENTS.index("Top")] * 2, np.int8)
    z = np.zeros((2, 3), np.float32)
    sheets = [sheet(0.3, -0.5, 0.0), sheet(0.2, -0.5, 0.0)]
    save_held_out(folder / "held_out.npz", HeldOut(np.array(["s1", "s2"]), kinds, z, sheets))


# ---- pictures and what was found in them ----------------------------------------------------


def _make_picture(folder: Path, labels: str) -> None:
    values = np.zeros((60, 80), np.uint8)
    values[20:40, 30:50] = 12
    values[5:18, 30:50] = 5
    if labels.endswith(".npy"):
        np.save(folder / labels, values)
    else:
        Image.fromarray(values).save(folder / labels)
    to_camera = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 2.5], [0, 0, 0, 1]]
    person = {
        "gender": "female",
        "shape": [0.0] * 10,
        "pose": REST_POSE.tolist(),
        "trans": [0.0] * 3,
    }
    given = {
        "segmentation": labels,
        "labels": "lip",
        "camera": {"focal_px": 70.0, "world_to_camera": to_camera},
        "people": [person],
    }
    (folder / "street.json").write_text(json.dumps(given))


def _read_picture(folder: Path) -> Any:
    for path in picture_files([folder]):
        files_of_picture(path)
        read_picture(path, bodies(), least_px=50)


def _make_fitted_picture(folder: Path) -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    mesh = Mesh(vertices, np.array([[0, 1, 2]], np.int32))
    person = PersonShown(np.diag([90.0, 90, 1]), np.eye(4), mesh, {"Skirt": mesh}, {"Skirt": mesh})
    photo = np.zeros((4, 6, 3), np.uint8)
    FittedPicture("street", photo[..., 0], photo, (person,)).save(folder / "street.npz")


def _make_reconstruction(folder: Path) -> None:
    frames, points = 2, 3
    cloth = np.zeros((frames, points, 3), np.float32)
    faces = np.array([[0, 1, 2]], np.int32)
    Reconstruction(
        name="00001",
        garment="Skirt",
        faces=faces,
        canonical=cloth[0],
        proposal=cloth,
        final=cloth,
        true=cloth,
        true_canonical=cloth[0],
        points=cloth,
        labels=np.zeros((frames, points), np.uint8),
        body=cloth,
        rest_body=cloth[0],
        body_faces=faces,
        root_rotation=np.zeros((frames, 3)),
        root_height=np.zeros(frames),
        number=np.arange(frames),
    ).save(folder / "r.npz")


def _make_manifest(folder: Path) -> None:
    (folder / "a.bin").write_bytes(bytes(100))
    write_manifest(folder)


def _make_metrics(folder: Path) -> None:
    rows = [metric_row("ours", garment, "surface_error_mm", 3.0) for garment in ("Top", "Skirt")]
    write_metrics(folder / "metrics.tsv", metric_table(rows))


COSTS = [Cost("scan", variant, 0.5, 12, 800.0) for variant in ("svae_scan", "ours")]


def _make_sources(folder: Path) -> None:
    sources = Sources(ROOT / "src", memory=str(folder / "sources.json"))
    sources.digest(ROOT / "scripts" / "collect_metrics.py")
    sources.remember()


def _digest(folder: Path) -> Any:
    sources = Sources(ROOT / "src", memory=str(folder / "sources.json"))
    return sources.digest(ROOT / "scripts" / "collect_metrics.py")


def _make_scans(folder: Path) -> None:
    standing = BodyState(np.tile(np.eye(3), (24, 1, 1)), np.zeros(3), np.zeros(10))
    one = SegmentedScan(
        "00001_003",
        3,
        np.zeros((40, 3)),
        np.zeros(40, dtype=int),
        ("Skirt",),
        "female",
        standing,
        None,
        ScanWindow(
            np.zeros((3, 40, 3), np.float32),
            np.zeros((3, 40), np.uint8),
            np.tile(REST_POSE, (3, 1)),
            np.zeros((3, 3)),
        ),
    )
    save_scans(folder / "scans.npz", [one], [standing])


def _make_fits(folder: Path) -> None:
    triangle = Mesh(np.eye(3), np.array([[0, 1, 2]]))
    save_fitted_scans(folder / "fits.npz", {"00001_003": {"svae_scan": {"Skirt": triangle}}})


def _loaders() -> Iterator[Loader]:
    yield Loader("motion", _make_motion, _import)
    yield Loader("motion_length", _make_motion, _count)
    yield Loader("amass", _make_amass, _import)
    yield Loader("amass_length", _make_amass, _count)
    yield Loader("bvh", _make_bvh, _import)
    yield Loader("bvh_length", _make_bvh, _count)
    yield Loader("amc", _make_amc, _import)
    yield Loader("amc_length", _make_amc, _count, "*.amc")
    yield Loader(
        "joint_map",
        lambda f: (f / "map.yaml").write_text((sorted(BUILT_IN.glob("*.yaml"))[0]).read_text()),
        lambda f: load_joint_map(f / "map.yaml"),
    )
    yield Loader(
        "motion_table",
        _make_motion_table,
        lambda f: MotionTable(f / "clips.tsv").entries(loop_frames=60),
        "clips.tsv",
    )
    yield Loader(
        "config",
        lambda f: (f / "config.yaml").write_text((ROOT / "config.yaml").read_text()),
        _load_config,
    )
    yield Loader("source_digests", _make_sources, _digest)
    yield Loader(
        "body", lambda f: save_body(f / "body.npz", body()), lambda f: load_body(f / "body.npz")
    )
    yield Loader(
        "kept_body",
        lambda f: keep_body(f / "body.npz", load_body(free_body("female")), "female"),
        lambda f: load_kept_body(f / "body.npz", "female"),
    )
    for protocol in (2, 4):
        yield Loader(
            f"body_pickle_{protocol}",
            lambda f, protocol=protocol: _make_pickle(f, protocol),
            lambda f: load_body(f / "body.pkl"),
        )
    yield Loader(
        "convert_body",
        lambda f: save_body(f / "body.npz", body()),
        lambda f: convert_to_pickle(f / "body.npz", f / "out.pkl"),
    )
    yield Loader(
        "body_sequence",
        _make_sample,
        lambda f: load_body_sequence(f / "bodies" / "00001.npz"),
        "bodies/*.npz",
    )
    yield Loader(
        "outfit",
        _make_sample,
        lambda f: load_outfit(f / "outfits" / "00001.npz", f / "outfits" / "00001.json"),
        "outfits/*",
    )
    yield Loader("sample_writer", _make_sample, _write_again, "bodies/* outfits/* simulation/*/*")
    yield Loader("sample", _make_sample, _use_sample, "samples/00001/**/*.*")
    yield Loader("dataset", _make_sample, _use_dataset, "samples/00001/*")
    yield Loader("sample_record", _make_sample, _load_record, "samples/00001/extras/meta.json")
    yield Loader("info", _make_info, lambda f: read_info(f / "info.mat"))
    yield Loader("placement", _make_info, lambda f: read_placement(f / "info.mat"))
    yield Loader("packed_info", _make_packed_info, lambda f: read_info(f / "info.mat"))
    yield Loader("clouds", _make_clouds, lambda f: load_clouds(f / "clouds"), "clouds/*")
    for suffix in (".pc2", ".pc16", ".mdd", ".f32"):
        yield Loader(
            f"cache_{suffix[1:]}",
            lambda f, suffix=suffix: _make_cache(f, suffix),
            lambda f, suffix=suffix: PointCache(
                f / f"cache{suffix}", 20 if suffix == ".f32" else None
            ).frames(),
        )
    yield Loader("obj", _make_garment, lambda f: load_obj(f / "skirt.obj"))
    yield Loader("gltf", _make_gltf, lambda f: read_gltf(f / "a.glb"))
    yield Loader("gltf_text", _make_gltf_text, lambda f: read_gltf(f / "a.gltf"))
    yield Loader("moving_arrays", _make_moving_arrays, lambda f: _read_moving(f / "a.npz"))
    yield Loader(
        "worst_frame",
        _make_worst_frame,
        lambda f: read_worst_frame(f),
        "extras/*",
    )
    yield Loader("untidy_obj", _make_untidy_obj, lambda f: load_obj(f / "mesh.obj"))
    yield Loader("garment", _make_garment, lambda f: load_user_garment(f / "skirt.obj", body()))
    yield Loader(
        "scan_frames",
        lambda f: save_npz(f / "points.npz", points=_scan()),
        lambda f: read_frames(f / "points.npz"),
    )
    yield Loader("scan_npz", lambda f: save_npz(f / "f1.npz", points=_scan()[0]), read_frames)
    yield Loader("scan_ply", lambda f: _make_ply(f, "binary"), read_frames)
    yield Loader("scan_ply_text", lambda f: _make_ply(f, "ascii"), read_frames)
    yield Loader("scan_obj", _make_garment, read_frames)
    yield Loader(
        "scan_parameters",
        _make_parameters,
        lambda f: read_body_parameters(f / "body.npz", bodies()),
    )
    yield Loader(
        "table",
        lambda f: write_rows(f / "t.tsv", [{"id": "1", "value": 2.5}] * 3),
        lambda f: read_table(f / "t.tsv", TABLE),
    )
    yield Loader("manifest", _make_manifest, lambda f: list(damages(f, sums=True)), "*.tsv")
    yield Loader("metrics", _make_metrics, lambda f: read_metrics(f / "metrics.tsv"))
    yield Loader("costs", lambda f: write_costs(f, COSTS), lambda f: read_costs([f]))
    yield Loader("gallery_tables", _make_gallery_tables, read_gallery_tables)
    yield Loader(
        "templates",
        lambda f: build_templates(body()).save(f / "t.npz"),
        lambda f: load_templates(f / "t.npz"),
    )
    yield Loader(
        "static_outfits",
        lambda f: save_static(f / "outfits", toy_outfits()[:2]),
        lambda f: load_static(f / "outfits"),
        "outfits/*",
    )
    yield Loader("topology", _make_topology, lambda f: load_topology(f / "topology.npz"))
    yield Loader("hierarchy", _make_hierarchy, lambda f: load_hierarchy(f / "hierarchy.npz"))
    yield Loader(
        "registered_garment",
        _make_moving,
        lambda f: load_sample_garment(f / "registration" / "00001" / "Skirt.npz"),
        "registration/00001/Skirt.npz",
    )
    yield Loader("moving", _make_moving, _load_moving, "registration/00001/*")
    yield Loader("remesh_table", _make_tables, lambda f: load_tables([f]))
    yield Loader(
        "garment_template",
        lambda f: toy_garment_template().save(f / "t.npz"),
        lambda f: load_template(f / "t.npz"),
    )
    yield Loader(
        "static_shard",
        _make_static_shard,
        lambda f: collect_static(f / "data", [f / "shard.npz"], bodies()),
    )
    yield Loader("static_data", lambda f: save_static_data(f / "data"), _use_static, "data/*")
    yield Loader("dynamic_data", _make_dynamic, _use_dynamic, "data/*")
    yield Loader("field_shard", _make_field_shard, _collect_fields)
    yield Loader("field_data", lambda f: toy_fields(f, body), _use_fields, "data/*")
    yield Loader("skinned", _make_skinned, lambda f: list(load_skinned(f / "out")), "out/*")
    yield Loader("cloud_data", lambda f: save_toy_tops(f / "data", body()), _use_clouds, "data/*")
    yield Loader(
        "sequence_data", lambda f: save_toy_data(f / "data", body()), _use_sequences, "data/*"
    )
    yield Loader(
        "garment_space",
        lambda f: save_toy_data(f / "data", body()),
        lambda f: load_space(f / "data" / "space.npz"),
        "data/space.npz",
    )
    yield Loader("static_model", _make_svae, lambda f: load(f / "svae"), "svae/*")
    yield Loader(
        "static_checkpoint",
        _make_svae,
        lambda f: load_codec(f / "svae" / BEST),
        f"svae/{BEST}",
    )
    yield Loader(
        "static_codes",
        _make_svae,
        lambda f: load_training_codes(f / "svae"),
        "svae/training_codes.npz",
    )
    yield Loader("ppca", _make_ppca, lambda f: load(f / "ppca"), f"ppca/{BEST}")
    yield Loader("pictures_to_learn", _make_pictures, _use_pictures, "pictures/*")
    yield Loader("picture_network", _make_coder, load_coder, BEST)
    yield Loader("segmented_pictures", _make_segmented, lambda f: load_pictures(f / "pictures.npz"))
    yield Loader("conditioning", _make_conditioning, _load_conditioning)
    yield Loader(
        "canonical_stage",
        _make_stages,
        lambda f: load_stage(f / "canonical", CanonicalStage),
        "canonical/*",
    )
    yield Loader("codes", _make_codes, lambda f: load_codes(f / "codes.npz"))
    yield Loader("sampled_garments", _make_samples, load_samples)
    yield Loader(
        "label_stage", _make_stages, lambda f: load_stage(f / "labels", LabelStage), "labels/*"
    )
    yield Loader("label_model", _make_stages, lambda f: load(f / "labels"), "labels/**/*.*")
    for name in ("posed", "ours"):
        yield Loader(
            f"{name}_model", _make_stages, lambda f, name=name: load(f / name), f"{name}/*"
        )
    yield Loader("seen_forms", _make_stages, lambda f: load_seen_forms(f / "posed"), "posed/*.npz")
    yield Loader("fitting_model", _make_field_model, lambda f: load(f / "skirt"), "skirt/*")
    yield Loader(
        "field_checkpoint", _make_field_model, lambda f: load_field(f / "skirt"), f"skirt/{BEST}"
    )
    yield Loader(
        "field_codes",
        _make_field_model,
        lambda f: load_field_codes(f / "skirt"),
        "skirt/training_codes.npz",
    )
    yield Loader("scans", _make_scans, lambda f: load_scans(f / "scans.npz"))
    yield Loader("fitted_scans", _make_fits, lambda f: load_fitted_scans(f / "fits.npz"))
    yield Loader("released_decoder", _make_released, lambda f: load_released(f / "decoder.pth"))
    yield Loader(
        "encoder_weights",
        _make_encoder,
        lambda f: load_encoder_weights(_encoder(), f / "resnet.pth"),
    )
    yield Loader("gallery", _make_gallery, _use_gallery)
    yield Loader("held_out", _make_held_out, lambda f: load_held_out(f / "held_out.npz"))
    for labels in ("labels.png", "labels.npy"):
        yield Loader(
            f"picture_{labels[-3:]}",
            lambda f, labels=labels: _make_picture(f, labels),
            _read_picture,
        )
    yield Loader(
        "fitted_picture", _make_fitted_picture, lambda f: load_fitted_picture(f / "street.npz")
    )
    yield Loader("reconstruction", _make_reconstruction, lambda f: load_reconstruction(f / "r.npz"))


def _scan() -> np.ndarray:
    return rng_for(0, "fuzz scan").uniform(-0.5, 0.5, (2, 60, 3)).astype(np.float32)


LOADERS: dict[str, Loader] = {}
for _loader in _loaders():
    if _loader.name in LOADERS:
        raise RuntimeError(f"two loaders are called {_loader.name}")
    LOADERS[_loader.name] = _loader
