"""A tube for a body, with a hierarchy, and garments on it that a network can learn in seconds."""

from functools import cache

import numpy as np
from scipy.sparse import csr_matrix

from drapeline.frames import gender_names
from drapeline.geometry.mesh import edges
from drapeline.learning_data.static import static_cvar
from drapeline.models.gcvae.data import BodyTemplate, cvar_statistics
from drapeline.outfits.garment_types import GARMENTS

RINGS, AROUND = 16, 12
VERTICES = RINGS * AROUND
COUNTS = (VERTICES, 48, 12, 4)
DRESS, TROUSERS = GARMENTS.index("Dress"), GARMENTS.index("Trousers")


def tube_faces(open_seam: bool) -> np.ndarray:
    """Triangles of a tube; without its seam it has another topology on the same vertices."""
    ring, step = np.meshgrid(np.arange(RINGS - 1), np.arange(AROUND - open_seam), indexing="ij")
    a = (ring * AROUND + step).ravel()
    b = (ring * AROUND + (step + 1) % AROUND).ravel()
    return np.concatenate([np.c_[a, b, b + AROUND], np.c_[a, b + AROUND, a + AROUND]]).astype(
        np.int32
    )


def tube() -> np.ndarray:
    """(V, 3) metres: radius 0.1 m, height 0.6 m."""
    turn = np.tile(np.arange(AROUND) * 2 * np.pi / AROUND, RINGS)
    height = np.repeat(np.linspace(0, 0.6, RINGS), AROUND)
    return np.stack([0.1 * np.cos(turn), 0.1 * np.sin(turn), height], 1)


def uneven() -> np.ndarray:
    """(V, 3) float32 the tube with dents, so that no two vertices are alike to a network."""
    dents = np.random.default_rng(7).normal(size=(VERTICES, 3))
    return (tube() + 0.005 * dents).astype(np.float32)


def tube_mirror() -> np.ndarray:
    """(V,) vertices of the tube on the other side of x = 0."""
    ring, step = np.divmod(np.arange(VERTICES), AROUND)
    return ring * AROUND + (AROUND // 2 - step) % AROUND


def hierarchy(faces: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Edges of every level and parents of all but the last: nearest of evenly chosen nodes."""
    points, graph = tube(), edges(faces)
    all_edges, parents = [graph], []
    for count in COUNTS[1:]:
        seeds = points[np.linspace(0, len(points) - 1, count).round().astype(int)]
        parent = np.argmin(((points[:, None] - seeds) ** 2).sum(-1), axis=1).astype(np.int32)
        parent[np.linspace(0, len(points) - 1, count).round().astype(int)] = np.arange(count)
        graph = np.unique(np.sort(parent[graph], axis=1), axis=0)
        graph = graph[graph[:, 0] < graph[:, 1]]
        ones = csr_matrix((np.ones(len(parent)), (parent, np.arange(len(parent)))))
        points = (ones @ points) / np.bincount(parent)[:, None]
        parents.append(parent)
        all_edges.append(graph)
    return all_edges, parents


class ToyGarments:
    """Cylinders of cloth around the tube: radius, length and slant vary, and the body's width.

    `cvar` has the layout of the static conditions.
    """

    def __init__(self, count: int = 48, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        body = tube()
        out = body * [1, 1, 0] / 0.1
        self.shape = rng.uniform(-1, 1, (count, 10)).astype(np.float32)
        self.gender = gender_names(rng.integers(0, 2, count))
        self.tightness = rng.uniform(-1.5, 0.5, (count, 2)).astype(np.float32)
        self.codes = rng.integers(0, 2, count)
        gap = rng.uniform(0.01, 0.05, (count, 1, 1))
        slant = rng.uniform(-0.05, 0.05, (count, 1, 1))
        hem = rng.uniform(0.1, 0.4, (count, 1))
        self.mask = body[:, 2] > hem
        offsets = (gap + slant * (body[:, 2:] - 0.3)) * out * self.mask[..., None]
        self.offsets = offsets.astype(np.float32)
        self.split = np.array(["train"] * (count - 12) + ["val"] * 6 + ["test"] * 6)

    def rows(self, split):
        return np.flatnonzero(self.split == split)

    def topology(self, rows):
        return self.codes[rows]

    def cvar(self, rows):
        return static_cvar(self.shape[rows], self.gender[rows], self.tightness[rows])

    mirrored_cvar = cvar

    def names(self, rows):
        return [f"toy{row:03d}" for row in rows]

    def batch(self, rows):
        return {
            "offsets": self.offsets[rows],
            "base": np.tile(uneven(), (len(rows), 1, 1)),
            "mask": self.mask[rows],
            "cvar": self.cvar(rows),
            "topology": self.codes[rows],
            "names": self.names(rows),
        }


def body_basis() -> np.ndarray:
    """(22, V, 3): a tube that shape 0 widens, the male one a tenth wider."""
    basis = np.zeros((22, VERTICES, 3), dtype=np.float32)
    basis[0], basis[11] = tube(), tube() * [1.1, 1.1, 1]
    basis[1] = basis[12] = 0.02 * tube() * [1, 1, 0]
    return basis


@cache
def toy_template() -> BodyTemplate:
    """The tube with and without seam, and the statistics of `ToyGarments()`."""
    garments = ToyGarments()
    train = garments.rows("train")
    faces = {"body": tube_faces(False), "skirt": tube_faces(True)}
    levels = {name: hierarchy(f) for name, f in faces.items()}
    mean, std = cvar_statistics(garments.cvar(train))
    return BodyTemplate(
        edges={name: level[0] for name, level in levels.items()},
        parents={name: level[1] for name, level in levels.items()},
        faces=faces,
        offset_mean=np.stack([garments.offsets[train].mean(0)] * len(faces)),
        offset_std=np.stack([garments.offsets[train].std(0) + 5e-3] * len(faces)),
        base_mean=tube().astype(np.float32),
        base_std=np.full((VERTICES, 3), 0.02, dtype=np.float32),
        body_mean=tube().astype(np.float32),
        body_std=np.full((VERTICES, 3), 0.02, dtype=np.float32),
        body_basis=body_basis(),
        cvar_mean=mean,
        cvar_std=std,
    )


def half(upper: bool) -> np.ndarray:
    """(V,) the upper or the lower half of the tube."""
    return (np.arange(VERTICES) // AROUND >= RINGS // 2) == upper
