"""Bake Anny, a free parametric body, into the SMPL format: one file per gender.

Anny (Apache-2.0, data CC0) describes a person by phenotypes and poses it by a rig of a hundred
bones. Adults are drawn from its calibrated population, put in SMPL's T-pose with its own rig, and
summarised by ten linear shape directions; the rig is folded onto SMPL's 24 joints.

`make bodies` runs this module, which writes the bodies that come with drapeline.
"""

from dataclasses import dataclass

import anny
import numpy as np
import torch
from anny.face_segmentation import get_face_segmentation_mask
from anny.paths import get_anny_cache_path
from anny.shape_distribution import SimpleShapeDistribution
from scipy.optimize import nnls
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from drapeline.bodies.model import FREE_BODY_VERSION, BodyModel, free_body, save_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS, JOINT_NAMES
from drapeline.geometry.mesh import boundary_loops, edges
from drapeline.seeding import rng_for

CAVITIES = ("eye_cavity.L", "eye_cavity.R", "mouth_cavity")
SOCKETS = CAVITIES[:2]


@dataclass(frozen=True)
class ClosedSurface:
    """A closed triangle mesh whose vertices are fixed mixtures of Anny's."""

    mixture: csr_matrix  # (V, A) sparse rows that sum to one; A is Anny's vertex count
    faces: np.ndarray  # (F, 3) int32
    # vt, ft: (T, 2) float32 and (F, 3) int32 texture coordinates.
    vt: np.ndarray
    ft: np.ndarray
    mirror: np.ndarray  # (V,) int64, the vertex at the mirrored place


def closed_surface(
    template: np.ndarray,
    faces: np.ndarray,
    vt: np.ndarray,
    ft: np.ndarray,
    cavities: dict[str, np.ndarray],
) -> ClosedSurface:
    """Drop inner parts and cover the eye sockets and the mouth.

    Inner surfaces are never seen, yet they can be the nearest surface to cloth, and they make
    inside and outside ambiguous.

    Args:
        template: (A, 3) Anny's vertices, Z up, facing -Y.
        faces: (F, 3) triangles.
        vt, ft: texture coordinates.
        cavities: (F,) bool per name of `CAVITIES`, the faces inside it.
    """
    part = _components(faces, len(template))
    skin = part == np.bincount(part).argmax()
    hollow = np.any([cavities[name] for name in CAVITIES], axis=0)
    outside = skin[faces].all(axis=1) & ~hollow
    kept_faces, kept_ft = faces[outside], ft[outside]
    vertex_vt = np.zeros((len(template), 2))
    vertex_vt[kept_faces] = vt[kept_ft]

    rows: list[dict[int, float]] = []
    cap_faces, new_vt = [], []
    for name in CAVITIES:
        loop = _loop_around(kept_faces, faces[cavities[name]])
        middle = dict.fromkeys(loop.tolist(), 1 / len(loop))
        if name in SOCKETS:
            middle = {_front_of_eyeball(template, part, template[loop].mean(axis=0)): 1.0}
        centre_vt = vertex_vt[loop].mean(axis=0)
        ring = len(template) + len(rows) + np.arange(len(loop))
        for vertex in loop.tolist():
            rows.append({v: 0.6 * w for v, w in middle.items()})
            rows[-1][vertex] = rows[-1].get(vertex, 0.0) + 0.4
            new_vt.append(0.4 * vertex_vt[vertex] + 0.6 * centre_vt)
        rows.append(middle)
        new_vt.append(centre_vt)
        cap_faces.append(_cap(loop, ring, ring[-1] + 1))
    caps = np.concatenate(cap_faces)
    caps_ft = _cap_texture(caps, kept_faces, kept_ft, len(template), len(vt))

    all_faces = np.concatenate([kept_faces, caps])
    all_ft = np.concatenate([kept_ft, caps_ft])
    mixture = _mixture(rows, len(template))
    used, new_faces = np.unique(all_faces, return_inverse=True)
    used_vt, new_ft = np.unique(all_ft, return_inverse=True)
    mixture = mixture[used]
    return ClosedSurface(
        mixture,
        new_faces.reshape(-1, 3).astype(np.int32),
        np.concatenate([vt, new_vt])[used_vt].astype(np.float32),
        new_ft.reshape(-1, 3).astype(np.int32),
        mirror_map(mixture @ template, axis=0),
    )


def mirror_map(vertices: np.ndarray, axis: int) -> np.ndarray:
    """(V,) index of each vertex's mirror image across the plane where `axis` is zero.

    Raises:
        ValueError: the vertices are not symmetric to a tenth of a millimetre.
    """
    flip = np.ones(3)
    flip[axis] = -1
    distance, mirror = KDTree(vertices).query(vertices * flip)
    if distance.max() > 1e-4 or not np.array_equal(mirror[mirror], np.arange(len(mirror))):
        raise ValueError(f"the mesh is not symmetric: {distance.max():.2e} m")
    return mirror


def _components(faces: np.ndarray, count: int) -> np.ndarray:
    a, b = edges(faces).T
    return connected_components(coo_matrix((np.ones(len(a)), (a, b)), shape=(count, count)))[1]


def _loop_around(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """The boundary loop of the outer faces that the inner faces filled."""
    inside = np.unique(inner)
    return next(loop for loop in boundary_loops(outer) if np.isin(loop, inside).all())


def _front_of_eyeball(template: np.ndarray, part: np.ndarray, socket: np.ndarray) -> int:
    """The foremost vertex of the eyeball that lies in a socket."""
    sizes = np.bincount(part)
    small = [p for p in range(len(sizes)) if sizes[p] < sizes.max()]
    centres = np.array([template[part == p].mean(axis=0) for p in small])
    eyeball = small[int(np.linalg.norm(centres - socket, axis=1).argmin())]
    members = np.flatnonzero(part == eyeball)
    return int(members[template[members, 1].argmin()])


def _cap(loop: np.ndarray, ring: np.ndarray, centre: int) -> np.ndarray:
    """Triangles from a loop to a ring to a centre; the loop runs as its outer faces' edges do."""
    after, ring_after = np.roll(loop, -1), np.roll(ring, -1)
    middle = np.full_like(ring, centre)
    return np.concatenate(
        [
            np.stack([after, loop, ring], -1),
            np.stack([after, ring, ring_after], -1),
            np.stack([ring_after, ring, middle], -1),
        ]
    )


def _cap_texture(
    caps: np.ndarray, faces: np.ndarray, ft: np.ndarray, count: int, vt_count: int
) -> np.ndarray:
    """Texture corners of the caps: the skin's own on the loop, new ones within."""
    corner = np.zeros(count, dtype=np.int64)
    corner[faces] = ft
    return np.where(caps < count, corner[np.minimum(caps, count - 1)], caps - count + vt_count)


def _mixture(rows: list[dict[int, float]], count: int) -> csr_matrix:
    entries = [(count + i, v, w) for i, row in enumerate(rows) for v, w in row.items()]
    i, j, value = (np.array(column) for column in zip(*entries, strict=True))
    same = np.arange(count)
    return coo_matrix(
        (np.concatenate([np.ones(count), value]), (np.append(same, i), np.append(same, j))),
        shape=(count + len(rows), count),
    ).tocsr()


POPULATION = 600
LICENCE = "Apache-2.0 (Anny's code), CC0-1.0 (Anny's data)"
COMPONENTS = 10
ADULT_YEARS = (20.0, 65.0)
# Anny's spread of its traits is close to uniform over all it can model, so that three standard
# deviations reach far beyond: skeletons and giants. Each trait is therefore drawn with a share
# of that spread, and moved a little, such that all coefficients in [-3, 3] give plausible people
# with statures of about 1.45 to 2.05 m.
TRAITS = {  # share of the spread, shift; of traits that run from 0 to 1
    "height": (0.85, 0.04),
    "weight": (0.75, 0.05),
    "muscle": (0.65, 0.05),
    "proportions": (0.6, 0.05),
}
Z_UP_TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # facing -Y to facing +Z

# Anny bone whose head is the joint; right sides by mirroring.
JOINT_BONES = {
    "pelvis": "root",
    "spine1": "spine03",
    "spine2": "spine02",
    "spine3": "spine01",
    "neck": "neck01",
    "head": "head",
    "left_hip": "upperleg01.L",
    "left_knee": "lowerleg01.L",
    "left_ankle": "foot.L",
    "left_foot": "toe2-1.L",
    "left_collar": "clavicle.L",
    "left_shoulder": "upperarm01.L",
    "left_elbow": "lowerarm01.L",
    "left_wrist": "wrist.L",
    "left_hand": "finger3-1.L",
}
# Which joint moves a bone's skin, by the beginning of the bone's name.
BONE_JOINTS = {
    "root": "pelvis",
    "pelvis": "pelvis",
    "spine05": "pelvis",
    "spine04": "pelvis",
    "spine03": "spine1",
    "spine02": "spine2",
    "spine01": "spine3",
    "neck": "neck",
    "head": "head",
    "eye": "head",
    "upperleg": "hip",
    "lowerleg": "knee",
    "foot": "ankle",
    "toe": "foot",
    "clavicle": "collar",
    "shoulder01": "collar",
    "upperarm": "shoulder",
    "lowerarm": "elbow",
    "wrist": "wrist",
    "metacarpal": "wrist",
    "finger": "hand",
}
# Share of a limb's twist about its own axis that a bone takes; the rest of the limb takes all.
TWIST_SHARE = {"upperarm01": 0.5, "lowerarm01": 0.15, "lowerarm02": 0.6}


def bake_bodies(seed: int, samples: int) -> dict[str, BodyModel]:
    """Bake both genders.

    Args:
        seed: of the population that is drawn.
        samples: people drawn per gender; 200 settle the directions to a few percent.

    Returns:
        Female and male body. Shape coefficients have unit variance over the population. The
        first carries all of stature, with the signs of CLOTH3D's rule: positive values are
        larger women and smaller men (like SMPL's). The second is corpulence, positive values
        being thinner. A positive tightness thus makes smaller garments for both genders.

    Raises:
        InputError: Anny's cache is damaged or cannot be made.
    """
    model = _load_anny()
    surface = _surface(model)
    weights = _joint_weights(model, surface)
    bodies = {}
    for code, gender in enumerate(GENDERS):
        rest, heads = _population(rng_for(seed, "bake", gender), model, code, samples)
        vertices, joints = _t_pose(model, rest, heads)
        vertices = _symmetric(np.stack([surface.mixture @ v for v in vertices]), surface.mirror)
        joints = _symmetric(joints, _mirror_joints())
        larger = 1.0 if gender == "female" else -1.0
        mean, directions, joint_mean, joint_directions = _shape_space(
            vertices, joints, surface.faces, larger
        )
        regressor = _regressor(
            mean, directions, joint_mean, joint_directions, weights, surface.mirror
        )
        bodies[gender] = BodyModel(
            v_template=mean.astype(np.float32),
            shapedirs=directions.astype(np.float32),
            posedirs=np.zeros((len(mean), 3, 207), dtype=np.float32),
            J_regressor=regressor.astype(np.float32),
            weights=weights.astype(np.float32),
            faces=surface.faces,
            vt=surface.vt,
            ft=surface.ft,
            segmentation=weights.argmax(axis=1).astype(np.int32),
            name=f"drapeline-anny-{gender}-{FREE_BODY_VERSION}",
        )
    return bodies


def _load_anny() -> anny.Anny:
    """Anny's model, from the cache that its first use on a machine makes.

    Raises:
        InputError: names the cache if Anny cannot use it, as after a job that was killed.
    """
    cache = get_anny_cache_path()
    try:
        return anny.Anny()
    except MemoryError:
        raise
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"{cache}: Anny's model cannot be loaded from its cache or made there ({reason}),"
            " expected a whole cache in a writable folder with 1 GB free; delete it to have it made"
            " again, or set ANNY_CACHE_DIR to another place"
        ) from error


def _surface(model: anny.Anny) -> ClosedSurface:
    return closed_surface(
        model.template_vertices.numpy().astype(np.float64),
        model.faces.numpy(),
        model.texture_coordinates.numpy(),
        model.face_texture_coordinate_indices.numpy(),
        {name: get_face_segmentation_mask(model, [name]).numpy() for name in CAVITIES},
    )


def _joint_of_bone(label: str) -> int:
    part = BONE_JOINTS[max((b for b in BONE_JOINTS if label.startswith(b)), key=len)]
    side = {"L": "left_", "R": "right_"}.get(label.partition(".")[2], "")
    return JOINT_NAMES.index(part if part in JOINT_NAMES else side + part)


def _bone_of_joint(name: str) -> str:
    if name in JOINT_BONES:
        return JOINT_BONES[name]
    return JOINT_BONES[name.replace("right", "left")].replace(".L", ".R")


def _mirror_joints() -> np.ndarray:
    names = [
        n.replace("left", "*").replace("right", "left").replace("*", "right") for n in JOINT_NAMES
    ]
    return np.array([JOINT_NAMES.index(n) for n in names])


def _bone_weights(model: anny.Anny) -> np.ndarray:
    """(A, B) Anny's skinning weights."""
    index = model.vertex_bone_indices.numpy()
    value = model.vertex_bone_weights.numpy().astype(np.float64)
    out = np.zeros((len(index), len(model.bone_labels)))
    for slot in range(index.shape[1]):
        np.add.at(out, (np.arange(len(index)), index[:, slot]), value[:, slot])
    return out / out.sum(axis=1, keepdims=True)


def _joint_weights(model: anny.Anny, surface: ClosedSurface) -> np.ndarray:
    """(V, 24) weights of the folded rig, symmetric, smoothed over the surface."""
    joint = [_joint_of_bone(label) for label in model.bone_labels]
    fold = np.eye(24)[joint]  # (B, 24)
    weights = surface.mixture @ (_bone_weights(model) @ fold)
    weights = (weights + weights[surface.mirror][:, _mirror_joints()]) / 2
    weights[weights < 1e-3] = 0
    return weights / weights.sum(axis=1, keepdims=True)


def _population(
    rng: np.random.Generator, model: anny.Anny, gender: int, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rest vertices (S, A, 3) and bone heads (S, B, 3) of adults, Z up, metres.

    Age is uniform; height, weight, muscle and proportions follow Anny's distributions of that
    age, fitted by its authors to the WHO's growth data.
    """
    distribution = SimpleShapeDistribution(model)
    years = torch.as_tensor(rng.uniform(*ADULT_YEARS, samples), dtype=model.dtype)
    age = distribution.morphological_age_mapping.morphological_to_anny_age(years)
    side = ("girls", "boys")[gender]
    phenotypes = {"age": age, "gender": torch.full_like(age, 1.0 - gender)}
    for trait, (share, shift) in TRAITS.items():
        beta = getattr(distribution, f"{side}_conditional_{trait}_distribution")
        a, b = (p.double().numpy() for p in beta.get_distribution_params(age))
        centre = a / (a + b) if trait == "height" else 0.5
        drawn = centre + share * (rng.beta(a, b) - centre) + shift
        phenotypes[trait] = torch.as_tensor(drawn, dtype=model.dtype)
    vertices, heads = [], []
    with torch.no_grad():
        for part in torch.arange(samples).split(16):
            result = model(phenotype_kwargs={k: v[part] for k, v in phenotypes.items()})
            vertices.append(result["vertices"].double().numpy())
            heads.append(result["bone_poses"][:, :, :3, 3].double().numpy())
    return np.concatenate(vertices), np.concatenate(heads)


def _t_pose(model: anny.Anny, rest: np.ndarray, heads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(S, A, 3) vertices, (S, 24, 3) joints in a T-pose of Anny's rig; Y up, root at the origin."""
    weights = _bone_weights(model)
    labels, parents = list(model.bone_labels), list(model.bone_parents)
    joint_bones = [labels.index(_bone_of_joint(name)) for name in JOINT_NAMES]
    out, joints = [], []
    for vertices, head in zip(rest, heads, strict=True):
        turns = _t_pose_turns(labels, parents, head)
        place = np.zeros_like(head)
        for bone, parent in enumerate(parents):
            if parent >= 0:
                place[bone] = place[parent] + turns[parent] @ (head[bone] - head[parent])
        shift = place - np.einsum("bij,bj->bi", turns, head)
        transforms = np.concatenate([turns, shift[:, :, None]], -1).reshape(len(labels), 12)
        blended = (weights @ transforms).reshape(-1, 3, 4)
        posed = np.einsum("vij,vj->vi", blended[:, :, :3], vertices) + blended[:, :, 3]
        out.append(posed @ Z_UP_TO_Y_UP.T)
        joints.append(place[joint_bones] @ Z_UP_TO_Y_UP.T)
    return np.stack(out), np.stack(joints)


def _t_pose_turns(labels: list[str], parents: list[int], head: np.ndarray) -> np.ndarray:
    """(B, 3, 3) world rotation of each bone that makes arms horizontal and legs vertical.

    The elbow's bending plane becomes horizontal, so that elbows bend forwards, and the palm
    faces down, as SMPL's do.
    """
    at = {label: head[i] for i, label in enumerate(labels)}
    turns: dict[str, np.ndarray] = {}
    for side, out in (("L", np.array([1.0, 0, 0])), ("R", np.array([-1.0, 0, 0]))):
        shoulder, elbow, wrist = (at[f"{b}.{side}"] for b in ("upperarm01", "lowerarm01", "wrist"))
        knuckles = at[f"finger3-1.{side}"]
        across = at[f"finger2-1.{side}"] - at[f"finger5-1.{side}"]  # towards the thumb
        forwards = np.array([0, -1.0, 0])
        upper = _frame_turn(elbow - shoulder, wrist - elbow, out, forwards)
        lower = _frame_turn(wrist - elbow, elbow - shoulder, out, -forwards)
        hand = _frame_turn(knuckles - wrist, across, out, forwards)
        plain_upper = _shortest_turn(elbow - shoulder, out)
        turns |= {
            f"upperarm01.{side}": _between(plain_upper, upper, TWIST_SHARE["upperarm01"]),
            f"upperarm02.{side}": upper,
            f"lowerarm01.{side}": _between(lower, hand, TWIST_SHARE["lowerarm01"], out),
            f"lowerarm02.{side}": _between(lower, hand, TWIST_SHARE["lowerarm02"], out),
            f"wrist.{side}": hand,
        }
        hip, knee, ankle = (at[f"{b}.{side}"] for b in ("upperleg01", "lowerleg01", "foot"))
        down = np.array([0, 0, -1.0])
        thigh, shin = _shortest_turn(knee - hip, down), _shortest_turn(ankle - knee, down)
        turns |= {f"{b}.{side}": thigh for b in ("upperleg01", "upperleg02")}
        turns |= {f"{b}.{side}": shin for b in ("lowerleg01", "lowerleg02")}
        turns[f"foot.{side}"] = np.eye(3)
    result = np.zeros((len(labels), 3, 3))
    for bone, label in enumerate(labels):
        inherited = result[parents[bone]] if parents[bone] >= 0 else np.eye(3)
        result[bone] = turns.get(label, inherited)
    return result


def _shortest_turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) that takes one direction to another about their common normal."""
    a, b = (v / np.linalg.norm(v) for v in (start, end))
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    return Rotation.from_rotvec(axis * (np.arctan2(sine, a @ b) / max(sine, 1e-12))).as_matrix()


def _frame_turn(
    start: np.ndarray, start_side: np.ndarray, end: np.ndarray, end_side: np.ndarray
) -> np.ndarray:
    """Rotation that takes `start` to `end` and, as well as it can, one side to the other."""
    return _frame(end, end_side) @ _frame(start, start_side).T


def _frame(along: np.ndarray, side: np.ndarray) -> np.ndarray:
    x = along / np.linalg.norm(along)
    y = side - (side @ x) * x
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _between(
    start: np.ndarray, end: np.ndarray, share: float, axis: np.ndarray | None = None
) -> np.ndarray:
    """Part of the way from one rotation to another; only the part about `axis` if given."""
    difference = Rotation.from_matrix(end @ start.T).as_rotvec()
    if axis is not None:
        difference = (difference @ axis) * axis
    return Rotation.from_rotvec(share * difference).as_matrix() @ start


def _symmetric(points: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Average (..., P, 3) with its mirror image (x to -x)."""
    return (points + points[..., mirror, :] * [-1, 1, 1]) / 2


def _shape_space(
    vertices: np.ndarray, joints: np.ndarray, faces: np.ndarray, larger: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mean and ten directions of vertices (V, 3, 10) and joints (24, 3, 10).

    Principal components give ten uncorrelated coordinates of unit variance. They are turned so
    that the first is the direction along which stature changes most (then no other changes it)
    and the second, among the rest, the one along which volume does.
    """
    count = len(vertices)
    joints = joints - joints[:, :1]
    mean, joint_mean = vertices.mean(axis=0), joints.mean(axis=0)
    flat = (vertices - mean).reshape(count, -1)
    _, vectors = np.linalg.eigh(flat @ flat.T)  # the samples are far fewer than the points
    scores = vectors[:, ::-1][:, :COMPONENTS] * np.sqrt(count - 1)
    scores *= np.sign(scores[np.abs(scores).argmax(axis=0), np.arange(COMPONENTS)])
    stature = np.ptp(vertices[:, :, 1], axis=1)
    turn = _turn_to([larger * _slope(scores, stature), -_slope(scores, _volumes(vertices, faces))])
    scores = scores @ turn
    directions = np.einsum("sk,svi->vik", scores, vertices - mean) / (count - 1)
    joint_directions = np.einsum("sk,svi->vik", scores, joints - joint_mean) / (count - 1)
    return mean, directions, joint_mean, joint_directions


def _slope(scores: np.ndarray, value: np.ndarray) -> np.ndarray:
    return scores.T @ (value - value.mean())


def _turn_to(first: list[np.ndarray]) -> np.ndarray:
    """(K, K) rotation whose first columns span the given directions one after another.

    The other columns are the remaining old axes, in their order.
    """
    columns: list[np.ndarray] = []
    for vector in [*first, *np.eye(len(first[0]))]:
        rest = vector - sum((c @ vector) * c for c in columns)
        length = np.linalg.norm(rest)
        if length > 0.3 * np.linalg.norm(vector) and len(columns) < len(vector):
            columns.append(rest / length)
    basis = np.stack(columns, axis=-1)
    assert basis.shape == (len(first[0]),) * 2
    return basis


def _volumes(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(S,) volume enclosed by a closed surface, cubic metres."""
    a, b, c = (vertices[:, faces[:, i]] for i in range(3))
    return np.einsum("sfi,sfi->s", a, np.cross(b, c)) / 6


def _regressor(
    mean: np.ndarray,
    directions: np.ndarray,
    joint_mean: np.ndarray,
    joint_directions: np.ndarray,
    weights: np.ndarray,
    mirror: np.ndarray,
) -> np.ndarray:
    """(24, V) positive rows that sum to one and give the rig's joints for every shape.

    A joint is a mixture of the skin around it. The mixture must hold for the mean body and for
    three standard deviations along each shape direction; non-negative least squares keeps it
    to a few dozen vertices.
    """
    regressor = np.zeros((24, len(mean)))
    for joint, name in enumerate(JOINT_NAMES):
        if name.startswith("right"):
            continue
        distance = np.linalg.norm(mean - joint_mean[joint], axis=1)
        ring = np.flatnonzero(distance < 1.35 * np.sort(distance)[60] + 0.06)
        points = np.concatenate([mean[ring, :, None], 3 * directions[ring]], axis=-1)
        wanted = np.append(joint_mean[joint][:, None], 3 * joint_directions[joint], axis=-1)
        system = np.vstack([points.reshape(len(ring), -1).T, 10 * np.ones(len(ring))])
        solution, _ = nnls(system, np.append(wanted.ravel(), 10.0))
        regressor[joint, ring] = solution / solution.sum()
    for joint, other in enumerate(_mirror_joints()):
        if JOINT_NAMES[joint].startswith("right"):
            regressor[joint] = regressor[other][mirror]
        elif joint == other:
            regressor[joint] = (regressor[joint] + regressor[joint][mirror]) / 2
    return regressor


if __name__ == "__main__":
    for own_gender, own_body in bake_bodies(seed=0, samples=POPULATION).items():
        save_body(free_body(own_gender), own_body, version=FREE_BODY_VERSION, licence=LICENCE)
