"""The canonical network, its baseline and their loss."""

import numpy as np
import pytest
import torch

from drapeline.models.garment4d.canonical import (
    CanonicalNetwork,
    CanonicalOutput,
    PointNetRegressor,
    first_of,
    hashed_order,
)
from drapeline.models.garment4d.losses import CotangentLaplacian, balance_labels, canonical_loss
from drapeline.models.garment4d.settings import (
    Abstraction,
    CanonicalLayers,
    CanonicalSettings,
    CanonicalWeights,
)
from drapeline.models.layers.pointnet import PointLevel
from drapeline.outfits.garment_types import LABELS
from drapeline.registration.to_template.garment_space import fit_space
from toys.paper import printed

LABEL = LABELS.index("Skirt")
LAYERS = CanonicalLayers(
    segmentation=(
        Abstraction(centres=40, radii=(0.2, 0.4), neighbours=(6, 8), widths=((8,), (8,))),
        Abstraction(centres=10, radii=(0.4, 0.8), neighbours=(6, 8), widths=((8, 8), (8,))),
    ),
    propagation=((16,), (16,)),
    garment=(
        Abstraction(centres=20, radii=(0.2, 0.4), neighbours=(6, 8), widths=((8, 8), (8,))),
        Abstraction(centres=6, radii=(0.8,), neighbours=(8,), widths=((16,),)),
    ),
    overall=(16,),
    head=(16,),
)
SETTINGS = CanonicalSettings(width=1, points=6890, layers=LAYERS, garment_points=40)
PRINTED = CanonicalWeights(**printed("garment4d.canonical.loss"))
AROUND, RINGS = 12, 5
GRID = np.arange(AROUND * RINGS).reshape(RINGS, AROUND)


def rng(seed=0):
    return torch.Generator().manual_seed(seed)


def tube(length, radius):
    """An open tube under the root, (N, 3)."""
    angle = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    height = np.linspace(0, 1, RINGS)[:, None, None]
    wide = radius * (1 + height)
    return (wide * ring - height * [0, 0, length]).reshape(-1, 3).astype(np.float32)


def tube_faces():
    a, b = GRID[:-1], GRID[1:]
    right, below = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    return np.concatenate(
        [np.stack(t, -1).reshape(-1, 3) for t in ((a, b, right), (right, b, below))]
    )


@pytest.fixture(scope="module")
def space():
    draw = np.random.Generator(np.random.PCG64(0))
    garments = [tube(draw.uniform(0.3, 0.9), draw.uniform(0.1, 0.2)) for _ in range(20)]
    return fit_space(np.stack(garments), 2, tube_faces())


def windows(space, count, frames=2, points=120, seed=0):
    """Clouds of tubes in their space (label 4) and of a ball above them (label 0)."""
    draw = rng(seed)
    alpha = torch.randn(count, len(space.components), generator=draw).clamp(-1.5, 1.5)
    garments = torch.from_numpy(space.vertices(alpha.numpy()))
    half = points // 2
    pick = torch.randint(garments.shape[1] - AROUND, (count, frames, half), generator=draw)
    share = torch.rand(count, frames, half, 1, generator=draw)
    upper, lower = (
        torch.stack([garments[b][pick[b] + step] for b in range(count)]) for step in (0, AROUND)
    )
    cloth = upper + share * (lower - upper)
    ball = torch.randn(count, frames, points - half, 3, generator=draw)
    ball = 0.2 * ball / ball.norm(dim=-1, keepdim=True) + torch.tensor([0, 0, 0.3])
    order = torch.randperm(points, generator=draw)
    labels = torch.zeros(count, frames, points, dtype=torch.int64)
    labels[..., :half] = LABEL
    return torch.cat([cloth, ball], 2)[:, :, order], labels[:, :, order], alpha, garments


@pytest.fixture(scope="module")
def network(space):
    network = CanonicalNetwork(SETTINGS, space, LABEL, rng()).eval()
    points, _, _, _ = windows(space, 2)
    with torch.no_grad():  # let an untrained one call half of the points a skirt
        logits = network(points).logits.flatten(0, 2)
        rivals = logits[:, [i for i in range(len(LABELS)) if i != LABEL]].amax(1)
        network.segmentation.head[-1].bias[LABEL] += (rivals - logits[:, LABEL]).median()
    return network.eval()


def both(space):
    return [
        CanonicalNetwork(SETTINGS, space, LABEL, rng()).eval(),
        PointNetRegressor(SETTINGS, space, rng()).eval(),
    ]


def parts(output):
    return [output.coefficients, output.vertices, *(x for level in output.levels for x in level)]


def test_the_order_of_points_and_of_frames_does_not_matter(network, space):
    points, labels, _, _ = windows(space, 2)
    order = torch.randperm(points.shape[2], generator=rng(1))
    for given in (None, labels):
        plain = network(points, given)
        mixed = network(points[:, :, order], given[:, :, order] if given is not None else None)
        torch.testing.assert_close(mixed.logits, plain.logits[:, :, order])
        for a, b in zip(parts(mixed), parts(plain), strict=True):
            torch.testing.assert_close(a, b)
        back = network(points.flip(1), given.flip(1) if given is not None else None)
        torch.testing.assert_close(back.coefficients, plain.coefficients)


def test_a_batch_is_its_windows_one_by_one(network, space):
    points, _, _, _ = windows(space, 3)
    regressor = both(space)[1]
    for model in (network, regressor):
        whole = model(points)
        for b in range(3):
            one = model(points[b : b + 1])
            torch.testing.assert_close(one.vertices[0], whole.vertices[b])
            torch.testing.assert_close(
                one.levels[-1].features, whole.levels[-1].features[2 * b : 2 * b + 2]
            )


def test_levels_hold_the_garments_points_alone(network, space):
    points, labels, _, _ = windows(space, 2)
    output = network(points, labels)
    clouds, found = points.flatten(0, 1), labels.flatten(0, 1) == LABEL
    assert [level.points.shape[1] for level in output.levels] == [40, 20, 6]
    for level, width in zip(output.levels, network.level_channels, strict=True):
        assert level.features.shape[-1] == width
        assert level.valid.all()
        for cloud, mask, chosen in zip(clouds, found, level.points, strict=True):
            same = (chosen[:, None] == cloud[mask]).all(-1)
            assert same.any(1).all()


def test_predicted_labels_choose_the_points_unless_labels_are_given(network, space):
    points, labels, _, _ = windows(space, 2)
    predicted = network(points).logits.argmax(-1)
    assert 0 < (predicted == LABEL).float().mean() < 1
    same, other = network(points, predicted), network(points, labels)
    torch.testing.assert_close(same.vertices, network(points).vertices)
    assert not torch.allclose(other.vertices, same.vertices)
    torch.testing.assert_close(other.logits, same.logits)


def test_frames_without_garment_points_have_no_say(network, space):
    points, labels, _, _ = windows(space, 2, frames=3)
    hidden = labels.clone()
    hidden[:, 1] = 0
    output = network(points, hidden)
    without = network(points[:, [0, 2]], labels[:, [0, 2]])
    torch.testing.assert_close(output.coefficients, without.coefficients)
    assert not output.levels[0].valid.view(2, 3, -1)[:, 1].any()


def test_windows_without_any_garment_point_give_one_finite_garment(network, space):
    points, labels, _, _ = windows(space, 2)
    output = network(points, torch.zeros_like(labels))
    assert all(torch.isfinite(part).all() for part in parts(output))
    assert not any(level.valid.any() for level in output.levels)
    torch.testing.assert_close(output.coefficients[0], output.coefficients[1])


def test_a_hashed_order_is_an_order_of_the_points_themselves():
    points = torch.randint(-50, 50, (3, 200, 3), generator=rng()) / 64
    points = torch.unique(points.flatten(0, 1), dim=0)[None]
    order = hashed_order(points)
    assert (order.sort(dim=1).values == torch.arange(points.shape[1])).all()
    mixed = points[:, torch.randperm(points.shape[1], generator=rng(1))]
    assert torch.equal(mixed[0, hashed_order(mixed)[0]], points[0, order[0]])
    # The first tenth is spread like the whole, though coordinates came in sorted.
    first = points[0, order[0, : points.shape[1] // 10]]
    torch.testing.assert_close(first.mean(0), points[0].mean(0), atol=0.15, rtol=0)
    assert torch.equal(hashed_order(-0.0 * points), hashed_order(0.0 * points))


def test_first_of_keeps_order_and_pads_with_zeros():
    valid = torch.tensor([[False, True, False, True, True], [False] * 4 + [True]])
    place = torch.arange(1, 31.0).view(2, 5, 3)
    level = first_of(PointLevel(place, 10 * place[..., :2], valid), 2)
    assert level.valid.tolist() == [[True, True], [True, False]]
    assert level.points[0].tolist() == place[0, [1, 3]].tolist()
    assert level.points[1].tolist() == [place[1, 4].tolist(), [0, 0, 0]]
    assert level.features[1].tolist() == [(10 * place[1, 4, :2]).tolist(), [0, 0]]


def test_vertices_are_the_spaces(network, space):
    alpha = torch.randn(4, 2, generator=rng())
    np.testing.assert_allclose(
        network.vertices(alpha).numpy(), space.vertices(alpha.numpy()), atol=1e-6
    )


def loss_of(output, labels, alpha, garments, weights=None, label_weights=None):
    """With a body far inside the garments, so that nothing penetrates it."""
    body = torch.tensor([[0.0, 0.0, -0.01]]).expand(len(alpha), -1, -1)
    normals = torch.zeros_like(body)
    laplacian = CotangentLaplacian(tube(0.6, 0.15), tube_faces())
    weights = weights or PRINTED
    return canonical_loss(
        output, labels, alpha, garments, body, normals, laplacian, weights, label_weights
    )


def test_the_loss_of_the_truth_is_zero_and_its_terms_are_those_of_equation_4(space):
    _, labels, alpha, garments = windows(space, 3)
    logits = 50.0 * torch.nn.functional.one_hot(labels, len(LABELS))
    terms = loss_of(CanonicalOutput(logits, alpha, garments, []), labels, alpha, garments)
    assert terms["total"] == pytest.approx(0, abs=1e-6)
    wrong = CanonicalOutput(0 * logits, alpha + 0.5, garments + 0.01, [])
    terms = loss_of(wrong, labels, alpha, garments)
    assert terms["segmentation"] == pytest.approx(np.log(len(LABELS)), rel=1e-6)
    assert terms["coefficients"] == pytest.approx(2 * 0.5**2, rel=1e-5)
    assert terms["vertices"] == pytest.approx(3 * 0.01**2, rel=1e-3)
    assert terms["laplacian"] == pytest.approx(0, abs=1e-6)  # a shift has no Laplacian
    weighed = (
        0.05 * terms["segmentation"]
        + 0.001 * terms["coefficients"]
        + 40 * terms["vertices"]
        + 50 * terms["interpenetration"]
        + terms["laplacian"]
    )
    torch.testing.assert_close(terms["total"], weighed)
    regressed = loss_of(wrong._replace(logits=None), labels, alpha, garments)
    assert "segmentation" not in regressed
    torch.testing.assert_close(regressed["total"], weighed - 0.05 * terms["segmentation"])


@pytest.mark.parametrize(("form", "power"), [("paper", 2), ("released", 1)])
def test_the_laplacian_term_compares_lengths_or_their_squares(space, form, power):
    _, labels, alpha, garments = windows(space, 2)
    weights = PRINTED.replace(laplacian_form=form)
    rougher = CanonicalOutput(None, alpha, 3 * garments, [])
    terms = loss_of(rougher, labels, alpha, garments, weights)
    lengths = CotangentLaplacian(tube(0.6, 0.15), tube_faces())(garments).norm(dim=-1)
    wanted = (3**power - 1) * (lengths**power).mean()
    torch.testing.assert_close(terms["laplacian"], wanted, rtol=1e-4, atol=0)


def test_the_loss_sees_penetration_in_metres(space):
    _, labels, alpha, garments = windows(space, 1)
    body = garments + torch.tensor([0, 0, 0.02])
    normals = torch.tensor([0.0, 0, 1]).expand_as(body)
    weights = PRINTED.replace(interpenetration=7)
    laplacian = CotangentLaplacian(tube(0.6, 0.15), tube_faces())
    output = CanonicalOutput(None, alpha, garments, [])
    terms = canonical_loss(output, labels, alpha, garments, body, normals, laplacian, weights)
    assert terms["interpenetration"] == pytest.approx(0.02, rel=1e-3)
    assert terms["total"] == pytest.approx(0.14, rel=1e-3)


def test_labels_are_balanced_by_their_share(space):
    share = np.array([0.64, 0.32, 0.04, 0, 0, 0, 0])
    assert balance_labels(share, 0).tolist() == [1, 1, 1, 0, 0, 0, 0]
    half = balance_labels(share, 0.5).numpy()
    assert half[2] / half[0] == pytest.approx(4)  # sqrt(0.64 / 0.04)
    assert (half * share).sum() == pytest.approx(1)
    assert (balance_labels(share, 1) * torch.from_numpy(share))[:3].tolist() == pytest.approx(
        [1 / 3] * 3
    )
    # A point with a heavy label counts as much as several with light ones.
    _, labels, alpha, garments = windows(space, 3)
    logits = torch.randn(*labels.shape, len(LABELS), generator=rng())
    output = CanonicalOutput(logits, alpha, garments, [])
    weights = balance_labels(np.full(len(LABELS), 1 / len(LABELS)), 0.5)
    even = loss_of(output, labels, alpha, garments, label_weights=weights)
    plain = loss_of(output, labels, alpha, garments)
    torch.testing.assert_close(even["segmentation"], plain["segmentation"])
    weights[labels[0, 0, 0]] = 5.0
    rest = torch.nn.functional.cross_entropy(
        logits.flatten(0, 2), labels.flatten(), reduction="none"
    )
    expected = (rest * weights[labels.flatten()]).mean()
    heavy = loss_of(output, labels, alpha, garments, label_weights=weights)
    torch.testing.assert_close(heavy["segmentation"], expected)


def test_every_parameter_gets_a_gradient(space):
    points, labels, alpha, garments = windows(space, 3)
    for model in both(space):
        output = model(points, labels) if isinstance(model, CanonicalNetwork) else model(points)
        loss_of(output, labels, alpha, garments)["total"].backward()
        for name, parameter in model.named_parameters():
            assert parameter.grad is not None, name
            assert torch.isfinite(parameter.grad).all(), name
            assert parameter.grad.any(), name


def test_both_networks_learn_shapes_by_heart_and_one_the_labels(space):
    points, labels, alpha, garments = windows(space, 8)
    for model in both(space):
        segments = isinstance(model, CanonicalNetwork)
        optimiser, distance, entropy = torch.optim.Adam(model.parameters(), lr=0.01), [], []
        for _ in range(70):
            output = model(points, labels) if segments else model(points)
            loss = loss_of(output, labels, alpha, garments)
            optimiser.zero_grad()
            loss["total"].backward()
            optimiser.step()
            distance.append(loss["vertices"].item() ** 0.5)
            if segments:
                entropy.append(loss["segmentation"].item())
        assert min(distance) < 0.1 * distance[0]
        if segments:
            assert min(entropy) < 0.1 * entropy[0]


def test_weights_come_from_the_generator_alone(space):
    twins = [CanonicalNetwork(SETTINGS, space, LABEL, rng(seed)) for seed in (3, 3, 4)]
    states = [torch.cat([p.flatten() for p in twin.parameters()]) for twin in twins]
    assert torch.equal(states[0], states[1])
    assert not torch.equal(states[0], states[2])


def test_scaled_settings_keep_the_number_of_points_per_ball():
    paper = CanonicalLayers()
    assert paper.scale(6890, 1.0) == paper
    small = paper.scale(6890 // 4, 0.5)
    assert [level.centres for level in small.segmentation] == [512, 128, 32]
    assert small.garment_points == pytest.approx(1722 / 4, abs=1)
    assert small.segmentation[0].radii == pytest.approx((0.1, 0.2), rel=1e-3)
    assert small.segmentation[1].radii == pytest.approx((0.1 * 2**0.5, 0.2 * 2**0.5), rel=1e-3)
    assert small.segmentation[0].widths == ((8, 8, 16), (16, 16, 32))
    assert small.propagation[-1] == (64, 32)
