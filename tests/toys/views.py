"""A tube as a garment, and small pictures of it."""

import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.report.models.scene import view_picture
from toys.gcvae import tube, tube_faces

TUBE = Mesh((2 * tube() - [0, 0, 0.6]).astype(np.float32), tube_faces(False))


def shown(view, **settings):
    """A small picture of a view of the report."""
    return view_picture(view, size=(60, 64), samples=6, **settings).astype(int)


def coloured(picture):
    return np.ptp(picture, axis=2) > 25
