"""Metrics of a predicted garment against its ground truth (CLOTH3D 5.1), and of its shape alone.

A garment is the vertices (V, 3) of the super-resolved body plus their offsets, in metres, and a
mask (V,) that says which of them are garment.
"""

from functools import cached_property, lru_cache

import igl
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from drapeline.geometry.closest import closest_on_mesh, closest_points
from drapeline.geometry.mesh import Mesh, face_edges, face_normals, faces_within, loop_count
from drapeline.geometry.warp_mesh import warp_mesh

CONTACT_STEP = 5  # of the frames of garments in motion in which contact and surfaces are measured
DEEP_M = 0.01
_BODIES = 16  # that stay known: those of a sequence's frames that are measured, and a few more
_INSIDE = "inside_share", "inside_1cm_share", "inside_depth_mm"
_OUTSIDE_COSINE_MIN = 0.7  # between a normal and the way from its face to the point


def surface_error_mm(predicted: np.ndarray, true: np.ndarray, mask: np.ndarray) -> float:
    """Mean Euclidean distance of corresponding vertices (V, 3) within the true mask (V,)."""
    return 1000 * float(np.linalg.norm(predicted[mask] - true[mask], axis=1).mean())


def normal_error_deg(
    predicted: np.ndarray, true: np.ndarray, faces: np.ndarray, mask: np.ndarray
) -> float:
    """Mean angle between the normals of the true garment's faces (equation 5).

    Args:
        predicted, true: (V, 3) vertices.
        faces: (F, 3) of the garment's topology.
        mask: (V,) true mask; a face with all corners in it is a garment face.

    Returns:
        Degrees. The cosine is clamped, and a face that shrank to nothing counts as 90 degrees.
    """
    garment = faces_within(faces, mask)
    cosine = np.einsum("fi,fi->f", face_normals(predicted, garment), face_normals(true, garment))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())


def mask_iou(predicted: np.ndarray, true: np.ndarray) -> float:
    """Intersection over union of two masks of any shape, 0 where both are empty."""
    return float((predicted & true).sum() / max((predicted | true).sum(), 1))


def garment_mesh(vertices: np.ndarray, faces: np.ndarray, mask: np.ndarray) -> Mesh:
    """The garment as a mesh of its own, without vertices that are in no face within the mask."""
    garment = faces_within(faces, mask)
    used, corners = np.unique(garment, return_inverse=True)
    return Mesh(vertices[used].astype(np.float32), corners.reshape(garment.shape).astype(np.int32))


def piece_indices(mesh: Mesh) -> np.ndarray:
    """(V,) index of the connected piece that each vertex belongs to, 0 for the largest."""
    start, end = mesh.faces[:, :2].ravel(), mesh.faces[:, 1:3].ravel()
    count = len(mesh.vertices)
    links = coo_matrix((np.ones(len(start), dtype=bool), (start, end)), (count, count))
    pieces, piece = connected_components(links, directed=False)
    rank = np.zeros(pieces, dtype=np.int64)
    rank[np.argsort(-np.bincount(piece, minlength=pieces), kind="stable")] = np.arange(pieces)
    return rank[piece]


def largest_piece(mesh: Mesh) -> Mesh:
    """The connected piece with the most vertices."""
    return garment_mesh(mesh.vertices, mesh.faces, piece_indices(mesh) == 0)


def surface_distances_mm(predicted: Mesh, true: Mesh) -> tuple[float, float]:
    """Mean distance of predicted vertices to the true surface, and of true ones to the predicted.

    The first is blind to what is missing, the second to what is superfluous. Both are NaN if
    nothing was predicted.
    """
    if not len(predicted.faces):
        return float("nan"), float("nan")
    return (
        float(distances_mm(predicted.vertices, true).mean()),
        float(distances_mm(true.vertices, predicted).mean()),
    )


def area_distances_mm(predicted: Mesh, true: Mesh) -> tuple[float, float]:
    """Mean distance of the predicted surface to the true one over its area, and the other way.

    Unlike `surface_distances_mm`, it may compare meshes of any topologies, and it notices where a
    face cuts a corner between vertices that lie on the other surface. Both are NaN if nothing was
    predicted.
    """
    if not len(predicted.faces):
        return float("nan"), float("nan")
    return area_distance_mm(predicted, true), area_distance_mm(true, predicted)


def area_distance_mm(mesh: Mesh, other: Mesh) -> float:
    """Mean distance in millimetres of a surface to another over its area."""
    return area_distance_and_faces(mesh, other)[0]


def area_distance_and_faces(mesh: Mesh, other: Mesh) -> tuple[float, np.ndarray]:
    """Mean distance of a surface to another, and the faces of that nearest to its own.

    In millimetres and over the area; ids (F,) of those nearest to the centres of the mesh's faces.

    By the quadrature of vertices, edge midpoints and face centres that is exact for cubic functions
    on a triangle. Faces share the midpoints of their edges.
    """
    pairs, of_faces = face_edges(mesh.faces)
    corners = mesh.vertices[mesh.faces]  # (F, 3, 3)
    parts = (mesh.vertices, mesh.vertices[pairs].mean(axis=1), corners.mean(axis=1))
    points = np.concatenate(parts)
    place, nearest = closest_points(points, other.vertices, other.faces)
    distances = 1000 * np.linalg.norm(points - place, axis=1)
    at_vertices, at_middles, at_centres = np.split(distances, np.cumsum([*map(len, parts)])[:-1])
    means = (
        at_vertices[mesh.faces].sum(axis=1) / 20
        + at_middles[of_faces].sum(axis=1) * 2 / 15
        + at_centres * 9 / 20
    )
    sides = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return float(np.average(means, weights=area)), nearest[len(points) - len(corners) :]


def mesh_measures(mesh: Mesh, true: Mesh) -> dict[str, float]:
    """Measures of a garment of any topology against the one it stands for.

    Returns:
        `surface_to_true_mm` and `true_to_surface_mm` over the area; `normal_error_deg`, the angle
        between normals at the faces and at the nearest true ones; `openings_right`, whether there
        are as many openings. The first three are NaN where nothing is left of the garment.
    """
    to_true = to_mesh = normal_error = float("nan")
    same = False
    if len(mesh.faces):
        to_true, nearest = area_distance_and_faces(mesh, true)
        to_mesh = area_distance_mm(true, mesh)
        cosine = np.einsum(
            "fi,fi->f",
            face_normals(mesh.vertices, mesh.faces),
            face_normals(true.vertices, true.faces[nearest]),
        )
        normal_error = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())
        same = loop_count(mesh.faces) == loop_count(true.faces)
    return {
        "surface_to_true_mm": to_true,
        "true_to_surface_mm": to_mesh,
        "normal_error_deg": normal_error,
        "openings_right": float(same),
    }


def distances_mm(points: np.ndarray, mesh: Mesh) -> np.ndarray:
    """(P,) distance of points (P, 3) to the surface of a triangle mesh."""
    place, _ = closest_points(points, mesh.vertices, mesh.faces)
    return 1000 * np.linalg.norm(points - place, axis=1)


class BodyInside:
    """Measures of points inside a body, (V, 3) metres and (F, 3), which is indexed once.

    Its mesh may have open ends.
    """

    def __init__(self, body: np.ndarray, faces: np.ndarray) -> None:
        self._body, self._faces = body, faces
        self._mesh = warp_mesh(body, faces)

    @cached_property
    def _winding(self) -> igl.FastWindingNumberBVH:
        tree = igl.FastWindingNumberBVH()
        tree.init(
            np.ascontiguousarray(self._body, dtype=np.float64),
            np.ascontiguousarray(self._faces, dtype=np.int64),
        )
        return tree

    def depth(self, points: np.ndarray) -> np.ndarray:
        """(P,) metres from points (P, 3) inside to the surface, 0 for those outside."""
        place, face = closest_on_mesh(points, self._mesh)
        away = points - place
        depth = np.linalg.norm(away, axis=1)
        # Winding numbers are slow; points clearly in front of their nearest face need none.
        height = np.einsum("pi,pi->p", away, face_normals(self._body, self._faces[face]))
        doubtful = height < _OUTSIDE_COSINE_MIN * depth
        depth[~doubtful] = 0
        if doubtful.any():
            queries = np.ascontiguousarray(points[doubtful], dtype=np.float64)
            depth[doubtful] *= self._winding.winding_number(queries) > 0.5
        return depth

    def measures(self, points: np.ndarray) -> dict[str, float]:
        """Share and depth of a garment's vertices (P, 3) in the same pose that are inside.

        Returns:
            `inside_share` of the points, `inside_1cm_share` deeper than `DEEP_M`, and
            `inside_depth_mm` of the deepest; NaN without points.
        """
        if not len(points):
            return dict.fromkeys(_INSIDE, float("nan"))
        depth = self.depth(points)
        values = (depth > 0).mean(), (depth > DEEP_M).mean(), 1000 * float(depth.max())
        return dict(zip(_INSIDE, map(float, values), strict=True))


def inside_measures(points: np.ndarray, body: np.ndarray, faces: np.ndarray) -> dict[str, float]:
    """`BodyInside.measures` of one garment; several may be measured on a body in turn."""
    known = _index_body(body.tobytes(), body.dtype, faces.tobytes(), faces.dtype)
    return known.measures(points)


@lru_cache(maxsize=_BODIES)
def _index_body(body: bytes, body_type: np.dtype, faces: bytes, faces_type: np.dtype) -> BodyInside:
    return BodyInside(
        np.frombuffer(body, body_type).reshape(-1, 3),
        np.frombuffer(faces, faces_type).reshape(-1, 3),
    )


def piece_count(mesh: Mesh) -> int:
    """Connected pieces that the faces of a mesh make up."""
    return len(np.unique(piece_indices(mesh)[mesh.faces]))


def shape_measures(mesh: Mesh, body: np.ndarray, body_faces: np.ndarray) -> dict[str, float]:
    """Measures that need no ground truth: connected pieces, and how much is inside the body."""
    inside = inside_measures(mesh.vertices, body, body_faces)
    return {**inside, "pieces": float(piece_count(mesh))}


def garment_measures(
    predicted: np.ndarray,
    predicted_mask: np.ndarray | None,
    true: np.ndarray,
    mask: np.ndarray,
    faces: np.ndarray,
) -> dict[str, float]:
    """Every measure that compares a prediction with its ground truth.

    Args:
        predicted, true: (V, 3) vertices, metres.
        predicted_mask: (V,) bool; None from a model that predicts none, which leaves out the
            measures that need it.
        mask: (V,) bool.
        faces: (F, 3) of the garment's topology.
    """
    measures = {
        "surface_error_mm": surface_error_mm(predicted, true, mask),
        "normal_error_deg": normal_error_deg(predicted, true, faces, mask),
    }
    if predicted_mask is None:
        return measures
    to_true, to_predicted = surface_distances_mm(
        garment_mesh(predicted, faces, predicted_mask), garment_mesh(true, faces, mask)
    )
    return {
        **measures,
        "mask_iou": mask_iou(predicted_mask, mask),
        "predicted_to_true_mm": to_true,
        "true_to_predicted_mm": to_predicted,
    }
