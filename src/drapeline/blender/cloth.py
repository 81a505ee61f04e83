"""Blender's cloth simulation of garments on a moving body, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import bpy
import numpy as np

from drapeline.blender.fabric_units import cloth_parameters
from drapeline.blender.scene import add_mesh, new_scene
from drapeline.frames import FPS
from drapeline.geometry.point_cache import point_cache_writer, write_point_cache
from drapeline.simulation.collider import MovingBody
from drapeline.simulation.solver import Attempt, ClothGarment

# Blender's cloth takes gravity times 0.001 as metres per squared frame, at any frame rate.
_GRAVITY_FACTOR = 1000 / FPS**2
_GRAVITY_M_S2 = 9.81
_FLOOR = 50.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])  # its corners, metres


@dataclass(frozen=True)
class BlenderCloth:
    """Blender's cloth modifier as a `ClothSolver`.

    Garments go from inner to outer: each collides with the body and with all garments before it,
    and with itself; the outer does not push the inner. Blender's point cache, which no setting
    turns off, remembers 36 bytes per vertex and frame: 100 MB for 9,000 vertices and 300 frames.

    Attributes:
        collision_steps: collision rounds per step.
        self_distance_m: distance at which two parts of a garment start to repel one another.
        friction: Blender's friction of cloth on body and on cloth.
        pin_weight: share of a pin's weight that Blender is told, so that waistbands give a little.
        pin_stiffness: Blender's stiffness of the springs that hold a pin of less weight than 1.
    """

    name: ClassVar[str] = "blender"

    collision_steps: int = 2
    self_distance_m: float = 0.002
    friction: float = 5.0
    pin_weight: float = 0.9
    pin_stiffness: float = 20.0

    @property
    def settings(self) -> dict[str, Any]:
        """All of the above."""
        return asdict(self)

    def versions(self) -> dict[str, str]:
        """Blender's version."""
        return {"bpy": bpy.app.version_string}

    def simulate(
        self, garments: Sequence[ClothGarment], body: MovingBody, attempt: Attempt, scratch: Path
    ) -> Iterator[list[np.ndarray]]:
        """Yield the vertices (V, 3) of every garment for each frame; see `ClothSolver`."""
        frames = len(body)
        scene = new_scene()
        scene.render.fps, scene.render.fps_base = FPS, 1.0
        scene.gravity = (0, 0, -_GRAVITY_M_S2 * _GRAVITY_FACTOR)
        scene.frame_start, scene.frame_end = 1, frames
        wearer = self._add_collider("body", body, body.faces, attempt, scratch)
        colliders = bpy.data.collections.new("body")
        colliders.objects.link(wearer)
        if body.floor_m is not None:
            squares = [(_FLOOR + [0, 0, height]).astype(np.float32) for height in body.floor_m]
            quad = np.arange(4)[None]
            colliders.objects.link(self._add_collider("floor", squares, quad, attempt, scratch))
        cloths = []
        for garment in garments:
            cloth = self._add_cloth(garment, frames, attempt, scratch)
            cloth.modifiers["cloth"].collision_settings.collection = colliders
            cloths.append(cloth)
            if len(cloths) < len(garments):
                self._collide(cloth, attempt)
                inner = [*colliders.objects, cloth]
                colliders = bpy.data.collections.new(f"under {len(cloths)}")
                for thing in inner:
                    colliders.objects.link(thing)
        scene.frame_set(1)
        for frame in range(1, frames + 1):
            scene.frame_set(frame)
            graph = bpy.context.evaluated_depsgraph_get()
            yield [_vertices(cloth.evaluated_get(graph)) for cloth in cloths]

    def _add_collider(
        self,
        name: str,
        frames: MovingBody | Sequence[np.ndarray],
        faces: np.ndarray,
        attempt: Attempt,
        scratch: Path,
    ) -> bpy.types.Object:
        cache = scratch / f"{name}.pc2"
        write_point_cache(cache, frames)
        thing = add_mesh(name, next(iter(frames)), faces)
        _play(thing, cache)
        self._collide(thing, attempt)
        return thing

    def _collide(self, thing: bpy.types.Object, attempt: Attempt) -> None:
        """Let cloth collide with an object."""
        thing.modifiers.new("collision", "COLLISION")
        settings = thing.collision
        settings.thickness_outer = _half_gap_m(attempt)
        settings.thickness_inner = 0.01
        settings.cloth_friction = self.friction
        settings.use_culling = True

    def _add_cloth(
        self, garment: ClothGarment, frames: int, attempt: Attempt, scratch: Path
    ) -> bpy.types.Object:
        thing = add_mesh(garment.name, garment.vertices, garment.faces)
        held = len(garment.pins.vertices) > 0
        if held:
            # The cache plays under the cloth, which takes from it where its pins are.
            _play(thing, _write_pins(garment, frames, scratch))
        cloth = thing.modifiers.new("cloth", "CLOTH")
        settings = cloth.settings
        parameters = cloth_parameters(garment.fabric, garment.edge_length_m)
        for name, value in asdict(parameters).items():
            setattr(settings, name, value)
        settings.quality = attempt.steps
        settings.bending_model = "ANGULAR"
        most = float(garment.stiffness.max())
        if most > 1:
            settings.vertex_group_bending = _group(
                thing, "band", (garment.stiffness - 1) / (most - 1)
            )
            settings.bending_stiffness_max = most * parameters.bending_stiffness
        if held:
            weights = np.zeros(len(garment.vertices), dtype=np.float32)
            weights[garment.pins.vertices] = self.pin_weight * garment.pins.weights
            settings.vertex_group_mass = _group(thing, "pin", weights)
            settings.pin_stiffness = self.pin_stiffness
        if garment.shrink.any():
            settings.vertex_group_shrink = _group(thing, "shrink", garment.shrink)
            settings.shrink_min, settings.shrink_max = 0.0, 1.0
        collision = cloth.collision_settings
        collision.collision_quality = self.collision_steps
        collision.distance_min = _half_gap_m(attempt)
        collision.friction = self.friction
        collision.use_self_collision = True
        collision.self_distance_min = self.self_distance_m
        collision.self_friction = self.friction
        cloth.point_cache.frame_start, cloth.point_cache.frame_end = 1, frames
        return thing


def _half_gap_m(attempt: Attempt) -> float:
    """Blender keeps cloth at its own distance plus the collider's: each gets half of the gap."""
    return attempt.gap_m / 2


def _play(thing: bpy.types.Object, cache: Path) -> None:
    """Let an object's vertices be read from a `.pc2`, entry by frame."""
    modifier = thing.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format = "PC2"
    modifier.filepath = str(cache)
    modifier.interpolation = "NONE"
    modifier.frame_start = 1


def _write_pins(garment: ClothGarment, frames: int, scratch: Path) -> Path:
    """Write a `.pc2` of all vertices of a garment, of which only the held ones count."""
    path = scratch / f"{garment.name}.pc2"
    with point_cache_writer(path, len(garment.vertices)) as writer:
        for frame in range(frames):
            place = garment.vertices.copy()
            place[garment.pins.vertices] = garment.pins.positions(frame)
            writer.append(place)
    return path


def _group(thing: bpy.types.Object, name: str, weights: np.ndarray) -> str:
    group = thing.vertex_groups.new(name=name)
    for vertex in np.flatnonzero(weights).tolist():
        group.add([vertex], float(weights[vertex]), "REPLACE")
    return group.name


def _vertices(thing: bpy.types.Object) -> np.ndarray:
    flat = np.zeros(3 * len(thing.data.vertices), dtype=np.float32)
    thing.data.vertices.foreach_get("co", flat)
    return flat.reshape(-1, 3)
