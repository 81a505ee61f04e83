import errno
import tracemalloc
from dataclasses import replace
from importlib.metadata import PackageNotFoundError

import numpy as np
import pytest

from drapeline import __version__
from drapeline.bodies.model import load_body, posed_vertices
from drapeline.bodies.sequence import load_body_sequence, save_body_sequence
from drapeline.dataset import writer
from drapeline.dataset.info_mat import SampleInfo, read_info
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import body_fingerprint, read_meta
from drapeline.dataset.worst_frame import read_worst_frame
from drapeline.dataset.writer import (
    GarmentAnimation,
    summarise_health,
    write_reconstruction,
    write_sample,
)
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, PARENTS, REST_POSE
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.geometry.obj import load_obj
from drapeline.geometry.point_cache import PointCache, PointCacheWriter, point_cache_writer
from drapeline.outfits.outfit import load_outfit
from drapeline.seeding import rng_for
from drapeline.storage import load_npz, save_npz
from toys.tiny_sample import GARMENTS, body_truth, tube, write_stages, write_tiny_sample


def write(tiny, body, sample="00001"):
    stages = tiny.stages
    return write_sample(
        rng_for(0, "scene"),
        tiny.folder,
        body=body,
        body_record=stages / "bodies" / f"{sample}.npz",
        outfit=stages / "outfits" / f"{sample}.npz",
        simulation=stages / "simulation" / sample,
        status=tiny.status,
        seed=0,
        split="train",
    )


def test_the_folder_holds_cloth3d_files_and_the_extras(tiny):
    files = {str(p.relative_to(tiny.folder)) for p in tiny.folder.rglob("*") if p.is_file()}
    cloth3d = {"info.mat", *(f"{name}.{suffix}" for name in GARMENTS for suffix in ("obj", "pc16"))}
    extras = {"meta.json", "manifest.tsv", "health.npz", "Body.obj", "Body.pc16"}
    extras |= {f"{name}.f32" for name in GARMENTS}
    extras |= {f"{name}.npz" for name in ("Body", *GARMENTS)}
    assert files == cloth3d | {f"extras/{name}" for name in extras}


def test_poses_and_shape_rebuild_the_stored_body(tiny, toy_body):
    info = read_info(tiny.folder / "info.mat")
    rebuilt, joints = posed_vertices(toy_body, info.shape, info.poses, info.trans)
    np.testing.assert_allclose(joints[:, 0], info.trans, atol=1e-6)
    stored = PointCache(tiny.folder / "extras/Body.pc16").frames() + info.trans[:, None]
    half = 2.0**-11 * np.maximum(np.abs(rebuilt - info.trans[:, None]), 0.5)
    assert (np.abs(stored - rebuilt) <= half + 1e-6).all()
    np.testing.assert_allclose(rebuilt, body_truth(toy_body, tiny), atol=1e-6)


def test_the_body_is_the_one_that_the_cloth_met(tmp_path, toy_body):
    """Where it overlapped itself it is pressed apart, whether read or rebuilt from its poses."""
    tiny = write_tiny_sample(tmp_path, toy_body)
    record = tiny.stages / "bodies/00001.npz"
    motion = load_body_sequence(record)
    delta = np.float32([[0, 0.03, 0], [0.02, 0, 0]])
    last = len(motion.poses) - 1
    pressed = replace(
        motion,
        fix_frame=np.int32([0, last]),
        fix_vertex=np.int32([3, 5]),
        fix_delta=delta,
    )
    save_body_sequence(record, pressed)
    write(tiny, toy_body)
    stored = Sample(tiny.folder).body_vertices(frame="root")
    rebuilt = Sample(tiny.folder, bodies={"female": toy_body}).body_vertices(frame="root")
    posed, _ = posed_vertices(toy_body, motion.shape, motion.poses)
    np.testing.assert_allclose(
        rebuilt[[0, last], [3, 5]] - posed[[0, last], [3, 5]], delta, atol=1e-6
    )
    np.testing.assert_allclose(stored, rebuilt, atol=1e-3)
    (one,) = Sample(tiny.folder, bodies={"female": toy_body}).body_vertices(
        last, last + 1, frame="root"
    )
    np.testing.assert_allclose(one, rebuilt[last], atol=1e-6)


def test_masks_tell_what_collided_and_what_was_held(tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body)
    sample = Sample(tiny.folder)
    hands = [JOINT_NAMES.index(f"{side}_hand") for side in ("left", "right")]
    collides = sample.masks("Body")["collides"]
    np.testing.assert_array_equal(collides, ~np.isin(toy_body.segmentation, hands))
    for garment in load_outfit(
        *(tiny.stages / f"outfits/00001.{s}" for s in ("npz", "json"))
    ).garments:
        masks = sample.masks(garment.name)
        np.testing.assert_array_equal(masks["elastic"], garment.elastic)
        np.testing.assert_array_equal(masks["held"], garment.pin)
    with pytest.raises(KeyError, match="no garment Hat"):
        sample.masks("Hat")
    (tiny.folder / "extras/Body.npz").unlink()
    assert Sample(tiny.folder).masks("Body") == {}


def test_the_rest_body_stands_with_legs_open_and_its_root_at_the_origin(tiny, toy_body):
    rest = load_obj(tiny.folder / "extras/Body.obj")
    expected, _ = posed_vertices(toy_body, tiny.shape, REST_POSE[None].copy())
    np.testing.assert_allclose(rest.vertices, expected[0], atol=1e-6)
    np.testing.assert_array_equal(rest.faces, toy_body.faces)


def test_garments_keep_single_precision_and_round_once_to_half(tiny):
    for name in GARMENTS:
        count = len(tiny.meshes[name].vertices)
        single = PointCache(tiny.folder / f"extras/{name}.f32", count).frames()
        half = PointCache(tiny.folder / f"{name}.pc16", count).frames()
        np.testing.assert_array_equal(single, tiny.vertices[name])
        np.testing.assert_array_equal(half, tiny.vertices[name].astype(np.float16))


def test_rest_garments_are_quads_in_the_order_of_the_frames(tiny):
    for name in GARMENTS:
        mesh, made = load_obj(tiny.folder / f"{name}.obj"), tiny.meshes[name]
        np.testing.assert_allclose(mesh.vertices, made.vertices, atol=1e-6)
        np.testing.assert_array_equal(mesh.faces, made.faces)
        np.testing.assert_array_equal(mesh.uv_faces, made.uv_faces)


def test_meta_tells_where_the_sample_comes_from(tiny):
    meta = read_meta(tiny.folder)
    assert meta["status"] == "accepted"
    assert meta["motion"]["source"] == "walk.txt"
    assert meta["motion"]["frames"] == len(tiny.poses)
    assert meta["body"] | {"fingerprint": ""} == {
        "model": "toy-1",
        "fingerprint": "",
        "gender": "female",
        "vertices": meta["body"]["vertices"],
    }
    assert meta["self_collision"]["removed_segments"] == ["left_hand", "right_hand"]
    assert meta["outfit"]["garments"][1]["parameters"] == {"length": 0.5}
    assert [one["steps"] for one in meta["simulation"]["attempts"]] == [14]
    assert meta["health"]["inside_share"] == pytest.approx({"mean": 0.005, "min": 0.0, "max": 0.01})


def test_a_sample_can_be_written_where_torch_is_not_installed(tmp_path, toy_body, monkeypatch):
    def version(name):
        if name == "torch":
            raise PackageNotFoundError(name)
        return "1.2"

    monkeypatch.setattr(writer, "version", version)
    tiny = write_tiny_sample(tmp_path, toy_body, frames=1)
    assert read_meta(tiny.folder)["versions"] == {
        "drapeline": __version__,
        "numpy": "1.2",
        "scipy": "1.2",
    }


def test_a_rejected_sample_says_why_and_holds_its_worst_frame_alone(tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body, status="rejected")
    names = {path.name for path in tiny.folder.rglob("*.*")}
    assert names == {"meta.json", "manifest.tsv", "worst_frame.npz"}
    assert read_meta(tiny.folder)["reason"].startswith("1.20 %")
    worst = read_worst_frame(tiny.folder)
    assert list(worst.garments) == ["Tshirt", "Skirt"]
    for name, (vertices, _, _) in worst.garments.items():
        np.testing.assert_array_equal(vertices, tiny.vertices[name][worst.frame])


def test_the_same_inputs_give_the_same_bytes(tmp_path, toy_body):
    folders = [
        write_tiny_sample(tmp_path / run, toy_body, frames=2).folder for run in ("one", "two")
    ]
    for path in folders[0].rglob("*.*"):
        name = path.relative_to(folders[0])
        assert path.read_bytes() == (folders[1] / name).read_bytes(), name


def test_one_frame_is_enough(tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body, frames=1)
    assert read_info(tiny.folder / "info.mat").poses.shape == (1, 72)


def test_a_cache_that_is_not_finite_is_named_with_its_frame(tmp_path, toy_body):
    tiny = write_stages(tmp_path, "00001")
    frames = tiny.vertices["Skirt"].copy()
    frames[4, 3, 1] = np.nan
    with point_cache_writer(tmp_path / "simulation/00001/Skirt.f32", frames.shape[1]) as cache:
        cache.append(frames)
    with pytest.raises(InputError, match=r"Skirt.f32: frame 4 holds NaN or infinity"):
        write(tiny, toy_body)
    assert not tiny.folder.exists()


def test_a_cache_of_another_length_is_named(tmp_path, toy_body):
    tiny = write_stages(tmp_path, "00001")
    with point_cache_writer(tmp_path / "simulation/00001/Skirt.f32", 80) as cache:
        cache.append(tiny.vertices["Skirt"][:4])
    with pytest.raises(InputError, match="4 frames of 80 vertices, expected 6"):
        write(tiny, toy_body)


def test_a_full_disk_leaves_nothing_that_looks_finished(tmp_path, toy_body, monkeypatch):
    tiny = write_stages(tmp_path, "00001")
    append = PointCacheWriter.append

    def append_until_full(self, frames):
        append(self, frames)
        if "Skirt" in str(self._path):
            raise OSError(errno.ENOSPC, "No space left on device", str(self._path))

    monkeypatch.setattr(PointCacheWriter, "append", append_until_full)
    with pytest.raises(InputError, match="No space left on device"):
        write(tiny, toy_body)
    assert not tiny.folder.exists()
    assert list(tiny.folder.parent.iterdir()) == []


def test_memory_does_not_grow_with_frames(tmp_path, toy_body):
    peaks = []
    for frames in (64, 512):
        tiny = write_stages(tmp_path / str(frames), "00001", frames=frames)
        tracemalloc.start()
        write(tiny, toy_body)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # 448 more frames of body vertices would be 4.6 MB in half precision; poses alone grow.
    assert peaks[1] - peaks[0] < 448 * 72 * 8 * 4


def test_health_is_summarised_per_measure_over_frames_and_garments():
    summary = summarise_health(
        {
            "inside_share": np.array([[0.0, 0.2], [0.1, 0.3]]),
            "self_hits": np.array([1, 2, 6], dtype=np.int32),
            "acceleration_m_s2": np.array([np.nan, 2.0, 4.0]),
            "garments": np.array(["Tshirt", "Skirt"]),
            "never_m": np.array([np.nan, np.nan]),
        }
    )
    assert list(summary) == ["inside_share", "self_hits", "acceleration_m_s2"]
    assert summary["self_hits"] == {"mean": 3.0, "min": 1.0, "max": 6.0}
    assert summary["inside_share"] == pytest.approx({"mean": 0.15, "min": 0.0, "max": 0.3})
    assert summary["acceleration_m_s2"]["mean"] == 3.0


def test_the_stored_body_is_that_of_a_saved_and_loaded_model(tmp_path, toy_body, tiny):
    save_npz(
        tmp_path / "body.npz",
        v_template=toy_body.v_template,
        shapedirs=toy_body.shapedirs,
        posedirs=toy_body.posedirs,
        J_regressor=toy_body.J_regressor,
        weights=toy_body.weights,
        kintree_table=np.stack([PARENTS, np.arange(24)]),
        f=toy_body.faces,
        segmentation=toy_body.segmentation,
    )
    record = load_npz(tiny.stages / "bodies/00001.npz", {"poses": "float n 72"})
    loaded = load_body(tmp_path / "body.npz")
    assert body_fingerprint(loaded) == read_meta(tiny.folder)["body"]["fingerprint"]
    points, _ = posed_vertices(loaded, tiny.shape, record["poses"])
    stored = PointCache(tiny.folder / "extras/Body.pc16").frames()
    assert np.abs(points - stored).max() < 5e-4


def test_a_reconstructed_garment_reads_as_a_sample_of_the_original(tmp_path, toy_body):
    rest = tube(0.25, -0.4, 0.05, 12, 5)
    frames = np.stack([rest.vertices, rest.vertices + [0.1, 0, 0]]).astype(np.float32)
    poses = np.repeat(REST_POSE[None], 2, 0)
    trans = np.array([[0, 0, 0.9], [0.2, 0, 0.9]])
    info = SampleInfo(
        poses=poses,
        trans=trans,
        shape=np.zeros(10),
        gender="female",
        outfit={"Skirt": {"texture": {"type": "color", "data": [0.4, 0.5, 0.7]}}},
    )
    mesh = Mesh(rest.vertices, triangulate(rest.faces))
    write_reconstruction(
        tmp_path / "Skirt", toy_body, info, [GarmentAnimation("Skirt", mesh, frames)]
    )
    with Sample(tmp_path / "Skirt") as sample:
        assert list(sample.garments) == ["Skirt"]
        np.testing.assert_allclose(sample.vertices("Skirt"), frames + trans[:, None], atol=1e-6)
        np.testing.assert_array_equal(sample.mesh("Skirt").faces, mesh.faces)
        body, _ = posed_vertices(toy_body, np.zeros(10), poses)
        np.testing.assert_allclose(sample.body_vertices(), body + trans[:, None], atol=1e-3)
