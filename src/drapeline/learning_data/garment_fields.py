"""Samples of the unsigned distance fields of garments at rest (SMPLicit 3.2 and 3.3)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.bodies.model import BodyModel, load_bodies
from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS, gender_codes, gender_names
from drapeline.geometry.closest import closest_points
from drapeline.geometry.mesh import Mesh, boundary_edges, triangulate
from drapeline.job import Job
from drapeline.learning_data.occlusion import TexturePixels, covered_vertices, texture_pixels
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.static import StaticOutfit
from drapeline.rule_log import LOGGER, progress
from drapeline.seeding import rng_for
from drapeline.storage import ArrayFiles, atomic_folder, load_npz, open_arrays, save_npz

# Points near the surface are moved off it by a normal deviate in each coordinate: half of them by
# about a wall's thickness, half as far as clipped distances reach.
NEAR_DEVIATIONS_M = (0.006, 0.025)
SKIN_DEVIATION_M = 0.03
BEYOND_M = 0.2

Box = tuple[Sequence[float], Sequence[float]]
_ROWS = {
    "shape": "float n 10",
    "gender": f"int<{len(GENDERS)} n",
    "garment": f"int<{len(GARMENTS)} n",
    "outfit": "str n",
    "split": "str n",
    "occlusion": "bool n r r",
}
_POINTS = {
    "near": "float n near 3",
    "near_distance": "float n near",
    "space": "float n space 3",
    "space_distance": "float n space",
}


def unsigned_distances(points: np.ndarray, garment: Mesh) -> np.ndarray:
    """(P,) float32 metres from points (P, 3) to the nearest point of an open surface, exact."""
    place, _ = closest_points(points, garment.vertices, garment.faces)
    return np.linalg.norm(points - place, axis=1).astype(np.float32)


def sample_field(
    rng: np.random.Generator, garment: Mesh, body: Mesh, box: Box, *, near: int, space: int
) -> dict[str, np.ndarray]:
    """Points with their distances: near the garment, and in the space around it.

    Of the latter one half is uniform in the model's box, as in the paper. The others tell where the
    garment ends, since few uniform points come close to the body below a hem: a quarter is near the
    skin, and a quarter where the garment would go on beyond its openings.

    Args:
        garment: triangles, root-relative metres, rest pose.
        body: of the wearer, likewise.
        box: lowest and highest corner, metres.

    Returns:
        `near` (near, 3) and `space` (space, 3) float32 points, and `near_distance` and
        `space_distance` with their distances, metres.
    """
    deviation = np.resize(NEAR_DEVIATIONS_M, near)[:, None]
    close = _on_surface(rng, garment, near) + deviation * rng.normal(size=(near, 3))
    low, high = np.asarray(box)
    spread = rng.uniform(low, high, size=(space, 3))
    skin, beyond = spread[1::4], spread[3::4]
    inside = Mesh(body.vertices, body.faces[_within(body.vertices, box)[body.faces].all(axis=1)])
    skin[:] = _on_surface(rng, inside, len(skin)) + SKIN_DEVIATION_M * rng.normal(size=skin.shape)
    beyond[:] = _beyond_openings(rng, garment, len(beyond))
    points = {"near": close.astype(np.float32), "space": spread.astype(np.float32)}
    distances = {
        f"{name}_distance": unsigned_distances(places, garment) for name, places in points.items()
    }
    return points | distances


def _on_surface(rng: np.random.Generator, mesh: Mesh, count: int) -> np.ndarray:
    import trimesh  # here, because those who read finished samples do not need it

    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return trimesh.sample.sample_surface(surface, count, seed=rng)[0]


def _beyond_openings(rng: np.random.Generator, garment: Mesh, count: int) -> np.ndarray:
    """(count, 3) points where the faces at the openings point to, up to `BEYOND_M` away."""
    base = len(garment.vertices)
    rims = np.sort(boundary_edges(garment.faces), axis=1) @ [base, 1]
    sides = np.sort(garment.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2)  # (F, 3, 2)
    face, side = np.nonzero(np.isin(sides @ [base, 1], rims))
    opposite = garment.vertices[garment.faces[face, (side + 2) % 3]].astype(np.float64)
    start, end = (garment.vertices[sides[face, side, k]].astype(np.float64) for k in (0, 1))
    along = (end - start) / np.maximum(np.linalg.norm(end - start, axis=1, keepdims=True), 1e-9)
    away = start - opposite
    away -= (away * along).sum(axis=1, keepdims=True) * along
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    weights = np.linalg.norm(end - start, axis=1)
    chosen = rng.choice(len(start), size=count, p=weights / weights.sum())
    places = start[chosen] + rng.random((count, 1)) * (end - start)[chosen]
    # Most are close, where narrow openings are: an open front, the space beside a strap.
    reach = BEYOND_M * rng.random((count, 1)) ** 2
    return places + reach * away[chosen] + NEAR_DEVIATIONS_M[0] * rng.normal(size=(count, 3))


def _within(points: np.ndarray, box: Box) -> np.ndarray:
    return ((points >= box[0]) & (points <= box[1])).all(axis=1)


def sample_fields(
    outfits: Sequence[StaticOutfit],
    bodies: Mapping[str, BodyModel],
    pixels: TexturePixels,
    boxes: Mapping[str, Box],
    *,
    seed: int,
    near: int,
    space: int,
) -> dict[str, np.ndarray]:
    """Fields and occlusion images of the garments of a shard.

    Args:
        outfits: as `load_static` reads them.
        bodies: by gender.
        boxes: garment type -> box of the model that learns it.
        near, space: points per garment.

    Returns:
        Arrays with a row per garment: `shape` (n, 10), `gender`, `garment`, `outfit`, `split` (n,),
        `occlusion` (n, R, R) bool, and what `sample_field` gives.
    """
    rows: list[dict[str, Any]] = []
    for name, split, outfit in progress(outfits, label="outfits"):
        body = bodies[outfit.gender]
        vertices = rest_body(body, outfit.shape)
        for garment in outfit.garments:
            _refuse_outside(garment.vertices, boxes[garment.name], f"{name}/{garment.name}")
            mesh = Mesh(garment.vertices, triangulate(garment.faces))
            covered = covered_vertices(vertices, body.faces, mesh)
            rng = rng_for(seed, "field", name, garment.name)
            rows.append(
                {
                    "shape": outfit.shape.astype(np.float32),
                    "gender": np.int8(GENDERS.index(outfit.gender)),
                    "garment": np.int8(GARMENTS.index(garment.name)),
                    "outfit": name,
                    "split": split,
                    "occlusion": pixels.image(covered),
                    **sample_field(
                        rng,
                        mesh,
                        Mesh(vertices, body.faces),
                        boxes[garment.name],
                        near=near,
                        space=space,
                    ),
                }
            )
    return {key: np.array([row[key] for row in rows]) for key in (*_ROWS, *_POINTS)}


def _refuse_outside(vertices: np.ndarray, box: Box, name: str) -> None:
    if not _within(vertices, box).all():
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        raise InputError(
            f"{name}: extends from {low.round(2).tolist()} to {high.round(2).tolist()} m, expected"
            f" it within the box of its model, {list(box[0])} to {list(box[1])}; choose a smaller"
            " body.shape_range"
        )


def collect_fields(
    output: str | Path,
    shards: Sequence[str | Path],
    garments: Sequence[str],
    bodies: Mapping[str, BodyModel],
    pixels: TexturePixels,
    *,
    clusters: int,
) -> int:
    """Join the garments of some types from all shards into one folder, with the body's clusters.

    Args:
        output: folder, replaced as a whole.
        shards: `.npz` files of `sample_fields`.
        garments: types to collect.
        bodies: by gender.
        clusters: K, see `body_clusters`.

    Returns:
        Number of garments.

    Raises:
        InputError: a shard lacks arrays, or no garment of these types is for training.
    """
    codes = [GARMENTS.index(name) for name in garments]
    about = [load_npz(path, _ROWS) for path in shards]
    chosen = [np.flatnonzero(np.isin(part["garment"], codes)) for part in about]
    rows = {
        key: np.concatenate([part[key][some] for part, some in zip(about, chosen, strict=True)])
        for key in _ROWS
    }
    training = rows["split"] == "train"
    if not training.any():
        raise InputError(
            f"{output}: no garment of the types {', '.join(garments)} is for training, expected one"
            " or more; ask for more static outfits"
        )
    covered = covered_often(rows["occlusion"][training], pixels)
    mean = np.mean([rest_body(body, np.zeros(10)) for body in bodies.values()], axis=0)
    with atomic_folder(output) as scratch:
        sizes = {path: len(part["garment"]) for path, part in zip(shards, about, strict=True)}
        _copy_points(scratch, sizes, chosen, len(training))
        save_npz(scratch / "rows.npz", **rows)
        save_npz(scratch / "clusters.npz", vertices=body_clusters(mean, covered, clusters))
    return len(training)


def _copy_points(
    folder: Path, shards: Mapping[str | Path, int], chosen: Sequence[np.ndarray], count: int
) -> None:
    files: ArrayFiles | None = None
    pairs = zip(shards.items(), chosen, strict=True)
    for (path, rows), some in progress(pairs, total=len(shards), label="shards"):
        part = load_npz(path, _POINTS, n=rows)
        if files is None:
            layouts = {name: (np.float32, (count, *part[name].shape[1:])) for name in _POINTS}
            files = ArrayFiles(folder, layouts)
        for name, array in files.arrays.items():
            if part[name].shape[1:] != array.shape[1:]:
                raise InputError(
                    f"{path}: has {part[name].shape[1]} points '{name}' per garment, expected"
                    f" {array.shape[1]}; sample it anew"
                )
        files.append(**{name: part[name][some] for name in _POINTS})
    if files is not None:
        files.flush()


def covered_often(occlusion: np.ndarray, pixels: TexturePixels) -> np.ndarray:
    """Ids of the body's vertices that a tenth of some garments cover, by images (n, R, R) bool."""
    rate = occlusion.mean(axis=0).ravel()
    often = (rate >= 0.1) & (pixels.weights.sum(axis=1) > 0)
    nearest = pixels.corners[np.arange(len(rate)), pixels.weights.argmax(axis=1)]
    return np.unique(nearest[often])


def body_clusters(body: np.ndarray, allowed: np.ndarray, count: int) -> np.ndarray:
    """(K,) vertices from which points are measured, spread evenly by farthest-point sampling.

    The first is the one nearest to the mean of all allowed ones; each next one is the farthest from
    those chosen so far, the first of equals. Fewer are allowed than asked for: all of them, in the
    same order, and again from the start.

    Args:
        body: (V, 3) the mean body at rest.
        allowed: (A,) ids to choose from.
        count: K.
    """
    places = body[allowed]
    first = np.linalg.norm(places - places.mean(axis=0), axis=1).argmin()
    order = [int(first)]
    away = np.linalg.norm(places - places[first], axis=1)
    while len(order) < min(count, len(allowed)):
        order.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(places - places[order[-1]], axis=1))
    return np.resize(allowed[order], count)


def load_clusters(folder: str | Path) -> np.ndarray:
    """(K,) ids of the body's vertices that points are measured from.

    Args:
        folder: of the rule `collect_fields`.

    Raises:
        InputError: the file is missing or damaged.
    """
    return load_npz(Path(folder) / "clusters.npz", {"vertices": "int k"})["vertices"]


class FieldData:
    """Fields of garments at rest, as `collect_fields` wrote them.

    Attributes:
        near, space: (N, P, 3) float32 points, memory-mapped.
        near_distance, space_distance: (N, P) float32 metres, memory-mapped.
        occlusion: (N, R, R) bool.
        shape: (N, 10) float32.
        gender: (N,) "female" or "male".
        garment: (N,) int8, index into `GARMENTS`.
        outfit, split: (N,) str.
        clusters: (K,) ids of the body's vertices.
    """

    def __init__(self, folder: str | Path) -> None:
        """Open a folder of the rule `collect_fields`.

        Raises:
            InputError: a file is missing or the files count different rows.
        """
        self.folder = Path(folder)
        rows = load_npz(self.folder / "rows.npz", _ROWS)
        self.shape, self.garment = rows["shape"], rows["garment"]
        self.gender = gender_names(rows["gender"])
        self.outfit, self.split = rows["outfit"], rows["split"]
        self.occlusion = rows["occlusion"]
        self.clusters = load_clusters(self.folder)
        points = open_arrays(self.folder, _POINTS, n=len(self))
        self.near, self.space = points["near"], points["space"]
        self.near_distance, self.space_distance = points["near_distance"], points["space_distance"]

    def __len__(self) -> int:
        return len(self.garment)

    def arrays(self) -> dict[str, np.ndarray]:
        """All of them by name."""
        return {name: getattr(self, name) for name in (*_ROWS, *_POINTS, "clusters")}

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of "train", "val" or "test"."""
        return np.flatnonzero(self.split == split)

    def names(self, rows: np.ndarray) -> list[str]:
        """Outfit and garment of rows, for messages."""
        return [f"{self.outfit[row]}/{GARMENTS[self.garment[row]]}" for row in rows]

    def batch(self, rows: np.ndarray) -> dict[str, Any]:
        """Arrays of rows: points, distances, occlusion, shape, code of the gender, row, names."""
        return {
            **{name: np.asarray(getattr(self, name)[rows]) for name in _POINTS},
            "occlusion": self.occlusion[rows],
            "shape": self.shape[rows],
            "gender": gender_codes(self.gender[rows]),
            "row": rows,
            "names": self.names(rows),
        }


def collect(job: Job) -> None:
    """Distance fields of all garments of some types."""
    given, params = job.input, job.params
    bodies = load_bodies(given)
    pixels = texture_pixels(bodies[GENDERS[0]], params.resolution)
    count = collect_fields(
        job.output[0], given.shards, params.garments, bodies, pixels, clusters=params.clusters
    )
    LOGGER.info("%d garments", count)
