import pytest
import torch

from drapeline.models.layers.graphs import SparseMatrix

pytestmark = pytest.mark.usefixtures("double")


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
