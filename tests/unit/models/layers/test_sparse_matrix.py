import pytest
import torch

from drapeline.geometry.mesh import edges
from drapeline.models.layers.mesh_graph import scaled_laplacian
from drapeline.models.layers.sparse_matrix import SparseMatrix
from gcvae_toys import VERTICES, tube_faces


@pytest.fixture(autouse=True)
def _double():
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


@pytest.fixture
def laplacian():
    return scaled_laplacian(edges(tube_faces(True)), VERTICES)


def test_a_product_and_its_gradients_are_those_of_the_dense_matrix(laplacian):
    part = laplacian[:, :50]
    matrix, dense = SparseMatrix(part), torch.from_numpy(part.toarray())
    x = torch.randn(50, 3, 2, generator=torch.Generator().manual_seed(0), requires_grad=True)
    torch.testing.assert_close(matrix(x), torch.einsum("mn,nbf->mbf", dense, x))
    assert torch.autograd.gradcheck(matrix, x)
    assert torch.autograd.gradgradcheck(matrix, x)


def test_a_matrix_follows_its_module_but_stays_out_of_checkpoints(laplacian):
    matrix = SparseMatrix(laplacian)
    assert not matrix.state_dict()
    assert matrix.float().forward_value.dtype == torch.float32
