"""What tests of layers share."""

import pytest
import torch

from drapeline.geometry.mesh import edges
from drapeline.models.layers.graphs import scaled_laplacian
from toys.gcvae import VERTICES, tube_faces


@pytest.fixture
def double():
    """New tensors have 64 bits."""
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


@pytest.fixture
def laplacian():
    return scaled_laplacian(edges(tube_faces(True)), VERTICES)
