"""What a garment loses on its way to offsets and back."""

import numpy as np
from scipy.sparse.csgraph import connected_components

from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import boundary_edges, edge_graph, face_normals, faces_within
from drapeline.registration.error_table import Measure
from drapeline.registration.to_body.correspondence import Correspondence

LOST_M = 0.01  # garment further than this from what is rebuilt counts as lost


def surface_distance(
    vertices: np.ndarray, triangles: np.ndarray, other: np.ndarray, other_triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances from the faces of one surface to the closest points of another.

    Args:
        vertices, triangles: (V, 3) and (F, 3) measured from, at the middles of faces.
        other, other_triangles: the surface measured to.

    Returns:
        Distances (F,) in metres, angles (F,) in degrees between the normals, and areas (F,) in
        square metres to weigh them by.
    """
    middles = vertices[triangles].mean(axis=1)
    place, face = closest_points(middles, other, other_triangles)
    distance = np.linalg.norm(place - middles, axis=1)
    own, their = face_normals(vertices, triangles), face_normals(other, other_triangles)[face]
    angle = np.degrees(np.arccos(np.clip((own * their).sum(1), -1, 1)))
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return distance, angle, np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def round_trip(
    garment: np.ndarray,
    triangles: np.ndarray,
    body: np.ndarray,
    faces: np.ndarray,
    match: Correspondence,
) -> list[Measure]:
    """Errors of garment -> offsets -> garment, means weighted by area.

    `area_lost_percent` is the share of the garment's area that lies further than `LOST_M` from
    what is rebuilt. Holes are openings that the garment does not have, islands are loose pieces;
    both are counted before the mask is cleaned, and after.

    Args:
        garment: (C, 3) in the rest pose, metres.
        triangles: (G, 3) of the garment.
        body: (V, 3) that it was registered on.
        faces: (F, 3) of the body's topology.
        match: the registration.
    """
    vertices, kept = body + match.offsets(garment, body), faces_within(faces, match.mask)
    forward, angle, area = surface_distance(garment, triangles, vertices, kept)
    backward, _, kept_area = surface_distance(vertices, kept, garment, triangles)
    openings, pieces = _openings(kept), _pieces(kept)
    return [
        Measure("garment_to_rebuilt_mean_mm", 1e3 * np.average(forward, weights=area), "mm"),
        Measure("garment_to_rebuilt_max_mm", 1e3 * forward.max(), "mm"),
        Measure("rebuilt_to_garment_mean_mm", 1e3 * np.average(backward, weights=kept_area), "mm"),
        Measure("rebuilt_to_garment_max_mm", 1e3 * backward.max(), "mm"),
        Measure("normal_error_deg", np.average(angle, weights=area), "deg"),
        Measure("area_lost_percent", 100 * area[forward > LOST_M].sum() / area.sum(), "percent"),
        Measure("holes_before", match.holes, "count"),
        Measure("islands_before", match.islands, "count"),
        Measure("holes_after", max(openings - _openings(triangles), 0), "count"),
        Measure("islands_after", pieces - _pieces(triangles), "count"),
    ]


def _openings(triangles: np.ndarray) -> int:
    """Number of loops that the boundary consists of."""
    return _count_pieces(boundary_edges(triangles))


def _pieces(triangles: np.ndarray) -> int:
    return _count_pieces(triangles[:, [0, 1, 0, 2]].reshape(-1, 2))


def _count_pieces(pairs: np.ndarray) -> int:
    if not len(pairs):
        return 0
    used = np.zeros(pairs.max() + 1, dtype=bool)
    used[pairs] = True
    _, label = connected_components(edge_graph(pairs, len(used)), directed=False)
    return len(np.unique(label[used]))
