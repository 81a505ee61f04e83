"""The moving body, the part of its surface that cloth has to collide with, and the floor."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy.spatial import KDTree

from drapeline.frames import JOINT_NAMES
from drapeline.geometry.coarsen import coarsen_faces
from drapeline.geometry.point_cache import PointCache

# Far from most garments, and more than half of a body's faces.
_ENDS = (
    ("head",),
    *(
        tuple(f"{side}_{joint}" for joint in joints)
        for side in ("left", "right")
        for joints in (("wrist", "hand"), ("ankle", "foot"))
    ),
)
_SPARE_M = 0.1  # how much farther cloth may swing than it stands off at first
_EVERY = 5  # frames between looks at where the ends of the body are


class MovingBody:
    """A surface over time, read from disk frame by frame.

    Attributes:
        faces: (F, 3) int, outward, of its own vertices.
        segments: (B,) int, the joint that moves each vertex most.
        floor_m: (N,) height of the floor beneath it in each frame; None if there is no floor.
        roots: (N, 3) float32 positions of the root joint; None if nothing is published.
    """

    def __init__(
        self,
        frames: PointCache,
        faces: np.ndarray,
        segments: np.ndarray,
        vertices: np.ndarray | None = None,
        floor_m: np.ndarray | None = None,
        roots: np.ndarray | None = None,
    ) -> None:
        """A surface through all vertices of a cache, or through some.

        Args:
            frames: world positions in metres; it stays open as long as they are asked for.
            vertices: (B,) int, those of the cache that are the surface's; all if None.
            floor_m, roots: see `MovingBody`.
        """
        self.faces, self.segments, self.floor_m, self.roots = faces, segments, floor_m, roots
        self._frames = frames
        self._vertices = slice(None) if vertices is None else vertices

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self.frame(index) for index in range(len(self)))

    def frame(self, index: int) -> np.ndarray:
        """World vertices (B, 3) float32 in metres."""
        return self._frames.frames(index, index + 1)[0, self._vertices]

    def restrict(self, faces: np.ndarray) -> "MovingBody":
        """The surface of some faces (F', 3) of these vertices, without vertices of no face."""
        used, corners = np.unique(faces, return_inverse=True)
        return MovingBody(
            self._frames,
            corners.reshape(faces.shape),
            self.segments[used],
            np.arange(self._frames.vertex_count)[self._vertices][used],
            self.floor_m,
            self.roots,
        )

    def publish(self, vertices: np.ndarray, index: int) -> np.ndarray:
        """What is published of world vertices (V, 3) of a frame; without `roots`, just these."""
        return vertices if self.roots is None else as_published(vertices - self.roots[index])


def as_published(vertices: np.ndarray) -> np.ndarray:
    """Root-relative vertices as PC16 files have them, in half precision, as float32."""
    return vertices.astype(np.float16).astype(np.float32)


def make_collider(body: MovingBody, garments: Sequence[np.ndarray], share: float) -> MovingBody:
    """The surface to collide with: no ends that cloth cannot reach, and fewer triangles.

    Args:
        body: all of the body.
        garments: vertices (V, 3) of each garment in frame 0.
        share: of the triangles that is kept, up to 1.

    Returns:
        Some of the body's vertices, in the same order.
    """
    reachable = reachable_vertices(body.segments, body, garments)
    near = body.faces[reachable[body.faces].all(axis=1)]
    return body.restrict(coarsen_faces(body.frame(0), near, share))


def reachable_vertices(
    segments: np.ndarray, frames: Iterable[np.ndarray], garments: Iterable[np.ndarray]
) -> np.ndarray:
    """Mask (B,) of the vertices that collide: all but heads, hands, feet that no cloth reaches.

    Args:
        segments: (B,) int, the joint that moves each vertex most.
        frames: vertices (B, 3) over time.
        garments: vertices (V, 3) of each garment in the first frame.
    """
    end_of_joint = np.full(len(JOINT_NAMES), -1)
    for number, names in enumerate(_ENDS):
        end_of_joint[[JOINT_NAMES.index(name) for name in names]] = number
    end = end_of_joint[segments]
    reached = np.zeros(len(_ENDS), dtype=bool)
    covered = np.zeros(0, dtype=np.int64)
    reach = 0.0
    for index, vertices in enumerate(frames):
        if index == 0:
            cloth = np.concatenate(list(garments))
            distance, nearest = KDTree(vertices).query(cloth)
            covered = np.unique(nearest)[::2]
            reach = float(distance.max()) + _SPARE_M
        if index % _EVERY:
            continue
        tree = KDTree(vertices[covered])
        for number in np.flatnonzero(~reached):
            member = np.flatnonzero(end == number)[::4]
            # Vertices that cloth lies on belong to what is covered, at distance zero.
            away, _ = tree.query(vertices[member], distance_upper_bound=reach)
            reached[number] = np.isfinite(away).any()
    return (end < 0) | reached[end]
