"""Measures of one garment, or of one in motion, by the names that all tables have."""

from collections.abc import Sequence

import numpy as np

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.garment import (
    CONTACT_STEP,
    normal_error_deg,
    shape_measures,
    surface_error_mm,
)
from drapeline.metrics.sequence import BodyFrames, inside_means, sequence_measures, surface_means


def measure(
    predicted: Mesh | Sequence[Mesh],
    true: Mesh | Sequence[Mesh] | None = None,
    *,
    body: Mesh | Sequence[Mesh] | None = None,
) -> dict[str, float]:
    """Measures of a garment, as the tables of results have them.

    Args:
        predicted: a garment, metres; or one in motion, a mesh per frame at 30 frames per second,
            all with the same faces.
        true: what it should be, in as many frames. It may have other vertices and faces; the
            measures that compare vertices are left out then.
        body: the wearer, in as many frames.

    Returns:
        Name -> value, of these:

        - with a true garment: `predicted_to_true_mm` and `true_to_predicted_mm`, mean distances of
          vertices to the other surface (in motion, of every fifth frame);
        - if both have the same faces: `surface_error_mm` and `normal_error_deg` (CLOTH3D 5.1), or
          in motion `vertex_error_mm` and `acceleration_error_m_s2` (M2 and M3 of Garment4D);
        - with a body: `inside_share` and `inside_1cm_share` of the vertices that are inside the
          body, and deeper than a centimetre, and `inside_depth_mm` of the deepest; and of a single
          garment its connected `pieces`.

    Raises:
        InputError: there are no frames, faces change, or the arguments have different lengths.
    """
    if isinstance(predicted, Mesh):
        if isinstance(true, Sequence) or isinstance(body, Sequence):
            raise InputError("measure: frames beside a single garment, expected a single mesh")
        return _of_mesh(predicted, true, body)
    if isinstance(true, Mesh) or isinstance(body, Mesh):
        raise InputError("measure: a single mesh beside a garment in motion, expected its frames")
    return _of_motion(predicted, true, body)


def _of_mesh(predicted: Mesh, true: Mesh | None, body: Mesh | None) -> dict[str, float]:
    measures: dict[str, float] = {}
    if true is not None:
        if _alike(predicted, true):
            one, other = predicted.vertices, true.vertices
            everywhere = np.ones(len(other), dtype=bool)
            measures["surface_error_mm"] = surface_error_mm(one, other, everywhere)
            measures["normal_error_deg"] = normal_error_deg(one, other, true.triangles, everywhere)
        measures |= surface_means([_split(predicted)], [_split(true)])
    if body is not None:
        measures |= shape_measures(_split(predicted), body.vertices, body.triangles)
    return measures


def _of_motion(
    predicted: Sequence[Mesh], true: Sequence[Mesh] | None, body: Sequence[Mesh] | None
) -> dict[str, float]:
    garment = _frames("predicted", predicted, len(predicted))
    measures: dict[str, float] = {}
    if true is not None:
        truth = _frames("true", true, len(predicted))
        if _alike(predicted[0], true[0]):
            measures |= sequence_measures(garment, truth)
        some = (map(_split, meshes[::CONTACT_STEP]) for meshes in (predicted, true))
        measures |= surface_means(*some)
    if body is not None:
        wearer = _frames("body", body, len(predicted))
        measures |= inside_means(garment, BodyFrames(wearer.__getitem__, body[0].triangles))
    return measures


def _frames(what: str, meshes: Sequence[Mesh], count: int) -> np.ndarray:
    """(F, V, 3) vertices of meshes with the same faces."""
    if not count or len(meshes) != count:
        raise InputError(f"measure: {what} has {len(meshes)} frames, expected {count or 'some'}")
    for frame, mesh in enumerate(meshes):
        if not _alike(mesh, meshes[0]):
            raise InputError(f"measure: {what} has other faces in frame {frame}, expected the same")
    return np.stack([mesh.vertices for mesh in meshes])


def _alike(mesh: Mesh, other: Mesh) -> bool:
    same = mesh.faces is other.faces or np.array_equal(mesh.faces, other.faces)
    return same and mesh.vertices.shape == other.vertices.shape


def _split(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.triangles)
