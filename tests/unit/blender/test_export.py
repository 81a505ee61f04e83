import errno
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from drapeline.blender.export import FORMATS, export_sample
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import to_y_up
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import vertex_normals
from drapeline.geometry.obj import load_obj
from drapeline.geometry.point_cache import PointCache
from toys.tiny_sample import write_tiny_sample

FRAMES = 5
COLOUR = [0.1, 0.5, 0.9]
# Blender's own importers at their default settings, in a process of their own: its glTF module
# never lets a process end.
IMPORT = """
import os, sys, traceback
import bpy, numpy as np

def vertices(thing):
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    points = np.zeros(len(mesh.vertices) * 3, dtype=np.float32)
    mesh.vertices.foreach_get("co", points)
    matrix = np.array(evaluated.matrix_world)
    evaluated.to_mesh_clear()
    return points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]

def principled(thing):
    nodes = [n for m in thing.data.materials if m.node_tree for n in m.node_tree.nodes]
    return next((n for n in nodes if n.bl_idname == "ShaderNodeBsdfPrincipled"), None)

def material_colour(thing):
    shader = principled(thing)
    return list(shader.inputs["Base Color"].default_value)[:3] if shader else []

def corner_colour(thing):
    if "colour" not in thing.data.attributes:
        return []
    return list(thing.data.attributes["colour"].data[0].color_srgb)[:3]

def pixel(thing, path):
    # In white light from everywhere that arrives without a detour and without gloss, a surface has
    # its own colour; "Standard" encodes it in sRGB as a screen takes it.
    scene = bpy.context.scene
    for other in bpy.data.objects:
        other.hide_render = other != thing
    principled(thing).inputs["Specular IOR Level"].default_value = 0
    scene.world = bpy.data.worlds.new("white")
    if scene.world.node_tree is None:
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    points = vertices(thing)
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    eye.data.type, eye.data.ortho_scale = "ORTHO", 0.05
    middle = (points.min(0) + points.max(0)) / 2
    eye.location = (middle[0], middle[1] - 5, middle[2])
    eye.rotation_euler = (1.5707963, 0, 0)
    scene.collection.objects.link(eye)
    scene.camera = eye
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.max_bounces = "CPU", 16, 0
    scene.cycles.use_denoising = False
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.view_settings.view_transform = "Standard"
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(path)
    return np.array(image.pixels[:]).reshape(-1, 4)[:, :3].mean(0)

def check(folder, frames, out):
    importers = {
        "usdc": bpy.ops.wm.usd_import, "abc": bpy.ops.wm.alembic_import,
        "glb": bpy.ops.import_scene.gltf,
    }
    found = {}
    for suffix, load in importers.items():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.context.scene.render.fps = 30
        load(filepath=f"{folder}/{suffix}/00001.{suffix}")
        scene = bpy.context.scene
        for thing in [t for t in bpy.data.objects if t.type == "MESH"]:
            found[f"{suffix}/{thing.name}/colour"] = material_colour(thing)
            found[f"{suffix}/{thing.name}/corner_colour"] = corner_colour(thing)
            found[f"{suffix}/{thing.name}/corners"] = [len(p.vertices) for p in thing.data.polygons]
            found[f"{suffix}/{thing.name}/uv"] = len(thing.data.uv_layers)
            for frame in range(frames):
                scene.frame_set(frame)
                found[f"{suffix}/{thing.name}/{frame}"] = vertices(thing)
            if suffix == "usdc":
                normals = np.zeros(len(thing.data.loops) * 3, dtype=np.float32)
                thing.data.corner_normals.foreach_get("vector", normals)
                found[f"usdc/{thing.name}/normals"] = normals.reshape(-1, 3)
                velocity = np.zeros(len(thing.data.vertices) * 3, dtype=np.float32)
                evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
                evaluated.data.attributes["velocity"].data.foreach_get("vector", velocity)
                found[f"usdc/{thing.name}/velocity"] = velocity.reshape(-1, 3)
        found[f"{suffix}/range"] = [scene.frame_start, scene.frame_end]
        if suffix != "abc":
            scene.frame_set(0)
            found[f"{suffix}/pixel"] = pixel(bpy.data.objects["Skirt"], f"{out}.{suffix}.png")
        # A scene of another frame rate tells by how much the file's times are stretched.
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.context.scene.render.fps = 60
        load(filepath=f"{folder}/{suffix}/00001.{suffix}")
        actions = [list(action.frame_range) for action in bpy.data.actions]
        scene = bpy.context.scene
        found[f"{suffix}/range_at_60"] = (
            actions[0] if actions else [scene.frame_start, scene.frame_end])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 30
    bpy.ops.import_scene.gltf(filepath=f"{folder}/rigged.glb")
    meshes = {t.data.name: t for t in bpy.data.objects if t.type == "MESH"}
    for frame in range(frames):
        bpy.context.scene.frame_set(frame)
        for name in ("Body", "Skirt"):
            found[f"rigged/{name}/{frame}"] = vertices(meshes[name])
    found["rigged/bones"] = [
        len(t.data.bones) for t in bpy.data.objects if t.type == "ARMATURE"]
    for suffix in ("pc2", "mdd"):
        for name in ("Body", "Skirt"):
            bpy.ops.wm.read_factory_settings(use_empty=True)
            bpy.ops.wm.obj_import(filepath=f"{folder}/{suffix}/{name}.obj")
            thing = bpy.data.objects[name]
            modifier = thing.modifiers.new("cache", "MESH_CACHE")
            modifier.cache_format = suffix.upper()
            modifier.filepath = f"{folder}/{suffix}/{name}.{suffix}"
            modifier.frame_start = 0
            for frame in range(frames):
                bpy.context.scene.frame_set(frame)
                found[f"{suffix}/{name}/{frame}"] = vertices(thing)
    np.savez(out, **found)

try:
    check(sys.argv[1], int(sys.argv[2]), sys.argv[3])
except BaseException:
    traceback.print_exc()
    sys.stderr.flush()
    os._exit(1)
os._exit(0)
"""


@pytest.fixture(scope="module")
def tiny(tmp_path_factory, toy_body):
    return write_tiny_sample(tmp_path_factory.mktemp("stages"), toy_body, frames=FRAMES)


@pytest.fixture(scope="module")
def exports(tiny, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    for file_format in FORMATS:
        export_sample(tiny.folder, folder / file_format, file_format)
    return folder


@pytest.fixture(scope="module")
def imported(exports, tiny, toy_body):
    with Sample(tiny.folder, bodies=dict.fromkeys(GENDERS, toy_body)) as sample:
        write_glb(exports / "rigged.glb", scene_parts(sample))
    out = exports / "imported.npz"
    command = [sys.executable, "-c", IMPORT, str(exports), str(FRAMES), str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    with np.load(out) as archive:
        return {name: archive[name] for name in archive.files}


@pytest.fixture(scope="module")
def truth(tiny):
    return {part.name: np.stack(list(part.frames())) for part in scene_parts(Sample(tiny.folder))}


@pytest.mark.parametrize("suffix", ["usdc", "abc"])
def test_usd_and_alembic_come_back_vertex_by_vertex(imported, truth, suffix):
    for name, frames in truth.items():
        for frame in range(FRAMES):
            points = imported[f"{suffix}/{name}/{frame}"]
            np.testing.assert_allclose(points, frames[frame], atol=1e-6)
    assert imported[f"{suffix}/range"].tolist() == [0, FRAMES - 1]


def test_gltf_comes_back_as_the_same_points_with_seams_doubled(imported, truth):
    for name, frames in truth.items():
        for frame in range(FRAMES):
            points = imported[f"glb/{name}/{frame}"]
            assert len(points) >= len(frames[frame])
            assert KDTree(frames[frame]).query(points)[0].max() < 7e-5
            assert KDTree(points).query(frames[frame])[0].max() < 7e-5


def test_bones_move_the_body_of_gltf_where_its_model_is_known(imported, truth):
    assert imported["rigged/bones"].tolist() == [24]
    for name, off in (("Body", 1.2e-3), ("Skirt", 7e-5)):
        for frame in range(FRAMES):
            points, expected = imported[f"rigged/{name}/{frame}"], truth[name][frame]
            assert KDTree(expected).query(points)[0].max() < off
            assert KDTree(points).query(expected)[0].max() < off


@pytest.mark.parametrize("suffix", ["usdc", "abc"])
def test_garments_stay_quads_with_texture_coordinates(imported, suffix):
    assert set(imported[f"{suffix}/Skirt/corners"].tolist()) == {4}
    assert imported[f"{suffix}/Skirt/uv"] == 1


@pytest.mark.parametrize("suffix", ["usdc", "glb"])
def test_a_rendered_pixel_has_the_colour_of_the_garment(imported, suffix):
    np.testing.assert_allclose(imported[f"{suffix}/pixel"], COLOUR, atol=2 / 255)
    linear = ((np.array(COLOUR) + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(imported[f"{suffix}/Skirt/colour"], linear, atol=1e-6)


def test_alembic_has_colours_at_corners(imported):
    np.testing.assert_allclose(imported["abc/Skirt/corner_colour"], COLOUR, atol=1 / 255)


@pytest.mark.parametrize("suffix", ["abc", "glb"])
def test_frames_are_a_thirtieth_of_a_second_apart(imported, suffix):
    np.testing.assert_allclose(imported[f"{suffix}/range_at_60"], [0, 2 * (FRAMES - 1)], atol=1e-4)


def test_usd_has_normals_and_velocities(imported, tiny, truth):
    for name, frames in truth.items():
        mesh = Sample(tiny.folder).body_mesh() if name == "Body" else tiny.meshes[name]
        normals = vertex_normals(frames[0], mesh.triangles)[mesh.faces.ravel()]
        np.testing.assert_allclose(imported[f"usdc/{name}/normals"], normals, atol=2e-3)
        last = (frames[-1] - frames[-2]) * 30
        np.testing.assert_allclose(imported[f"usdc/{name}/velocity"], last, atol=2e-3)


@pytest.mark.parametrize("suffix", ["pc2", "mdd"])
def test_caches_move_the_imported_meshes_as_simulated(imported, truth, suffix):
    for name in ("Body", "Skirt"):
        for frame in range(FRAMES):
            points = imported[f"{suffix}/{name}/{frame}"]
            np.testing.assert_allclose(points, truth[name][frame], atol=1e-5)


@pytest.mark.parametrize("suffix", ["pc2", "mdd"])
def test_caches_fit_the_meshes_beside_them(exports, tiny, truth, suffix):
    for name, frames in truth.items():
        mesh = load_obj(exports / suffix / f"{name}.obj")
        cache = PointCache(exports / suffix / f"{name}.{suffix}", len(mesh.vertices))
        np.testing.assert_array_equal(cache.frames(), to_y_up(frames))
    rest = load_obj(exports / suffix / "Skirt.obj")
    np.testing.assert_allclose(rest.vertices, to_y_up(tiny.meshes["Skirt"].vertices), atol=1e-6)
    np.testing.assert_array_equal(rest.uv_faces, tiny.meshes["Skirt"].uv_faces)


def test_the_obj_sequence_has_a_file_per_mesh_and_frame(exports, truth):
    for name, frames in truth.items():
        paths = sorted((exports / "obj" / name).iterdir())
        assert [path.name for path in paths] == [f"{name}_{f:04d}.obj" for f in range(FRAMES)]
        for path, points in zip(paths, frames, strict=True):
            np.testing.assert_allclose(load_obj(path).vertices, to_y_up(points), atol=1e-6)


def test_a_single_frame_can_be_exported(tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body, frames=1)
    for file_format in FORMATS:
        assert export_sample(tiny.folder, tmp_path / "out" / file_format, file_format)


def test_a_sample_without_a_body_is_exported_without_one(tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body, frames=2)
    (tiny.folder / "extras/Body.pc16").unlink()
    assert export_sample(tiny.folder, tmp_path / "out", "pc2") == (
        ["Skirt.obj", "Skirt.pc2", "Tshirt.obj", "Tshirt.pc2"]
    )
    with_body = export_sample(tiny.folder, tmp_path / "out", "pc2", bodies={"female": toy_body})
    assert "Body.pc2" in with_body


@pytest.mark.parametrize("suffix", ["usdc", "abc"])
def test_a_full_disk_is_one_sentence_where_a_library_would_die_of_it(
    tmp_path, tiny, monkeypatch, suffix
):
    def no_room(source, target):
        assert Path(source).stat().st_size
        raise OSError(errno.ENOSPC, "No space left on device", source, None, target)

    monkeypatch.setattr(shutil, "copyfile", no_room)
    with pytest.raises(InputError, match=f"{suffix}: cannot be written .No space left on device"):
        export_sample(tiny.folder, tmp_path / suffix, suffix)
    assert not list(tmp_path.iterdir())


def test_an_unknown_format_is_refused_with_the_known_ones(tmp_path, tiny):
    with pytest.raises(InputError, match="'fbx' is unknown, expected one of usdc, glb, abc"):
        export_sample(tiny.folder, tmp_path / "out", "fbx")
    assert not (tmp_path / "out").exists()


def test_a_rejected_sample_is_not_exported_and_its_reason_is_told(tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body, status="rejected")
    with pytest.raises(
        InputError, match=r"was rejected \(1.20 % of the vertices inside the body\)"
    ):
        export_sample(tiny.folder, tmp_path / "out", "usdc")
    assert not (tmp_path / "out").exists()
