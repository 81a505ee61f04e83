"""Figures 5 to 7 of CLOTH3D: topologies of the body, its mesh hierarchy, registered garments."""

import colorsys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from trimesh.intersections import slice_faces_plane

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.dataset.scene_part import BODY_COLOUR
from drapeline.geometry.mesh import edges, faces_within, triangulate, vertex_normals
from drapeline.outfits.garment_types import first_of_each
from drapeline.outfits.outfit import Garment
from drapeline.outfits.static import StaticOutfit
from drapeline.registration.to_body.hierarchy import Hierarchy
from drapeline.registration.to_body.registrar import RegisteredGarment, Registrar, surface_distance
from drapeline.registration.to_body.segments import vertex_areas
from drapeline.registration.to_body.topology import TOPOLOGIES, Topology, skirt_body
from drapeline.rendering.camera import Camera, look_at
from drapeline.rendering.pictures import GridCell, heat_parts, save_contact_sheet, save_grid
from drapeline.rendering.raytracer import ColouredMesh, raytrace

_INNER, _NEW = (0.56, 0.7, 0.83), (0.9, 0.42, 0.16)
_SAMPLES = 8
_DISTANCE_M = 6.0
_DIRECTIONS = {
    "front": (0.0, -1.0, 0.06),
    "back": (0.0, 1.0, 0.12),
    "side": (0.75, -1.0, 0.1),
    # Not quite straight down, so that the camera knows which way is up.
    "above": (0.0, -0.02, 1.0),
}
# Colours of neighbouring fields; eight are enough for these meshes.
_FIELDS = (
    *((0.35, 0.62, 0.83), (0.95, 0.73, 0.38), (0.45, 0.75, 0.6), (0.87, 0.55, 0.62)),
    *((0.68, 0.62, 0.85), (0.8, 0.82, 0.45), (0.6, 0.45, 0.4), (0.75, 0.77, 0.8)),
)
_STANDING = (0.12, 0.12, 0.14)
_SIZE = (320, 340)
_CLOTH, _LAID, _REBUILT = (0.33, 0.5, 0.74), (0.84, 0.6, 0.3), (0.4, 0.62, 0.5)
_FLOAT_M = 0.004  # garments laid on the body are shown this far above it
_SCALE_MM = 5.0


def plot_topologies(path: str | Path, topology: Topology) -> None:
    """Draw both topologies, the joined legs before and after smoothing, and cuts through the legs.

    New faces are orange; faces with vertices that smoothing moves are blue.
    """
    rest = _stand(topology.rest)
    tube = _stand(skirt_body(topology, topology.rest))
    moved = topology.inner_leg[topology.skirt_faces].any(axis=1)
    moved[-int(topology.joining) :] = False
    look = np.where(moved, 1, 0)
    look[-int(topology.joining) :] = 2
    plain = np.zeros(len(topology.faces), dtype=int)
    meshes = {
        "body": (rest, topology.faces, plain),
        "legs joined": (rest, topology.skirt_faces, look),
        "inner legs smoothed": (tube, topology.skirt_faces, look),
    }
    colours = (BODY_COLOUR, _INNER, _NEW)
    pictures = []
    for view in ("front", "side"):
        for name, (vertices, faces, colour) in meshes.items():
            parts = _split_by_colour(vertices, faces, colour, colours)
            pictures.append((_picture(parts, view, (400, 400), 1.55), f"{name}, {view}"))
    height = 0.35 * (rest[:, 2].max() - rest[:, 2].min())
    for name, (vertices, faces, colour) in meshes.items():
        parts = _split_by_colour(*_cut_below(vertices, faces, colour, height), colours)
        picture = _picture(parts, "above", (400, 400), 0.72, centre=(0.0, 0.0, height))
        pictures.append((picture, f"{name}, cut at {height:.2f} m, from above"))
    save_contact_sheet(path, pictures, columns=3)


def plot_hierarchies(
    path: str | Path, topology: Topology, hierarchies: Mapping[str, Hierarchy]
) -> None:
    """Draw the receptive fields of each level and some coarse meshes, by topology and pooling.

    Captions give the number of fields and the standard deviation of their areas over the mean.
    """
    shapes = {
        "body": (_stand(topology.rest), topology.faces),
        "skirt": (_stand(skirt_body(topology, topology.rest)), topology.skirt_faces),
    }
    pictures = []
    for name in TOPOLOGIES:
        for pooling, hierarchy in hierarchies.items():
            vertices, faces = shapes[name]
            areas = vertex_areas(vertices.astype(np.float64), faces)
            for level in range(1, len(hierarchy.counts)):
                label = hierarchy.labels(name, level)
                count, spread = hierarchy.counts[level], _spread(label, areas)
                caption = f"{name}, {pooling}: {count}, spread {spread:.2f}"
                fields = _fields(vertices, faces, label, hierarchy.vertices[name][level])
                pictures.append((_picture(fields, "front", (300, 320), 1.5), caption))
                if level in (2, 3):
                    mesh = _facets(vertices, faces, label, hierarchy.vertices[name][level])
                    caption = f"{name}, {pooling}: mesh of {count}"
                    pictures.append((_picture([mesh], "front", (300, 320), 1.5), caption))
    save_contact_sheet(path, pictures, columns=7)


def _stand(vertices: np.ndarray) -> np.ndarray:
    """Put the body with its ankles on the floor."""
    return (vertices - [0, 0, vertices[:, 2].min() - 0.01]).astype(np.float32)


def _split_by_colour(
    vertices: np.ndarray, faces: np.ndarray, look: np.ndarray, colours: tuple
) -> list[ColouredMesh]:
    """Split a mesh into a part for each colour; `look` (F,) are the colours of its faces."""
    return [ColouredMesh(vertices, faces[look == k], colours[k]) for k in np.unique(look)]


def _picture(
    parts: list[ColouredMesh],
    view: str,
    size: tuple[int, int],
    seen_m: float,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.71),
) -> np.ndarray:
    camera = _view_camera(view, size, seen_m, np.array(centre))
    return raytrace(parts, camera, samples=_SAMPLES)


def _view_camera(view: str, size: tuple[int, int], seen_m: float, centre: np.ndarray) -> Camera:
    """A camera that sees `seen_m` metres across its narrower side."""
    direction = np.array(_DIRECTIONS[view])
    place = centre + _DISTANCE_M * direction / np.linalg.norm(direction)
    return look_at(place, centre, focal_px=min(size) * _DISTANCE_M / seen_m, size=size)


def _cut_below(
    vertices: np.ndarray, faces: np.ndarray, look: np.ndarray, height: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The part of a mesh below a height, and the colours of its faces."""
    pieces = [
        slice_faces_plane(
            vertices, faces[look == k], np.array([0, 0, -1]), np.array([0, 0, height])
        )
        for k in np.unique(look)
    ]
    starts = np.cumsum([0, *(len(piece[0]) for piece in pieces[:-1])])
    return (
        np.concatenate([piece[0] for piece in pieces]).astype(np.float32),
        np.concatenate([piece[1] + s for piece, s in zip(pieces, starts, strict=True)]),
        np.repeat(np.unique(look), [len(piece[1]) for piece in pieces]),
    )


def _spread(label: np.ndarray, areas: np.ndarray) -> float:
    """Standard deviation of the fields' areas divided by their mean: 0 if all are equal."""
    area = np.bincount(label, areas)
    return float(area.std() / area.mean())


def _fields(
    vertices: np.ndarray, faces: np.ndarray, label: np.ndarray, standing: np.ndarray
) -> list[ColouredMesh]:
    """The surface in the colours of its fields, and dots on their vertices if these are few."""
    corners = label[faces]
    owner = np.where(corners[:, 1] == corners[:, 2], corners[:, 1], corners[:, 0])
    if len(standing) > 30:
        parts = _split_by_colour(vertices, faces, _colour_fields(label, faces)[owner], _FIELDS)
    else:
        # Few enough for a colour each, the same in both topologies.
        parts = _split_by_colour(vertices, faces, owner, _distinct_colours(len(standing)))
    if len(standing) <= 226:
        parts.append(_dots(vertices[standing], 0.006 + 0.08 / len(standing)))
    return parts


def _colour_fields(label: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(n,) a colour for each field, different from its neighbours' where possible."""
    pairs = label[edges(faces)]
    near: list[set[int]] = [set() for _ in range(label.max() + 1)]
    for a, b in np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0).tolist():
        near[a].add(b)
        near[b].add(a)
    colour = np.full(len(near), -1)
    for field, others in enumerate(near):
        taken = set(colour[list(others)].tolist())
        free = [k for k in range(len(_FIELDS)) if k not in taken]
        # Always taking the first would use few colours, in stripes.
        colour[field] = free[field % len(free)] if free else field % len(_FIELDS)
    return colour


def _distinct_colours(count: int) -> tuple:
    golden = 0.381966
    return tuple(
        colorsys.hsv_to_rgb(k * golden % 1, 0.32 + 0.13 * (k % 3), 0.95 - 0.2 * (k % 2))
        for k in range(count)
    )


def _dots(places: np.ndarray, radius: float) -> ColouredMesh:
    """Octahedra around places (n, 3)."""
    corners = radius * np.concatenate([np.eye(3), -np.eye(3)])
    turns = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    vertices = (places[:, None] + corners).reshape(-1, 3)
    faces = (np.array(turns) + 6 * np.arange(len(places))[:, None, None]).reshape(-1, 3)
    return ColouredMesh(vertices.astype(np.float32), faces.astype(np.int32), _STANDING)


def _facets(
    vertices: np.ndarray, faces: np.ndarray, label: np.ndarray, standing: np.ndarray
) -> ColouredMesh:
    """The coarse mesh with flat faces, one for every triple of fields that meet in a face."""
    corners = np.sort(label[faces], axis=1)
    between = (corners[:, 0] < corners[:, 1]) & (corners[:, 1] < corners[:, 2])
    _, first = np.unique(corners[between], axis=0, return_index=True)
    coarse = standing[label[faces[between][first]]]
    return ColouredMesh(
        vertices[coarse].reshape(-1, 3), np.arange(3 * len(coarse)).reshape(-1, 3), BODY_COLOUR
    )


def plot_registration(
    path: str | Path,
    topology: Topology,
    bodies: Mapping[str, BodyModel],
    outfits: Iterable[StaticOutfit],
    garments: Sequence[str],
) -> None:
    """Write a PNG with a row per garment type: garment, registered, rebuilt, errors.

    Args:
        topology: of the super-resolved body.
        bodies: super-resolved, by gender.
        outfits: the first garment of each type among them is shown.
        garments: their types; no more outfits are read than it takes to find these.
    """
    registrar = Registrar(topology)
    rows, labels = [], []
    worn = ((g.name, (g, outfit)) for _, _, outfit in outfits for g in outfit.garments)
    for garment, outfit in first_of_each(worn, garments):
        body = rest_body(bodies[outfit.gender], outfit.shape)
        done = registrar.register(garment.name, garment.vertices, garment.faces, body)
        rows.append(_row(garment, body, topology, done))
        labels.append(garment.name)
    columns = ("garment", "registered to the body", "rebuilt", "error of the garment")
    save_grid(path, rows, columns=columns, labels=labels, heat_mm=_SCALE_MM)


def _row(
    garment: Garment, body: np.ndarray, topology: Topology, done: RegisteredGarment
) -> list[GridCell]:
    faces, triangles = topology.faces_of(garment.name), triangulate(garment.faces)
    laid = done.laid + _FLOAT_M * vertex_normals(done.laid, triangles)
    vertices, kept = body + done.offsets, faces_within(faces, done.match.mask)
    error, _, _ = surface_distance(garment.vertices.astype(float), triangles, vertices, kept)
    values = {m.metric: m.value for m in done.measures}
    wearer = ColouredMesh(body, topology.faces, BODY_COLOUR)
    views = [
        ([wearer, ColouredMesh(garment.vertices, garment.faces, _CLOTH)], ""),
        ([wearer, ColouredMesh(laid, triangles, _LAID)], ""),
        ([wearer, ColouredMesh(vertices, kept, _REBUILT)], ""),
        (
            [wearer, *heat_parts(garment.vertices, triangles, 1000 * error, _SCALE_MM)],
            f"mean {values['garment_to_rebuilt_mean_mm']:.2f} mm,"
            f" at most {values['garment_to_rebuilt_max_mm']:.1f} mm",
        ),
    ]
    camera = _body_camera(body)
    lift = [0, 0, -body[:, 2].min()]
    lifted = (
        ([replace(part, vertices=part.vertices + lift) for part in parts], caption)
        for parts, caption in views
    )
    return [GridCell(raytrace(parts, camera, samples=12), caption) for parts, caption in lifted]


def _body_camera(body: np.ndarray) -> Camera:
    height = float(np.ptp(body[:, 2]))
    return look_at(
        np.array([0.0, -4.6, 1.25 * height / 1.5]),
        np.array([0.0, 0.0, 0.5 * height]),
        focal_px=2.3 * _SIZE[1] * 1.5 / max(height, 1.5),
        size=_SIZE,
    )
