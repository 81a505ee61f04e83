"""Masks on the body's mesh: their pieces, holes and borders, and how they are cleaned."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from drapeline.geometry.mesh import edge_graph, edge_lengths, faces_within, half_edges

_ROUNDS = 6  # of cleaning


class BodyMesh:
    """A topology of the body, which tells what a mask of its vertices looks like.

    A mask covers the faces whose corners are all in it.

    Args:
        faces: (F, 3), kept as an attribute.
        count: V, number of vertices.

    Attributes:
        pairs: (E, 2) edges.
        used: (V,) bool, vertices that belong to faces.
        ends: (V,) bool, vertices on the body's own open ends.
    """

    def __init__(self, faces: np.ndarray, count: int) -> None:
        self.faces = faces
        self._count = count
        half = np.sort(half_edges(faces), axis=1)
        key, sides = np.unique(half.astype(np.int64) @ np.array([count, 1]), return_inverse=True)
        self.pairs = np.stack(np.divmod(key, count), axis=1)
        self._sides = sides.reshape(faces.shape)  # edge on each side of each face
        self.used = np.zeros(count, dtype=bool)
        self.used[faces] = True
        self.ends = np.zeros(count, dtype=bool)
        self.ends[self._border_pairs(np.ones(count, dtype=bool))] = True

    def spacing(self, body: np.ndarray) -> np.ndarray:
        """Mean length (V,) of each vertex's edges, for body vertices (V, 3)."""
        pairs = self.pairs
        length = edge_lengths(body, pairs)
        total = np.bincount(pairs.ravel(), np.repeat(length, 2), self._count)
        return total / np.maximum(np.bincount(pairs.ravel(), minlength=self._count), 1)

    def holes(self, mask: np.ndarray) -> int:
        """Number of pieces of bare body that the mask (V,) encloses."""
        piece = self._hole_pieces(mask)
        return len(np.unique(piece[piece >= 0]))

    def islands(self, mask: np.ndarray) -> int:
        """Number of pieces of the mask (V,) besides the largest."""
        piece = self._pieces(mask)
        return max(len(np.unique(piece[mask])) - 1, 0)

    def border(self, mask: np.ndarray) -> np.ndarray:
        """Vertices (V,) bool on the border of the mask's faces."""
        border = np.zeros(self._count, dtype=bool)
        border[self._border_pairs(mask)] = True
        return border

    def clean(self, mask: np.ndarray, slit: np.ndarray) -> np.ndarray:
        """The mask in one piece, without holes, whose border is a line that never meets itself.

        Args:
            mask: (V,) bool.
            slit: (V,) bool, vertices to leave bare although they would be holes.
        """
        mask = (mask | (self._hole_pieces(mask) >= 0)) & ~slit
        mask = mask | (self._hole_pieces(mask) >= 0)  # a slit leads to an opening
        for _ in range(_ROUNDS):
            if not mask.any():
                break
            kept = faces_within(self.faces, mask)
            graph = sp.coo_matrix(
                (np.ones(2 * len(kept)), kept[:, [0, 1, 0, 2]].reshape(-1, 2).T),
                shape=(self._count, self._count),
            )
            _, piece = connected_components(graph, directed=False)
            mask = mask & (piece == np.bincount(piece).argmax())
            covered = np.zeros(self._count, dtype=bool)
            covered[faces_within(self.faces, mask)] = True
            meeting = np.bincount(self._border_pairs(mask).ravel(), minlength=self._count)
            cleaner = covered & (meeting <= 2)
            if (cleaner == mask).all():
                break
            mask = cleaner
        return mask

    def _border_pairs(self, mask: np.ndarray) -> np.ndarray:
        """(B, 2) edges that belong to a single face of the mask."""
        sides = self._sides[mask[self.faces].all(axis=1)]
        return self.pairs[np.bincount(sides.ravel(), minlength=len(self.pairs)) == 1]

    def _pieces(self, chosen: np.ndarray) -> np.ndarray:
        """(V,) number of the piece that each chosen vertex is in, -1 for the others."""
        pairs = self.pairs[chosen[self.pairs].all(axis=1)]
        _, label = connected_components(edge_graph(pairs, self._count), directed=False)
        return np.where(chosen, label, -1)

    def _hole_pieces(self, mask: np.ndarray) -> np.ndarray:
        """(V,) piece of each bare vertex from which no open end can be reached, else -1."""
        piece = self._pieces(~mask & self.used)
        return np.where(np.isin(piece, piece[self.ends]), -1, piece)
