"""Small procedural stand-ins for what takes long to make."""

from functools import cache
from pathlib import Path

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import KDTree
from skimage.measure import marching_cubes

from drapeline.bodies.model import BodyModel, save_body
from drapeline.frames import GENDERS, JOINT_NAMES, PARENTS
from drapeline.geometry.mesh import face_normals

# Joint positions of a 1.7 m person, left side (x > 0), SMPL frame; the pelvis is not at the origin.
_CENTRE = {
    "pelvis": (0, -0.20, 0.02),
    "spine1": (0, -0.09, 0.01),
    "spine2": (0, 0.04, 0.01),
    "spine3": (0, 0.10, 0.02),
    "neck": (0, 0.31, -0.01),
    "head": (0, 0.40, 0.03),
}
_LEFT = {
    "hip": (0.085, -0.29, 0.02),
    "knee": (0.085, -0.68, 0.02),
    "ankle": (0.085, -1.08, 0.00),
    "foot": (0.10, -1.13, 0.11),
    "collar": (0.06, 0.22, 0.00),
    "shoulder": (0.17, 0.23, 0.00),
    "elbow": (0.43, 0.23, 0.00),
    "wrist": (0.68, 0.23, 0.00),
    "hand": (0.76, 0.23, 0.00),
}
# Tapered capsules (joint, from, to, radius at each end): what each joint moves.
_CAPSULES = [
    ("pelvis", (0.0, -0.24, 0.01), (0.0, -0.14, 0.01), 0.13, 0.125),
    ("left_hip", (0.085, -0.30, 0.015), (0.085, -0.68, 0.015), 0.085, 0.055),
    ("left_knee", (0.085, -0.68, 0.015), (0.085, -1.08, 0.0), 0.055, 0.04),
    ("left_ankle", (0.085, -1.10, -0.01), (0.098, -1.12, 0.09), 0.04, 0.035),
    ("left_foot", (0.098, -1.12, 0.09), (0.10, -1.12, 0.15), 0.035, 0.03),
    ("spine1", (0.0, -0.10, 0.01), (0.0, 0.0, 0.01), 0.12, 0.12),
    ("spine2", (0.0, 0.0, 0.01), (0.0, 0.08, 0.01), 0.12, 0.125),
    ("spine3", (0.06, 0.10, 0.01), (0.06, 0.18, 0.0), 0.105, 0.09),
    ("neck", (0.0, 0.26, 0.0), (0.0, 0.40, 0.02), 0.055, 0.055),
    ("head", (0.0, 0.45, 0.04), (0.0, 0.50, 0.04), 0.09, 0.085),
    ("left_collar", (0.07, 0.22, 0.0), (0.15, 0.23, 0.0), 0.06, 0.055),
    ("left_shoulder", (0.17, 0.23, 0.0), (0.43, 0.23, 0.0), 0.052, 0.042),
    ("left_elbow", (0.43, 0.23, 0.0), (0.68, 0.23, 0.0), 0.042, 0.032),
    ("left_wrist", (0.68, 0.23, 0.0), (0.76, 0.23, 0.0), 0.034, 0.034),
    ("left_hand", (0.76, 0.23, 0.0), (0.83, 0.23, 0.0), 0.034, 0.03),
]


@cache
def toy_body(cell_m: float = 0.036) -> BodyModel:
    """A closed, manifold, exactly symmetric SMPL-format body of some 1,800 vertices.

    Shape 0 is overall size and shape 1 corpulence, larger values being larger bodies; the other
    eight change single proportions. Limbs are round, so clearances are easy to work out.
    """
    vertices, faces, mirror = _surface(cell_m)
    joints = _joints()
    weights = _weights(vertices, mirror)
    vt, ft = _planar_uv(vertices, faces)
    return BodyModel(
        v_template=vertices.astype(np.float32),
        shapedirs=_shapes(vertices, joints, weights).astype(np.float32),
        posedirs=np.zeros((len(vertices), 3, 207), dtype=np.float32),
        J_regressor=_regressor(vertices, joints, mirror).astype(np.float32),
        weights=weights.astype(np.float32),
        faces=faces.astype(np.int32),
        vt=vt,
        ft=ft,
        segmentation=weights.argmax(axis=1).astype(np.int32),
        name="toy-1",
    )


def save_toy_bodies(folder: Path) -> dict[str, Path]:
    """Files by gender, of the same body."""
    files = {gender: folder / f"{gender}.npz" for gender in GENDERS}
    for path in files.values():
        save_body(path, toy_body())
    return files


def mirror_joints() -> np.ndarray:
    """(24,) index of the joint on the other side."""
    swap = {"left": "right", "right": "left"}
    names = [
        "_".join([swap[n.split("_")[0]], n.split("_")[1]]) if "_" in n else n for n in JOINT_NAMES
    ]
    return np.array([JOINT_NAMES.index(n) for n in names])


def _joints() -> np.ndarray:
    joints = np.zeros((24, 3))
    for index, name in enumerate(JOINT_NAMES):
        if name in _CENTRE:
            joints[index] = _CENTRE[name]
        else:
            side, part = name.split("_")
            joints[index] = np.array(_LEFT[part]) * [1 if side == "left" else -1, 1, 1]
    return joints


def _capsule(points: np.ndarray, start, end, radius_start: float, radius_end: float) -> np.ndarray:
    """Signed distance (approximate for tapered ones) of points (..., 3)."""
    start, axis = np.array(start), np.subtract(end, start)
    along = np.clip((points - start) @ axis / (axis @ axis), 0, 1)
    nearest = start + along[..., None] * axis
    radius = radius_start + along * (radius_end - radius_start)
    return np.linalg.norm(points - nearest, axis=-1) - radius


def _distances(points: np.ndarray) -> np.ndarray:
    """(..., 24) distance to each joint's capsule; the right side's lie at mirrored places."""
    out = np.full((*points.shape[:-1], 24), 10.0)
    for name, start, end, a, b in _CAPSULES:
        centred = start[0] > 0 and not name.startswith("left")
        for side in (1, -1):
            joint = name if side == 1 else name.replace("left", "right")
            index = JOINT_NAMES.index(joint)
            if side == 1 or joint != name or centred:
                flip = np.array([side, 1, 1])
                value = _capsule(points * flip, start, end, a, b)
                out[..., index] = np.minimum(out[..., index], value)
    return out


def _surface(cell_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The left half's iso-surface and its mirror image, welded at x = 0; plus the mirror map."""
    sides = [(0.0, 0.92), (-1.22, 0.66), (-0.2, 0.26)]
    counts = [round((high - low) / cell_m) + 1 for low, high in sides]
    axes = [low + cell_m * np.arange(n) for (low, _), n in zip(sides, counts, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    blend = 0.012
    field = -blend * np.log(np.exp(-np.maximum(_distances(grid), -0.2) / blend).sum(-1))
    half, faces, _, _ = marching_cubes(field, 0.0, spacing=(cell_m,) * 3, allow_degenerate=False)
    half = half.astype(np.float64) + [low for low, _ in sides]
    seam = np.abs(half[:, 0]) < 1e-6
    half[seam, 0] = 0
    count = len(half)
    other = np.arange(count)
    other[~seam] = count + np.arange((~seam).sum())
    vertices = np.concatenate([half, half[~seam] * [-1, 1, 1]])
    mirror = np.arange(len(vertices))
    mirror[:count], mirror[other] = other, np.arange(count)
    faces = np.concatenate([faces, other[faces][:, ::-1]]).astype(np.int64)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    if np.einsum("fi,fi->", a, np.cross(b, c)) < 0:
        faces = faces[:, ::-1]
    return vertices, np.ascontiguousarray(faces), mirror


def _weights(vertices: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    near = np.exp(-np.maximum(_distances(vertices), 0.0) / 0.012)
    near[near < 1e-2 * near.max(axis=1, keepdims=True)] = 0
    weights = near / near.sum(axis=1, keepdims=True)
    return (weights + weights[mirror][:, mirror_joints()]) / 2


def _shapes(vertices: np.ndarray, joints: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(V, 3, 10): size, corpulence, then lengths and widths of single parts; all symmetric."""
    x, y, z = (vertices - joints[0]).T
    side = np.sign(x)
    arm = np.clip((np.abs(x) - 0.17) / 0.5, 0, None)
    leg = np.clip(-0.1 - y, 0, None)
    torso = np.exp(-((y / 0.25) ** 2)) * (np.abs(x) < 0.2)
    normal = vertices - weights @ _bone_middles(joints)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    zero = np.zeros_like(x)
    body = 1 - weights[:, [15, 22, 23, 10, 11]].sum(axis=1)
    return np.stack(
        [
            0.03 * np.stack([x, y, z], -1),
            0.008 * (body * (0.5 + torso))[:, None] * normal,
            np.stack([zero, -0.03 * leg, zero], -1),
            np.stack([0.02 * side * arm, zero, zero], -1),
            np.stack([0.01 * side * np.minimum(np.abs(x) / 0.17, 1), zero, zero], -1),
            np.stack([zero, zero, 0.05 * z * torso], -1),
            np.stack([0.03 * x * torso, zero, zero], -1),
            np.stack([zero, 0.02 * np.clip(y - 0.1, 0, None), zero], -1),
            np.stack([zero, zero, 0.004 * weights[:, 15]], -1),
            0.005 * weights[:, [1, 2]].sum(axis=1, keepdims=True) * normal * [1, 0, 1],
        ],
        axis=-1,
    )


def _bone_middles(joints: np.ndarray) -> np.ndarray:
    """(24, 3) middle of each joint and its first child."""
    child = {int(p): j for j, p in reversed(list(enumerate(PARENTS)))}
    return np.stack([(joints[j] + joints[child.get(j, j)]) / 2 for j in range(24)])


def _regressor(vertices: np.ndarray, joints: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """(24, V) sparse, positive, rows summing to one, mirror images of one another."""
    tree = KDTree(vertices)
    rows = np.zeros((24, len(vertices)))
    for joint, place in enumerate(joints):
        _, near = tree.query(place, 60)
        system = np.vstack([vertices[near].T - place[:, None], 0.1 * np.ones(60)])
        solution, _ = nnls(system, [0, 0, 0, 0.1])
        rows[joint, near] = solution / solution.sum()
    return (rows + rows[mirror_joints()][:, mirror]) / 2


def _planar_uv(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Front of the body in the left half of the square, back in the right half."""
    flat = (vertices[:, :2] - vertices[:, :2].min(axis=0)) / np.ptp(vertices[:, :2], axis=0).max()
    front = flat * [0.49, 0.98] + [0.005, 0.01]
    back = front + np.array([0.5, 0])
    is_back = face_normals(vertices, faces)[:, 2] < 0
    ft = faces + np.where(is_back, len(vertices), 0)[:, None]
    return np.concatenate([front, back]).astype(np.float32), ft.astype(np.int32)
