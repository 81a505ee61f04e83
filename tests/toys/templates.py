"""Toy skirts and templates for them."""

import numpy as np

from drapeline.geometry.mesh import boundary_loops, triangulate
from drapeline.registration.to_template.garment_template import GarmentTemplate, named_loops
from toys.tiny_sample import tube

NAMES = ("waist", "hem")


def toy_skirt(radius=0.2, low=-0.5, high=0.0, around=20, rows=9):
    """Vertices and triangles of an oval tube about Z."""
    mesh = tube(radius, low, high, around=around, rows=rows)
    return mesh.vertices.astype(float), triangulate(mesh.faces)


def round_skirt(radius=0.2, low=-0.5, high=0.0, around=32, rows=14, flare=0.0):
    """Vertices and triangles of a round tube about Z that may widen downwards."""
    vertices, triangles = toy_skirt(radius, low, high, around, rows)
    vertices[:, 1] /= 0.6
    vertices[:, :2] *= 1 + flare * (high - vertices[:, 2:])
    return vertices, triangles


def as_template(vertices, triangles, names=NAMES):
    """A mesh as the template of a type with these openings."""
    loop = np.full(len(vertices), -1, np.int32)
    for name, ids in named_loops(vertices, boundary_loops(triangles), names).items():
        loop[ids] = names.index(name)
    return GarmentTemplate(vertices.astype(np.float32), triangles.astype(np.int32), loop, names)


def toy_template():
    """A skirt with a waist and a hem."""
    return as_template(*toy_skirt(around=16, rows=8))
