"""Motion capture in FBX as BVH, by Blender's importer: `python -m drapeline.blender.fbx IN OUT`.

In a process of its own, since Blender keeps all memory that it takes.
"""

import sys
from pathlib import Path

import bpy

from drapeline.errors import InputError
from drapeline.storage import copied_file

_STILL_RAD = 0.01


def convert_fbx(source: str | Path, target: str | Path) -> None:
    """Write the longest motion of an FBX file's skeletons as BVH, Z up.

    Args:
        source: `.fbx`, binary.
        target: `.bvh`.

    Raises:
        InputError: the file is damaged, has no skeleton that moves, or no rest pose.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="io_anim_bvh")
    try:
        bpy.ops.wm.fbx_import(filepath=str(source))
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1].removeprefix("Error: ")
        raise InputError(
            f"{source}: not readable as FBX ({reason}), expected a binary FBX"
        ) from error
    moving = [
        (thing.animation_data.action.frame_range, thing)
        for thing in bpy.data.objects
        if thing.type == "ARMATURE" and thing.animation_data and thing.animation_data.action
    ]
    if not moving:
        raise InputError(f"{source}: has no skeleton that moves, expected a motion")
    (start, end), skeleton = max(moving, key=lambda one: one[0][1] - one[0][0])
    if not _rest_is_known(skeleton, round(start)):
        raise InputError(
            f"{source}: has no bind pose, so that its first frame stands for the rest pose;"
            " expected it with its skin, or BVH"
        )
    bpy.context.view_layer.objects.active = skeleton
    with copied_file(target) as scratch:
        bpy.ops.export_anim.bvh(
            filepath=str(scratch),
            frame_start=round(start),
            frame_end=round(end),
            rotate_mode="ZYX",
            root_transform_only=True,
        )


def _rest_is_known(skeleton: bpy.types.Object, first: int) -> bool:
    """Whether the rest pose is that of a skin, or at least another one than the first frame's."""
    for thing in bpy.data.objects:
        if any(m.type == "ARMATURE" and m.object == skeleton for m in thing.modifiers):
            return True
    bpy.context.scene.frame_set(first)
    return any(bone.matrix_basis.to_quaternion().angle > _STILL_RAD for bone in skeleton.pose.bones)


def main() -> None:
    """Convert one file."""
    try:
        convert_fbx(*sys.argv[1:])
    except (InputError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
