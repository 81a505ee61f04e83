"""The 21 segments of the body that pooling never mixes (CLOTH3D 4.2, figure 6d).

The paper gives their number and that regions with the highest variability of offsets have smaller
ones, not the segments themselves. Ours are the cells around 21 seeds, nearest along the surface,
in a measure in which lengths grow with the square root of the variability: a segment's area is
inversely proportional to it, so that each has about the same share of all that varies.
"""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import edge_lengths, edges

MIDDLE, PAIRS = 5, 8  # seeds in the plane of symmetry, and seeds on both sides
SEGMENTS = MIDDLE + 2 * PAIRS
# Standard deviation in metres of the offset between body and garment at the height of a joint, or
# out along the arm: measured on 120 rest garments of all six types by nearest points.
_TORSO_AND_LEGS_M = {
    "left_ankle": 0.040,
    "left_knee": 0.029,
    "left_hip": 0.019,
    "spine1": 0.017,
    "spine3": 0.0125,
    "neck": 0.0115,
}
_ARMS_M = {"left_shoulder": 0.013, "left_elbow": 0.021, "left_wrist": 0.022}
_PASSES = 30


def garment_variability(rest: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """(V,) metres that offsets vary by: an estimate from before any garment is registered.

    Args:
        rest: (V, 3) metres, in the rest pose, Z up.
        joints: (24, 3) in the same pose.
    """

    def place(name: str) -> np.ndarray:
        return joints[JOINT_NAMES.index(name)]

    heights = [place(name)[2] for name in _TORSO_AND_LEGS_M]
    reaches = [place(name)[0] for name in _ARMS_M]
    reach = np.abs(rest[:, 0])
    along_torso = np.interp(rest[:, 2], heights, list(_TORSO_AND_LEGS_M.values()))
    along_arm = np.interp(reach, reaches, list(_ARMS_M.values()))
    is_arm = (reach > reaches[0]) & (rest[:, 2] > place("spine2")[2])
    return np.where(is_arm, along_arm, along_torso)


def segment_body(
    rest: np.ndarray, faces: np.ndarray, skirt_faces: np.ndarray, variability: np.ndarray
) -> np.ndarray:
    """Divide the body.

    Args:
        rest: (V, 3) metres, in the rest pose.
        faces, skirt_faces: (F, 3) and (F2, 3) of both topologies; each segment is in one piece in
            either.
        variability: (V,) positive, such as the standard deviation of each vertex's offsets.

    Returns:
        (V,) int32: 0 to 4 in the middle, 5 to 12 on the left, 13 to 20 their counterparts on the
        right, each group from the top downwards.
    """
    graph = _graph(rest, faces, skirt_faces, variability)
    share = vertex_areas(rest, faces) * variability
    tree = KDTree(rest)
    middle, left = _first_seeds(rest, graph, tree)
    for _ in range(_PASSES):
        label = _cells(graph, _all_seeds(middle, left, rest, tree))
        centre = [
            np.average(rest[label == k], axis=0, weights=share[label == k])
            for k in range(MIDDLE + PAIRS)
        ]
        moved = (
            [
                _nearest(
                    rest, np.flatnonzero((label == k) & _in_plane(rest)), centre[k] * [0, 1, 1]
                )
                for k in range(MIDDLE)
            ],
            [
                _nearest(rest, np.flatnonzero((label == k) & ~_in_plane(rest)), centre[k])
                for k in range(MIDDLE, MIDDLE + PAIRS)
            ],
        )
        if moved == (middle, left):
            break
        middle, left = moved
    middle, left = (sorted(seeds, key=lambda v: -rest[v, 2]) for seeds in (middle, left))
    return _cells(graph, _all_seeds(middle, left, rest, tree)).astype(np.int32)


def _graph(
    rest: np.ndarray, faces: np.ndarray, skirt_faces: np.ndarray, variability: np.ndarray
) -> csr_matrix:
    """(V, V) lengths in the measure, of the edges that both topologies have."""
    count = len(rest)
    codes = [
        pairs[:, 0].astype(np.int64) * count + pairs[:, 1]
        for pairs in map(edges, (faces, skirt_faces))
    ]
    common = np.intersect1d(*codes)
    pairs = np.stack([common // count, common % count], axis=1)
    scale = np.sqrt(variability[pairs].mean(axis=1))
    lengths = edge_lengths(rest, pairs) * scale
    return csr_matrix((lengths, pairs.T), shape=(count, count))


def vertex_areas(rest: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(V,) a third of the faces around each vertex, square metres."""
    a, b, c = (rest[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    return np.bincount(faces.ravel(), np.repeat(area, 3), len(rest))


def _in_plane(rest: np.ndarray) -> np.ndarray:
    """(V,) bool, vertices in the plane of symmetry, or near it where a mesh has none there."""
    reach = np.abs(rest[:, 0])
    return reach < max(1e-5, 2 * np.sort(reach)[len(reach) // 200])


def _first_seeds(rest: np.ndarray, graph: csr_matrix, tree: KDTree) -> tuple[list[int], list[int]]:
    """Seeds far from one another: each is the farthest from those before it."""
    in_plane = _in_plane(rest)
    side = ~in_plane & (rest[:, 0] > 0)
    middle = [int(np.flatnonzero(in_plane)[rest[in_plane, 2].argmax()])]
    left: list[int] = []
    while len(left) < PAIRS:
        wanted, seeds = (in_plane, middle) if len(middle) < MIDDLE else (side, left)
        far = dijkstra(
            graph, directed=False, indices=_all_seeds(middle, left, rest, tree), min_only=True
        )
        candidates = np.flatnonzero(wanted)
        seeds.append(int(candidates[far[candidates].argmax()]))
    return middle, left


def _all_seeds(middle: list[int], left: list[int], rest: np.ndarray, tree: KDTree) -> list[int]:
    """Seeds in the order of the segments, the right ones where the left ones' images are."""
    right = tree.query(rest[left].reshape(-1, 3) * [-1, 1, 1])[1].tolist()
    return [*middle, *left, *right]


def _cells(graph: csr_matrix, seeds: list[int]) -> np.ndarray:
    """(V,) index of the seed that is nearest along the graph; every cell is in one piece."""
    nearest = dijkstra(
        graph, directed=False, indices=seeds, min_only=True, return_predecessors=True
    )[2]
    index = np.zeros(graph.shape[0], dtype=np.int64)
    index[seeds] = np.arange(len(seeds))
    return index[nearest]


def _nearest(rest: np.ndarray, candidates: np.ndarray, place: np.ndarray) -> int:
    return int(candidates[np.linalg.norm(rest[candidates] - place, axis=1).argmin()])
