"""Motion capture in FBX beside the same in BVH; Blender writes each file in its own process."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.motions.importing import frame_count, import_motion

JUMP = Path(__file__).parents[3] / "examples/data/jump.bvh"
WRITE = """
import sys
import bpy
bvh, fbx, skin = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
for name in ("io_anim_bvh", "io_scene_fbx"):
    bpy.ops.preferences.addon_enable(module=name)
bpy.ops.import_anim.bvh(filepath=bvh, update_scene_duration=True, update_scene_fps=True)
(skeleton,) = bpy.data.objects
if skin == "skin":
    bones = skeleton.data.bones
    corners = [(b.head_local, b.tail_local, b.tail_local + b.vector.orthogonal()) for b in bones]
    triangles = [(3 * k, 3 * k + 1, 3 * k + 2) for k in range(len(bones))]
    mesh = bpy.data.meshes.new("skin")
    mesh.from_pydata([tuple(point) for three in corners for point in three], [], triangles)
    thing = bpy.data.objects.new("skin", mesh)
    bpy.context.scene.collection.objects.link(thing)
    thing.parent = skeleton
    for triangle, bone in zip(triangles, bones):
        thing.vertex_groups.new(name=bone.name).add(triangle, 1, "REPLACE")
    thing.modifiers.new("bones", "ARMATURE").object = skeleton
if skin == "nothing":
    skeleton.animation_data_clear()
bpy.ops.export_scene.fbx(filepath=fbx, object_types={"ARMATURE", "MESH"}, add_leaf_bones=False)
"""


@pytest.fixture
def fbx(tmp_path):
    """fbx(kind) -> an FBX file with the motion of `JUMP`."""

    def write(kind):
        path = tmp_path / "jump.fbx"
        command = [sys.executable, "-c", WRITE, str(JUMP), str(path), kind]
        subprocess.run(command, check=True, capture_output=True)
        return path

    return write


def test_an_fbx_with_its_skin_is_the_same_motion(fbx):
    path = fbx("skin")
    motion, wanted = import_motion(path), import_motion(JUMP)
    assert frame_count(path) == len(motion) == len(wanted)
    assert (motion.source, motion.sequence) == ("jump.fbx", "jump")
    np.testing.assert_allclose(motion.poses, wanted.poses, atol=0.01)
    np.testing.assert_allclose(motion.trans, wanted.trans, atol=0.005)


def test_an_fbx_whose_first_frame_stands_for_its_rest_pose_is_refused(fbx):
    with pytest.raises(InputError, match=r"jump\.fbx: has no bind pose.*expected it with its skin"):
        import_motion(fbx("bones"))


def test_an_fbx_without_motion_and_one_that_is_none_are_refused(fbx, tmp_path):
    with pytest.raises(InputError, match="has no skeleton that moves"):
        import_motion(fbx("nothing"))
    (tmp_path / "a.fbx").write_bytes(b"Kaydara FBX Binary, or not")
    with pytest.raises(InputError, match=r"a\.fbx"):
        import_motion(tmp_path / "a.fbx")


def test_without_blender_fbx_is_refused_by_the_packages_name(tmp_path, monkeypatch):
    (tmp_path / "a.fbx").touch()
    (tmp_path / "bpy.py").write_text("raise ModuleNotFoundError(\"No module named 'bpy'\")")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    with pytest.raises(InputError, match="FBX needs Blender, the package bpy"):
        import_motion(tmp_path / "a.fbx")
