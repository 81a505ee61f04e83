"""Toy skirts and a template for them."""

import numpy as np

from drapeline.geometry.mesh import boundary_loops, triangulate
from drapeline.registration.to_template.garment_template import GarmentTemplate, named_loops
from tiny_sample import tube

NAMES = ("waist", "hem")


def toy_skirt(radius, low, around=20, rows=9):
    """Vertices and triangles of a tube from height 0 down to `low`."""
    mesh = tube(radius, low, 0.0, around=around, rows=rows)
    return mesh.vertices.astype(float), triangulate(mesh.faces)


def toy_template():
    """A skirt with a waist and a hem."""
    vertices, faces = toy_skirt(0.2, -0.5, around=16, rows=8)
    loop = np.full(len(vertices), -1, np.int32)
    for name, ids in named_loops(vertices, boundary_loops(faces), NAMES).items():
        loop[ids] = NAMES.index(name)
    return GarmentTemplate(vertices.astype(np.float32), faces.astype(np.int32), loop, NAMES)
