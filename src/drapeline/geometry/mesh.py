"""Polygon meshes: what a mesh is, OBJ files in the CLOTH3D manner, and topology facts."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix

from drapeline.errors import InputError
from drapeline.storage import atomic_file


@dataclass(frozen=True)
class Mesh:
    """A mesh of quads or of triangles, in metres.

    Attributes:
        vertices: (V, 3) float32.
        faces: (F, 4) or (F, 3) int32, counter-clockwise seen from outside.
        uv: (T, 2) float32 texture coordinates or None.
        uv_faces: (F, 4) or (F, 3) int32 into `uv`, or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None = None
    uv_faces: np.ndarray | None = None

    @property
    def triangles(self) -> np.ndarray:
        """(F', 3) int32; a quad (0,1,2,3) becomes (0,1,2) and (0,2,3) as CLOTH3D readers do."""
        return triangulate(self.faces)


def triangulate(faces: np.ndarray) -> np.ndarray:
    """(F, 4) or (F, 3) -> (F', 3); the two halves of a quad follow one another."""
    if faces.shape[1] == 3:
        return faces
    return faces[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def edges(faces: np.ndarray) -> np.ndarray:
    """(E, 2) undirected unique edges of a polygon mesh, each sorted, in lexical order."""
    return edge_counts(faces)[0]


def edge_counts(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Undirected edges (E, 2) and the number of faces (E,) on each."""
    found, _, counts = _unique_edges(_half_edges(faces))
    return found, counts


def edge_graph(pairs: np.ndarray, count: int) -> csr_matrix:
    """(V, V) symmetric adjacency: 1 where undirected edges (E, 2), each once, join two vertices."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    return csr_matrix((np.ones(len(both)), both.T), shape=(count, count))


def boundary_edges(faces: np.ndarray) -> np.ndarray:
    """(R, 2) undirected edges that one face has."""
    found, counts = edge_counts(faces)
    return found[counts == 1]


def faces_within(faces: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(F', 3) faces with all corners in the mask (V,)."""
    return faces[mask[faces].all(axis=1)]


def _half_edges(faces: np.ndarray) -> np.ndarray:
    """(F * corners, 2) directed edges, face by face."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)


def _unique_edges(half: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Undirected edges (E, 2) in lexical order, which of them each half is, and their counts."""
    low, high = half.min(axis=1).astype(np.int64), half.max(axis=1)
    base = int(high.max(initial=0)) + 1
    # One number for an edge sorts ten times faster than a row of two.
    key, which, counts = np.unique(low * base + high, return_inverse=True, return_counts=True)
    return np.stack(np.divmod(key, base), axis=1).astype(half.dtype), which, counts


def boundary_loops(faces: np.ndarray) -> list[np.ndarray]:
    """Closed boundary loops, each an ordered array of vertex ids, longest first.

    Raises:
        ValueError: a boundary vertex has more than one boundary edge leaving it.
    """
    half = _half_edges(faces)
    _, which, counts = _unique_edges(half)
    open_half = half[counts[which] == 1]
    follow: dict[int, int] = {}
    for start, end in open_half.tolist():
        if start in follow:
            raise ValueError(f"vertex {start} lies on more than one boundary loop")
        follow[start] = end
    loops = []
    while follow:
        start = next(iter(follow))
        loop = [start]
        while (after := follow.pop(loop[-1])) != start:
            loop.append(after)
        loops.append(np.array(loop, dtype=np.int64))
    return sorted(loops, key=len, reverse=True)


def face_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals (..., F, 3) of triangles for vertices (..., V, 3); zero-area gives zero."""
    a, b, c = (vertices[..., triangles[:, i], :] for i in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-20)


def vertex_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Area-weighted unit normals (V, 3)."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], cross)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)


def save_obj(path: str | Path, mesh: Mesh) -> None:
    """Write `v`, `vt` and `f v/vt` lines only, one space between fields, as CLOTH3D does."""
    text = _lines("v %.6f %.6f %.6f", mesh.vertices)
    corner = "%d"
    faces = mesh.faces + 1
    if mesh.uv is not None and mesh.uv_faces is not None:
        text += _lines("vt %.6f %.6f", mesh.uv)
        corner = "%d/%d"
        faces = np.stack([faces, mesh.uv_faces + 1], axis=-1).reshape(len(faces), -1)
    text += _lines(" ".join(["f", *[corner] * mesh.faces.shape[1]]), faces)
    with atomic_file(path) as scratch:
        scratch.write_text(text)


def _lines(form: str, rows: np.ndarray) -> str:
    """One line per row; a single formatting of all rows is three times faster than one for each."""
    return (form + "\n") * len(rows) % tuple(rows.ravel().tolist())


def load_obj(path: str | Path) -> Mesh:
    """Read an OBJ of all quads or all triangles (`v`, `vt`, `f`; other lines are passed over).

    Faces of mixed sizes come back as triangles (fan split), without texture coordinates.

    Raises:
        InputError: missing file, no vertices or faces, a line that is not numbers, or a face
            that names a vertex the file lacks.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a Wavefront OBJ")
    text = path.read_text(errors="replace")
    tidy = _tidy_obj(text)
    if tidy is not None:
        return tidy
    vertices: list[list[float]] = []
    uv: list[list[float]] = []
    faces: list[list[int]] = []
    uv_faces: list[list[int]] = []
    for number, line in enumerate(text.splitlines(), 1):
        fields = line.split()
        if not fields:
            continue
        try:
            if fields[0] == "v":
                vertices.append([float(x) for x in fields[1:4]])
            elif fields[0] == "vt":
                uv.append([float(x) for x in fields[1:3]])
            elif fields[0] == "f":
                corners = [field.split("/") for field in fields[1:]]
                faces.append([_obj_index(c[0], len(vertices)) for c in corners])
                if all(len(c) > 1 and c[1] for c in corners):
                    uv_faces.append([_obj_index(c[1], len(uv)) for c in corners])
        except ValueError as error:
            raise InputError(f"{path}: line {number} is not OBJ: '{line.strip()}'") from error
    if not vertices or not faces:
        raise InputError(
            f"{path}: {len(vertices)} vertices and {len(faces)} faces, expected at least one each"
        )
    if any(len(v) != 3 for v in vertices):
        raise InputError(f"{path}: a vertex has fewer than three coordinates")
    sizes = {len(face) for face in faces}
    if min(sizes) < 3:
        raise InputError(f"{path}: a face has {min(sizes)} corners, expected at least three")
    if len(sizes) > 1 or max(sizes) > 4:
        faces = [[f[0], f[i], f[i + 1]] for f in faces for i in range(1, len(f) - 1)]
        uv_faces = []
    last = max(map(max, faces))
    if min(map(min, faces)) < 0 or last >= len(vertices):
        raise InputError(f"{path}: a face names vertex {last + 1}, expected 1 to {len(vertices)}")
    has_uv = len(uv_faces) == len(faces)
    return Mesh(
        np.array(vertices, dtype=np.float32),
        np.array(faces, dtype=np.int32),
        np.array(uv, dtype=np.float32) if has_uv else None,
        np.array(uv_faces, dtype=np.int32) if has_uv else None,
    )


_CORNERS_APART = str.maketrans("f/", "  ")
_NUMBER = r" -?\d+\.\d+"
_TIDY = re.compile(
    rf"((?:v{3 * _NUMBER}\n)++)((?:vt{2 * _NUMBER}\n)*+)(?:"
    + "|".join(rf"((?:f{n * corner}\n)++)" for corner in (r" \d+", r" \d+/\d+") for n in (3, 4))
    + ")",
    re.ASCII,
)


def _tidy_obj(text: str) -> Mesh | None:
    """A file laid out as `save_obj` does, seven times faster than line by line; None for others."""
    found = _TIDY.fullmatch(text)
    if found is None:
        return None
    faces_text = found[found.lastindex]
    points = np.fromstring(found[1].replace("v", ""), sep=" ").reshape(-1, 3)
    uv = np.fromstring(found[2].replace("vt", ""), sep=" ").reshape(-1, 2)
    numbers = np.fromstring(faces_text.translate(_CORNERS_APART), dtype=np.int64, sep=" ") - 1
    corners = numbers.reshape(faces_text.count("\n"), -1, 1 + ("/" in faces_text))
    counts = (len(points), len(uv))[: corners.shape[2]]
    if corners.min() < 0 or (corners.max(axis=(0, 1)) >= counts).any():
        return None
    tables = [np.ascontiguousarray(table, dtype=np.int32) for table in np.moveaxis(corners, 2, 0)]
    coordinates = [table.astype(np.float32) for table in (points, uv)][: len(tables)]
    return Mesh(coordinates[0], tables[0], *coordinates[1:], *tables[1:])


def _obj_index(text: str, count: int) -> int:
    """OBJ counts from 1, or backwards from the last one with negative numbers."""
    index = int(text)
    return index - 1 if index > 0 else count + index
