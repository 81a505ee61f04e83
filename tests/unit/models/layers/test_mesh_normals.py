import numpy as np
import torch

from drapeline.geometry.mesh import face_normals
from drapeline.models.layers.graphs import FaceNormals
from toys.gcvae import VERTICES, tube, tube_faces


def test_normals_are_those_of_the_mesh():
    faces, points = tube_faces(False), np.stack([tube(), tube()[:, [1, 2, 0]] ** 2])
    normals = FaceNormals(faces, VERTICES, parts=1, rng=np.random.default_rng(0))
    made = normals(torch.from_numpy(points).float().permute(1, 2, 0))
    np.testing.assert_allclose(made.permute(2, 0, 1), face_normals(points, faces), atol=1e-4)


def test_parts_share_out_all_faces_and_a_part_is_chosen_among_them():
    faces = tube_faces(False)
    normals = FaceNormals(faces, VERTICES, parts=4, rng=np.random.default_rng(0))
    corners = torch.cat([getattr(normals, f"corners_{part}") for part in range(4)])
    assert {tuple(f) for f in corners.tolist()} == {tuple(f) for f in faces.tolist()}
    mask = torch.zeros(VERTICES, 2, dtype=torch.bool)
    mask[: VERTICES // 2, 1] = True
    among = torch.cat([normals.mask(mask, part) for part in range(4)])
    inside = mask.numpy()[:, 1][faces].all(1)
    assert not among[:, 0].any()
    assert among[:, 1].sum() == inside.sum()


def test_gradients_by_finite_differences_and_none_of_nan_where_a_face_has_no_area():
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    normals = FaceNormals(faces, 4, parts=1, rng=np.random.default_rng(0)).double()
    points = torch.randn(4, 3, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    assert torch.autograd.gradcheck(normals, points.requires_grad_(True))
    flat = torch.zeros(4, 3, 1, dtype=torch.float64, requires_grad=True)
    normals(flat).sum().backward()
    assert torch.isfinite(flat.grad).all()
