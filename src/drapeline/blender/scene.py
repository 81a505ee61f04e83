"""Blender scenes and the meshes in them."""

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np


def add_mesh(
    name: str,
    vertices: np.ndarray,
    faces: np.ndarray,
    colour: Sequence[float] = (0.6, 0.6, 0.6),
    corner_uv: np.ndarray | None = None,
) -> bpy.types.Object:
    """Add a smooth-shaded mesh object, vertices (V, 3) metres, to the current scene.

    `corner_uv` (F, k, 2) are the texture coordinates of the corners of its faces.
    """
    data = bpy.data.meshes.new(name)
    count, size = faces.shape
    data.vertices.add(len(vertices))
    data.vertices.foreach_set("co", np.ascontiguousarray(vertices, dtype=np.float32).ravel())
    data.loops.add(count * size)
    data.loops.foreach_set("vertex_index", np.ascontiguousarray(faces, dtype=np.int32).ravel())
    data.polygons.add(count)
    data.polygons.foreach_set("loop_start", np.arange(0, count * size, size, dtype=np.int32))
    data.polygons.foreach_set("use_smooth", np.ones(count, dtype=bool))
    data.update(calc_edges=True)
    if corner_uv is not None:
        layer = data.uv_layers.new(name="UVMap")
        layer.uv.foreach_set("vector", np.ascontiguousarray(corner_uv, dtype=np.float32).ravel())
    thing = bpy.data.objects.new(name, data)
    thing.color = (*colour, 1.0)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_material(
    thing: bpy.types.Object,
    linear_colour: Sequence[float],
    *,
    roughness: float,
    texture: Path | None = None,
) -> None:
    """Give a mesh object a material of its name: linear RGB and roughness (1: chalk) in 0-1.

    A texture, on its texture coordinates, takes the place of the colour.
    """
    material = bpy.data.materials.new(thing.name)
    shader = shader_node(material, "ShaderNodeBsdfPrincipled")
    shader.inputs["Base Color"].default_value = (*linear_colour, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    if texture is not None:
        picture = material.node_tree.nodes.new("ShaderNodeTexImage")
        picture.image = bpy.data.images.load(str(texture))
        material.node_tree.links.new(picture.outputs["Color"], shader.inputs["Base Color"])
    thing.data.materials.append(material)


def shader_node(owner: bpy.types.Material | bpy.types.World, kind: str) -> bpy.types.Node:
    """The one node of a kind, such as "ShaderNodeBackground", of a new material or world."""
    if owner.node_tree is None:  # until Blender 5, which gives all of them their nodes
        owner.use_nodes = True
    (node,) = (node for node in owner.node_tree.nodes if node.bl_idname == kind)
    return node


def new_scene() -> bpy.types.Scene:
    """An empty Blender file with an empty scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene
