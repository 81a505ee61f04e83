import igl
import numpy as np
import pytest
import torch

from drapeline.models.garment4d.losses import (
    CotangentLaplacian,
    UniformLaplacian,
    interpenetration,
    laplacian_difference,
    roughness,
    temporal_difference,
)
from toys.gcvae import tube, tube_faces


def sphere(count=400):
    """Points of a unit sphere, which are their own normals."""
    z = np.linspace(-1, 1, count)
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    ring = np.sqrt(1 - z**2)
    return torch.from_numpy(np.stack([ring * np.cos(turn), ring * np.sin(turn), z], 1)).float()


@pytest.mark.parametrize("depth", [0.3, 0.05, 0.0, -0.2])
def test_interpenetration_of_a_concentric_shell_is_its_depth(depth):
    body = sphere().expand(2, -1, -1)
    value = interpenetration((1 - depth) * body, body, body)
    torch.testing.assert_close(value, torch.tensor(max(depth, 0.0)), atol=1e-6, rtol=0)


def test_interpenetration_agrees_with_a_loop_and_pushes_out_along_the_normal():
    rng = torch.Generator().manual_seed(0)
    body = torch.stack([sphere(60), 1.3 * sphere(60)])
    normals = torch.stack([sphere(60)] * 2)
    garment = (1.2 * torch.randn(2, 30, 3, generator=rng)).requires_grad_()
    value = interpenetration(garment, body, normals)
    total, inside = 0.0, torch.zeros(2, 30, 3)
    for b in range(2):
        for i in range(30):
            near = (garment[b, i].detach() - body[b]).square().sum(1).argmin()
            height = float((garment[b, i].detach() - body[b, near]) @ normals[b, near])
            total += max(-height, 0.0)
            if height < 0:
                inside[b, i] = -normals[b, near]
    assert float(value.detach()) == pytest.approx(total / 60, rel=1e-5)
    (gradient,) = torch.autograd.grad(value, garment)
    torch.testing.assert_close(gradient, inside / 60)


def bent():
    """(V, 3) the tube of the toys, with no two vertices alike."""
    points = tube()
    return points + 0.02 * np.sin(40 * points[:, [1, 2, 0]])


def test_laplacian_is_that_of_libigl_on_every_frame():
    faces = tube_faces(False)
    laplacian = CotangentLaplacian(tube(), faces)
    matrix = igl.cotmatrix(tube(), faces.astype(np.int64))
    garments = np.stack([tube(), bent(), 2 * bent()])[None]
    wanted = np.stack([matrix @ one for one in garments[0]])[None]
    made = laplacian(torch.from_numpy(garments).float())
    np.testing.assert_allclose(made, wanted, atol=1e-6)


def test_laplacian_of_a_flat_regular_patch_is_zero_inside():
    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0))
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    corner = (6 * np.arange(5)[:, None] + np.arange(5)).ravel()
    faces = np.concatenate(
        [np.c_[corner, corner + 1, corner + 7], np.c_[corner, corner + 7, corner + 6]]
    )
    value = CotangentLaplacian(points, faces)(torch.from_numpy(points).float())
    inside = ((points[:, :2] > 0) & (points[:, :2] < 5)).all(1)
    assert value[inside].abs().max() < 1e-6
    assert value[~inside].norm(dim=1).max() > 0.5


@pytest.mark.parametrize(("form", "power"), [("paper", 2), ("released", 1)])
def test_laplacian_difference_scales_as_its_form_says_and_sees_only_roughness(form, power):
    laplacian = CotangentLaplacian(tube(), tube_faces(False))
    true = torch.from_numpy(bent()).float().expand(2, 3, -1, -1)
    assert float(laplacian_difference(laplacian, true, true, form)) == 0
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(0)))[0]
    moved = true @ turn + torch.tensor([1.0, 2.0, 3.0])
    assert float(laplacian_difference(laplacian, moved, true, form)) < 1e-4
    rough = laplacian(true).norm(dim=-1)
    larger = laplacian_difference(laplacian, 3 * true, true, form)
    torch.testing.assert_close(larger, (3**power - 1) * (rough**power).mean())
    smaller = laplacian_difference(laplacian, 0 * true, true, form)
    torch.testing.assert_close(smaller, (rough**power).mean())


def test_roughness_is_the_mean_distance_to_the_mean_of_the_neighbours():
    faces = tube_faces(False)
    garments = torch.from_numpy(np.stack([tube(), bent()])[None]).float()
    neighbours = [set() for _ in tube()]
    for face in faces.tolist():
        for corner in face:
            neighbours[corner] |= set(face) - {corner}
    wanted = np.mean(
        [
            np.linalg.norm(np.mean([one[n] for n in near], axis=0) - one[vertex])
            for one in garments[0].double().numpy()
            for vertex, near in enumerate(neighbours)
        ]
    )
    laplacian = UniformLaplacian(faces, len(tube()))
    assert float(roughness(laplacian, garments)) == pytest.approx(wanted, rel=1e-5)
    collapsed = torch.ones_like(garments)
    assert float(roughness(laplacian, collapsed)) < 1e-6


@pytest.mark.parametrize(("form", "wanted"), [("paper", 0.25), ("released", 0.5)])
def test_temporal_difference_of_steady_motion_is_its_step(form, wanted):
    start = torch.randn(2, 1, 7, 3, generator=torch.Generator().manual_seed(0))
    step = 0.5 * torch.nn.functional.normalize(torch.tensor([1.0, -2.0, 2.0]), dim=0)
    moving = start + step * torch.arange(5)[:, None, None]
    torch.testing.assert_close(temporal_difference(moving, form), torch.tensor(wanted))
    assert float(temporal_difference(moving[:, :1], form)) == 0


@pytest.mark.parametrize("form", ["paper", "released"])
def test_gradients_by_finite_differences_and_finite_where_nothing_moves(form):
    laplacian = CotangentLaplacian(tube(), tube_faces(False)).double()
    rng = torch.Generator().manual_seed(0)
    true = torch.from_numpy(bent()).expand(1, 2, -1, -1)
    garment = true + 0.01 * torch.randn(true.shape, generator=rng, dtype=torch.float64)

    def both(values):
        return laplacian_difference(laplacian, values, true, form) + temporal_difference(
            values, form
        )

    assert torch.autograd.gradcheck(both, garment.requires_grad_(), fast_mode=True)
    still = torch.zeros(1, 3, len(tube()), 3, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(
        temporal_difference(still, form)
        + laplacian_difference(laplacian, still, torch.zeros_like(still), form),
        still,
    )
    assert torch.isfinite(gradient).all()
