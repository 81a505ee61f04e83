"""Flat sheets, and what tests measure of meshes: pieces and sections."""

import numpy as np
from scipy.sparse.csgraph import connected_components

from drapeline.geometry.mesh import edge_graph


def flat_sheet(width, height, step, x0=0.0, y0=0.0):
    """A flat sheet in z = 0 that faces up."""
    x, y = np.arange(width) * step + x0, np.arange(height) * step + y0
    vertices = np.stack([*np.meshgrid(x, y, indexing="xy"), np.zeros((height, width))], -1)
    corner = (np.arange(height - 1)[:, None] * width + np.arange(width - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + width + 1], -1)
    upper = np.stack([corner, corner + width + 1, corner + width], -1)
    return vertices.reshape(-1, 3), np.concatenate([lower, upper])


def piece_count(pairs, count):
    """Connected pieces of `count` vertices joined by edges (E, 2)."""
    return connected_components(edge_graph(pairs, count), directed=False)[0]


def section(vertices, faces, height):
    """(P, 2) where edges cross a horizontal plane, and the area that the cut encloses."""
    points, area = [], 0.0
    for face in faces:
        z = vertices[face, 2] - height
        if (z > 0).all() or (z <= 0).all():
            continue
        ends = []
        for k in range(3):
            a, b = vertices[face[k]], vertices[face[k - 2]]
            if (z[k] > 0) != (z[k - 2] > 0):
                end = a + (b - a) * z[k] / (z[k] - z[k - 2])
                ends.append((z[k] > 0, end[:2]))
        (_, tail), (_, head) = sorted(ends, key=lambda e: e[0])
        points += [tail, head]
        area += (tail[0] * head[1] - tail[1] * head[0]) / 2
    return np.array(points), abs(area)
