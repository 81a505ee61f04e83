"""Garments at rest moved by what a dynamic model has learned (CLOTH3D 4.2).

A model says how far each vertex of the body's topology moves off the garment at rest, before it is
skinned, given poses and the code of that garment. With the mean of the prior for a wrinkle code,
zero, this is what a garment most likely does in a pose. The field is read where the vertices of a
sheet lie on the garment's registration, so that the sheet may be of any mesh.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from drapeline.bodies.follow import pose_body
from drapeline.bodies.kinematics import skin_points
from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body, rest_to_pose
from drapeline.bodies.sequence import BodySequence, body_sequence_vertices
from drapeline.bodies.weight_transfer import nearest_weights
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, REST_POSE
from drapeline.generation.moving_sheets import SimulatedSheet, SolverDraper
from drapeline.geometry.closest import closest_points
from drapeline.geometry.collision import PenetrationResolver, resolve_penetration
from drapeline.geometry.mesh import Mesh, barycentric, faces_within
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.learning_data.dynamic import HISTORY_STEP
from drapeline.models.gcvae.codec import GarmentCodec, decode_codes
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.ppca import DynamicPpca
from drapeline.models.gcvae.vae import DynamicVae
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS, weight_reach_m
from drapeline.outfits.worn import GAP_M, DrapedSheet, push_over, stack_layers
from drapeline.registration.to_body.topology import topology_codes

# No garment covers these, so that registered bodies do not have them either.
_BARE = ("head", *(f"{side}_{part}" for side in ("left", "right") for part in ("hand", "foot")))
_POSE = 72
_OVER_M = 2 * GAP_M  # between layers, whose faces cut corners


class WornSheet(NamedTuple):
    """A garment on its wearer at rest, and what it is registered as."""

    rest: Mesh  # triangles as they are put on, root-relative metres
    sheet: Mesh  # the same as they hang
    # offsets, mask: (V, 3) metres and (V,) bool, of the vertices of the body's topology.
    offsets: np.ndarray
    mask: np.ndarray
    cvar: np.ndarray  # (13,) static conditions


def load_mover(folder: str | Path) -> GarmentCodec:
    """A model of garments in motion, from the folder of its training or fit.

    Raises:
        InputError: a file is missing or damaged, or the model is of another kind.
    """
    if not (Path(folder) / BEST).is_file():
        raise InputError(f"{folder}: no trained model, expected a folder such as wrinkle_mlp")
    model = load_codec(Path(folder) / BEST)
    if not isinstance(model, DynamicVae | DynamicPpca):
        raise InputError(
            f"{folder}: a model of garments at rest, expected one of garments in motion, such as"
            " wrinkle_mlp, dynamic_ppca or dvae_unposed_4"
        )
    if isinstance(model, DynamicVae) and model.settings.training.version != "unposed":
        raise InputError(
            f"{folder}: its offsets are {model.settings.training.version}, expected unposed ones,"
            " as of dvae_unposed_4"
        )
    return model


def hang_at_rest(
    meshes: Mapping[str, Mesh],
    body: BodyModel,
    gender: str,
    shape: np.ndarray,
    draper: SolverDraper | None,
) -> dict[str, DrapedSheet]:
    """Garment type -> cloth at rest as it is put on, and as it hangs on its wearer.

    Args:
        meshes: garment type -> triangles at rest, from the innermost to the outermost.
        shape: (10,) of the wearer.
        draper: lets them hang; without it, or where they do not stay on, layers are put on alone.
    """
    shape = np.asarray(shape, dtype=np.float64)
    if draper is not None:
        still, up = np.zeros(3), np.array([0.0, 0.0, 1.0])
        if draped := draper(meshes, body, gender, shape, REST_POSE, still, up):
            return draped
    worn = stack_layers(list(meshes.values()), pose_body(body, shape, REST_POSE, np.zeros(3)))
    return {name: DrapedSheet(one, one) for name, one in zip(meshes, worn, strict=True)}


def move_by_model(
    model: GarmentCodec,
    static: GarmentCodec,
    worn: Mapping[str, WornSheet],
    body: BodyModel,
    record: BodySequence,
    *,
    settle: bool,
    frames: slice = slice(None),
) -> dict[str, SimulatedSheet]:
    """Garments in frames of their wearer's motion, with the likeliest wrinkles.

    Args:
        model: see `load_mover`.
        static: the model of garments at rest whose codes it was trained with.
        worn: garment type -> what hangs on the wearer, from the innermost to the outermost.
        body: the whole body, of the wearer's gender.
        record: the wearer in motion.
        settle: whether garments are then smoothed and pushed out of the body and of what is worn
            beneath them, which the paper does not do.
        frames: that are made; poses before them are known all the same.

    Raises:
        InputError: the codes are of another size than those of the training.
    """
    conditions = len(static.body_template.cvar_mean)
    history = (len(model.body_template.cvar_mean) - conditions - static.latent) / _POSE
    if history not in (1, 2, 3, 4):
        raise InputError(
            f"a model of garments at rest with codes of {static.latent} numbers, expected the one"
            " that the model of garments in motion was trained with"
        )
    poses = _histories(record.poses, int(history))[frames]
    motions = rest_to_pose(body, record.shape, record.poses[frames])
    bodies = body_sequence_vertices(body, record)[frames]
    moved: dict[str, SimulatedSheet] = {}
    for (name, one), code in zip(worn.items(), _codes(static, worn), strict=True):
        before, after = (part[None].repeat(len(poses), 0) for part in (one.cvar, code))
        cvar = np.concatenate([before, poses, after], axis=1)
        wrinkles = np.zeros((len(poses), model.latent), dtype=np.float32)
        topology = topology_codes(np.full(len(poses), GARMENTS.index(name)))
        fields = (offsets for offsets, _ in decode_codes(model, wrinkles, cvar, topology))
        corners, shares = _places(one, static.body_template.rest_body(one.cvar), static, name)
        change = np.stack([np.einsum("mki,mk->mi", field[corners], shares) for field in fields])
        weights = _weights(name, one.sheet, body, record.shape)
        points = skin_points(one.sheet.vertices + change, motions, weights).astype(np.float32)
        if settle:
            points = _pushed_out(points, one.sheet.faces, bodies, body.faces)
            points = _over(points, one.sheet.faces, list(moved.values()))
        made = [Mesh(places, one.sheet.faces) for places in points]
        moved[name] = SimulatedSheet(one.rest, made)
    return moved


def _histories(poses: np.ndarray, count: int) -> np.ndarray:
    """(F, 72 count) float32 poses of each frame and of those before it, as in training."""
    back = np.arange(len(poses))[:, None] - HISTORY_STEP * np.arange(count)
    return poses[np.maximum(back, 0)].reshape(len(poses), -1).astype(np.float32)


def _codes(static: GarmentCodec, worn: Mapping[str, WornSheet]) -> np.ndarray:
    """(G, Z) codes of garments at rest."""
    index = np.array([GARMENTS.index(name) for name in worn])
    batch = {
        "offsets": np.stack([one.offsets for one in worn.values()]).astype(np.float32),
        "mask": np.stack([one.mask for one in worn.values()]),
        "cvar": np.stack([one.cvar for one in worn.values()]),
        "topology": topology_codes(index),
    }
    return static.encode(
        {key: torch.from_numpy(value) for key, value in batch.items()}
    ).mean.numpy()


def _places(
    worn: WornSheet, rest: np.ndarray, static: GarmentCodec, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Where vertices of a sheet are on its registration: corners (M, 3) and their shares (M, 3)."""
    surface = (rest + worn.offsets).astype(np.float32)
    faces = faces_within(static.body_template.faces_of(name), worn.mask)
    place, face = closest_points(worn.sheet.vertices, surface, faces)
    return faces[face], barycentric(place, surface[faces[face]])


def _weights(name: str, sheet: Mesh, body: BodyModel, shape: np.ndarray) -> np.ndarray:
    """(M, 24) skinning weights, as registered garments have them."""
    bare = np.isin(body.segmentation, [JOINT_NAMES.index(joint) for joint in _BARE])
    faces = body.faces[~bare[body.faces].any(axis=1)]
    used, corners = np.unique(faces, return_inverse=True)
    there = rest_body(body, shape)[used]
    corners = corners.reshape(faces.shape)
    return nearest_weights(
        sheet.vertices,
        sheet.faces,
        there,
        corners,
        body.weights[used],
        reach_m=weight_reach_m(name),
    )


def _pushed_out(
    points: np.ndarray, faces: np.ndarray, bodies: np.ndarray, body_faces: np.ndarray
) -> np.ndarray:
    """Frames (F, M, 3) of a garment, smoothed and out of the body's (F, B, 3)."""
    out = resolve_penetration(points, faces, bodies, body_faces)
    resolver = PenetrationResolver(bodies[0], body_faces)
    for frame, surface in enumerate(bodies):
        resolver.move(surface)
        out[frame] = resolver.push_faces_out(out[frame], faces)
    return out


def _over(points: np.ndarray, faces: np.ndarray, inner: Sequence[SimulatedSheet]) -> np.ndarray:
    """Frames (F, M, 3) of a garment, over those that are worn beneath it."""
    average = averaging_matrix(faces, points.shape[1])
    out = points.copy()
    for sheet in inner:
        for frame, below in enumerate(sheet.frames):
            out[frame] = push_over(out[frame], average, below, gap_m=_OVER_M)
    return out
