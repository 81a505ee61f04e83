"""The body that garments are made on: a shape in the rest pose, and how it moves to other poses."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import brentq

from drapeline.bodies.kinematics import axis_angle_to_matrix, joint_transforms
from drapeline.bodies.model import BodyModel, posed_vertices, shape_body
from drapeline.frames import GENDERS, REST_POSE

SHAPES = 10


DENSITY_KG_M3 = 1010.0  # of a person who has half breathed out
CORPULENCE = 1  # the coefficient that changes girth
_MOST_CORPULENCE = 9.0  # either way; four times what one in a hundred has
_CLOSE = 1e-6


def sample_shape(
    rng: np.random.Generator,
    body: BodyModel,
    shape_range: float,
    bmi_range: Sequence[float] | None = None,
) -> np.ndarray:
    """Random shape coefficients (10,).

    Args:
        shape_range: they are uniform within plus or minus this (3 in CLOTH3D 3.1).
        bmi_range: lowest and highest body mass index; its logarithm is uniform, and corpulence is
            set to it instead, beyond `shape_range` where it has to.
    """
    shape = rng.uniform(-shape_range, shape_range, SHAPES)
    if bmi_range is None:
        return shape
    wanted = np.exp(rng.uniform(*np.log(bmi_range)))
    return shape_of_bmi(body, shape, wanted)


def body_mass_index(body: BodyModel, shape: np.ndarray) -> float:
    """Mass over squared height, kg/m2, at `DENSITY_KG_M3`."""
    vertices, _ = shape_body(body, shape)
    a, b, c = (vertices[body.faces[:, i]].astype(np.float64) for i in range(3))
    volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
    return float(DENSITY_KG_M3 * volume / np.ptp(vertices[:, 1]) ** 2)


def shape_of_bmi(body: BodyModel, shape: np.ndarray, bmi: float) -> np.ndarray:
    """The shape (10,) with the corpulence that leads to a body mass index, or nearest to it."""
    found = np.array(shape, dtype=np.float64)

    def excess(corpulence: float) -> float:
        found[CORPULENCE] = corpulence
        return float(np.log(body_mass_index(body, found) / bmi))

    ends = (-_MOST_CORPULENCE, _MOST_CORPULENCE)
    low, high = (excess(end) for end in ends)
    if low * high > 0:
        found[CORPULENCE] = ends[int(abs(high) < abs(low))]
    else:
        found[CORPULENCE] = brentq(excess, *ends, xtol=_CLOSE)
    return found


def rest_body(body: BodyModel, shape: np.ndarray) -> np.ndarray:
    """Vertices (V, 3) float64 of a shape (10,) in `REST_POSE`, root-relative, Z up."""
    vertices, _ = posed_vertices(body, shape, REST_POSE[None].copy())
    return vertices[0].astype(np.float64)


def rest_basis(bodies: Mapping[str, BodyModel]) -> np.ndarray:
    """(2 * 11, V, 3) metres: `shape_basis` of each gender, one after the other."""
    return np.concatenate([shape_basis(bodies[gender]) for gender in GENDERS])


def shape_basis(body: BodyModel) -> np.ndarray:
    """(11, V, 3) metres: the rest body and its change per unit of each shape value.

    In a fixed pose, joints and vertices are affine in shape, so this is exact.
    """
    shapes = np.vstack([np.zeros(SHAPES), np.eye(SHAPES)])
    posed = [posed_vertices(body, shape, REST_POSE[None])[0][0] for shape in shapes]
    return np.stack([posed[0], *(one - posed[0] for one in posed[1:])])


def rest_to_pose(body: BodyModel, shape: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """(N, 24, 3, 4) float64 motions of the joints from `REST_POSE`, the root joint at the origin.

    Args:
        body: any SMPL-format body.
        shape: (10,).
        poses: (N, 72) axis-angle, rad.
    """
    _, joints = shape_body(body, shape)
    places = (joints - joints[0]).astype(np.float64)
    both = np.concatenate([REST_POSE[None], np.asarray(poses, dtype=np.float64)])
    rotations = axis_angle_to_matrix(both.reshape(-1, 24, 3))
    motions, _ = joint_transforms(places, rotations)
    rest, posed = motions[0], motions[1:]
    turn = posed[..., :3] @ rest[..., :3].swapaxes(-1, -2)
    shift = posed[..., 3] - (turn @ rest[..., 3:])[..., 0]
    return np.concatenate([turn, shift[..., None]], axis=-1)


def tightness_shape(shape: np.ndarray, tightness: np.ndarray, gender: str) -> np.ndarray:
    """Shape (10,) that a garment is made for (CLOTH3D 3.2): the wearer's, offset by the tightness.

    Args:
        shape: (10,) the wearer's.
        tightness: (2,) gamma, added to the first two coefficients; positive is tighter.
        gender: "female" or "male", which decides the sign of the first term.
    """
    target = np.array(shape, dtype=np.float64)
    target[:2] += signed_tightness(tightness, gender)
    return target


def signed_tightness(tightness: np.ndarray, gender: str) -> np.ndarray:
    """Gamma (2,) with the sign (-1)^(g + 1) on the first term, g = 0 female, 1 male."""
    return np.asarray(tightness, dtype=np.float64) * [-1.0 if gender == "female" else 1.0, 1.0]
