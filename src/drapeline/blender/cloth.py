"""Blender's cloth simulation of garments on a moving body, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy
import numpy as np

from drapeline.blender.fabric_units import ClothParameters
from drapeline.blender.scene import add_mesh, new_scene
from drapeline.frames import FPS

# Blender's cloth takes gravity times 0.001 as metres per squared frame, at any frame rate.
_GRAVITY_FACTOR = 1000 / FPS**2
_GRAVITY_M_S2 = 9.81


@dataclass(frozen=True)
class ClothPiece:
    """One garment as the solver sees it.

    Attributes:
        name: of the object.
        vertices: (V, 3) metres in frame 0.
        faces: (F, 4) or (F, 3) int32, outward.
        parameters: Blender's settings of its fabric on this mesh.
        pin: (V,) 0-1, how strongly a vertex follows `pin_cache`.
        shrink: (V,) 0-1, share by which rest lengths are shortened.
        pin_cache: `.pc2` of all vertices of which only the pinned ones count, or None.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    parameters: ClothParameters
    pin: np.ndarray
    shrink: np.ndarray
    pin_cache: Path | None = None


@dataclass(frozen=True)
class Solver:
    """How finely cloth is simulated.

    Attributes:
        steps: solver steps per frame.
        collision_steps: collision rounds per solver step.
        body_distance_m: distance at which cloth and body start to repel one another ...
        layer_distance_m: ... and cloth and the garment under it ...
        self_distance_m: ... and two parts of one garment.
        friction: Blender's friction of cloth on body and on cloth.
        pin_stiffness: Blender's stiffness of the springs that hold a waistband.
    """

    steps: int
    collision_steps: int = 2
    body_distance_m: float = 0.004
    layer_distance_m: float = 0.003
    self_distance_m: float = 0.002
    friction: float = 5.0
    pin_stiffness: float = 20.0


def simulate_cloth(
    pieces: Sequence[ClothPiece],
    body_vertices: np.ndarray,
    body_faces: np.ndarray,
    body_cache: Path,
    *,
    frames: int,
    solver: Solver,
) -> Iterator[list[np.ndarray]]:
    """Yield the vertices (V, 3) of every piece, frame after frame.

    Pieces go from inner to outer: each collides with the body and with all pieces before it, and
    with itself. Blender's point cache, which no setting turns off, remembers 36 bytes per vertex
    and frame: 100 MB for 9,000 vertices and 300 frames.

    Args:
        body_vertices: (B, 3) metres in frame 0.
        body_faces: (F, 3) outward.
        body_cache: `.pc2` of the body, one entry per frame.
        frames: frames to yield, the first being the state given.
    """
    scene = new_scene()
    scene.render.fps, scene.render.fps_base = FPS, 1.0
    scene.gravity = (0, 0, -_GRAVITY_M_S2 * _GRAVITY_FACTOR)
    scene.frame_start, scene.frame_end = 1, frames
    body = add_mesh("body", body_vertices, body_faces)
    _play(body, body_cache)
    _collide(body, solver.body_distance_m, solver.friction)
    colliders = bpy.data.collections.new("body")
    colliders.objects.link(body)
    cloths = []
    for piece in pieces:
        cloth = _add_cloth(piece, colliders, frames, solver)
        cloths.append(cloth)
        if len(cloths) < len(pieces):
            _collide(cloth, solver.layer_distance_m, solver.friction)
            inner = [*colliders.objects, cloth]
            colliders = bpy.data.collections.new(f"under {len(cloths)}")
            for thing in inner:
                colliders.objects.link(thing)
    scene.frame_set(1)
    for frame in range(1, frames + 1):
        scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        yield [_vertices(cloth.evaluated_get(graph)) for cloth in cloths]


def _play(thing: bpy.types.Object, cache: Path) -> None:
    """Let an object's vertices be read from a `.pc2`, entry by frame."""
    modifier = thing.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format = "PC2"
    modifier.filepath = str(cache)
    modifier.interpolation = "NONE"
    modifier.frame_start = 1


def _collide(thing: bpy.types.Object, distance_m: float, friction: float) -> None:
    thing.modifiers.new("collision", "COLLISION")
    settings = thing.collision
    settings.thickness_outer = distance_m
    settings.thickness_inner = 0.01
    settings.cloth_friction = friction
    settings.use_culling = True


def _add_cloth(
    piece: ClothPiece, colliders: bpy.types.Collection, frames: int, solver: Solver
) -> bpy.types.Object:
    thing = add_mesh(piece.name, piece.vertices, piece.faces)
    if piece.pin_cache is not None:
        _play(thing, piece.pin_cache)
    cloth = thing.modifiers.new("cloth", "CLOTH")
    settings = cloth.settings
    for name, value in asdict(piece.parameters).items():
        setattr(settings, name, value)
    settings.quality = solver.steps
    settings.bending_model = "ANGULAR"
    if piece.pin_cache is not None:
        settings.vertex_group_mass = _group(thing, "pin", piece.pin)
        settings.pin_stiffness = solver.pin_stiffness
    if piece.shrink.any():
        settings.vertex_group_shrink = _group(thing, "shrink", piece.shrink)
        settings.shrink_min, settings.shrink_max = 0.0, 1.0
    collision = cloth.collision_settings
    collision.collection = colliders
    collision.collision_quality = solver.collision_steps
    collision.distance_min = solver.body_distance_m
    collision.friction = solver.friction
    collision.use_self_collision = True
    collision.self_distance_min = solver.self_distance_m
    collision.self_friction = solver.friction
    cloth.point_cache.frame_start, cloth.point_cache.frame_end = 1, frames
    return thing


def _group(thing: bpy.types.Object, name: str, weights: np.ndarray) -> str:
    group = thing.vertex_groups.new(name=name)
    for vertex in np.flatnonzero(weights).tolist():
        group.add([vertex], float(weights[vertex]), "REPLACE")
    return group.name


def _vertices(thing: bpy.types.Object) -> np.ndarray:
    flat = np.zeros(3 * len(thing.data.vertices), dtype=np.float32)
    thing.data.vertices.foreach_get("co", flat)
    return flat.reshape(-1, 3)
