"""The canonical network, and the regression that it starts from."""

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.garment4d import canonical
from drapeline.models.garment4d.canonical import (
    CanonicalNetwork,
    CanonicalOutput,
    MapRegression,
    PointNetRegressor,
    body_map,
    first_of,
    hashed_order,
    map_cells,
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
from drapeline.seeding import rng_for
from toys.garment4d import fill_regression
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
SETTINGS = CanonicalSettings(
    width=1, points=6890, layers=LAYERS, garment_points=40, body_relative_points=False
)
PRINTED = CanonicalWeights(**printed("garment4d.canonical.loss"))
AROUND, RINGS = 12, 5
GRID = np.arange(AROUND * RINGS).reshape(RINGS, AROUND)
SEQUENCES = ["a", "a", "a", "b", "c", "c", "d", "e", "e", "f", "g", "h"]


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


def test_a_sleeve_decides_about_points_out_of_its_reach(space):
    """All labels of a cloud may change with the height of points on an arm, in any frame."""
    network = CanonicalNetwork(
        SETTINGS.replace(body_relative_points=True), space, LABEL, rng()
    ).eval()
    points, _, _, _ = windows(space, 1)
    place = torch.cat([points, torch.zeros_like(points[..., :1])], -1)
    place[:, 0, 0] = torch.tensor([0.6, 0.0, 0.4, 0.0])
    raised = place.clone()
    raised[:, 0, 0, 3] = 2.0
    first, second = (network(torch.cat([points, x], -1)).logits[0, -1] for x in (place, raised))
    assert ((first - second).abs().amax(-1) > 1e-6).all()


@pytest.mark.parametrize("kind", ["canonical", "pointnet"])
def test_the_estimate_begins_with_what_maps_of_the_chosen_points_say(space, kind):
    settings = SETTINGS.replace(body_relative_points=True)
    network = (
        CanonicalNetwork(settings, space, LABEL, rng())
        if kind == "canonical"
        else PointNetRegressor(settings, space, rng())
    ).eval()
    points, labels, _, _ = windows(space, 2)
    given = (labels,) if kind == "canonical" else ()
    points = torch.cat([points, torch.randn(*points.shape[:3], 4, generator=rng(5))], -1)
    before = network(points, *given)
    fill_regression(network.regression)
    chosen = labels == LABEL if kind == "canonical" else torch.ones_like(labels, dtype=torch.bool)
    said = network.regression(network.maps(points, chosen))
    after = network(points, *given)
    torch.testing.assert_close(after.coefficients, before.coefficients + said)
    assert said.abs().max() > 1
    torch.testing.assert_close(after.vertices, network.vertices(after.coefficients))
    told = network(points, *given, initial_alpha=torch.ones_like(said))
    torch.testing.assert_close(told.coefficients, before.coefficients + 1)
    # Neither depends on the order of points.
    shuffled = torch.randperm(points.shape[2], generator=rng(7))
    again = network(points[:, :, shuffled], *(x[:, :, shuffled] for x in given))
    torch.testing.assert_close(again.coefficients, after.coefficients, atol=1e-4, rtol=1e-4)


def test_maps_show_share_depth_and_height_where_points_are(space):
    network = CanonicalNetwork(SETTINGS.replace(body_relative_points=True), space, LABEL, rng())
    # Two points at the left and the right of one cell, one above all cells, one alone in its cell.
    place = torch.tensor(
        [[0.26, -0.1, -0.49, 2.0], [-0.27, 0.3, -0.48, 1.0], [0.0, 0.2, 9.0, 0.5], [0.9, 0, 0.2, 3]]
    )
    points = torch.cat([torch.zeros(4, 3), place], dim=1)[None, None]
    chosen = torch.tensor([[[True, False, True, False]]])
    (found,) = network.maps(points, chosen)
    cells = [10 * 64 + 24, 0 * 64 + 63, 36 * 64 + 52]
    expected = torch.tensor([[0.5, 1, 0], [0.2, 0.2, 0], [1.5, 0.5, 3]])
    torch.testing.assert_close(found[:, cells], expected)
    rest = torch.ones(found.shape[1], dtype=torch.bool)
    rest[cells] = False
    assert (found[0, rest] == 0).all()
    assert found[1:, rest].isnan().all()


def test_without_labels_maps_are_made_of_the_points_taken_for_the_garment(space):
    network = CanonicalNetwork(
        SETTINGS.replace(body_relative_points=True), space, LABEL, rng()
    ).eval()
    fill_regression(network.regression)
    points, _, _, _ = windows(space, 2)
    points = torch.cat([points, torch.randn(*points.shape[:3], 4, generator=rng(5))], -1)
    found = network(points)
    labels = found.logits.argmax(-1)
    assert 0 < (labels == LABEL).float().mean() < 1
    torch.testing.assert_close(network(points, labels).coefficients, found.coefficients)


def draw(seed):
    return torch.Generator().manual_seed(seed)


def test_a_map_of_the_body_is_the_mean_over_cells_of_both_halves():
    place = torch.rand(6, 40, 4, generator=draw(7)) * torch.tensor([2.4, 1.0, 1.8, 1.0]) - 1.2
    values = torch.rand(6, 40, 2, generator=draw(8))
    found = body_map(place, values, 3, 0.05)
    cells: dict[tuple[int, int, int], list[list[float]]] = {}
    for cloud in range(6):
        for (x, _, z, _), value in zip(place[cloud].tolist(), values[cloud].tolist(), strict=True):
            column = min(int(abs(x) / 0.05), 18)
            row = min(max(int((z + 1.1) // 0.05), 0), 31)
            cells.setdefault((cloud // 3, column, row), []).append(value)
    expected = torch.zeros(2, 2, 19, 32)
    for (window, column, row), within in cells.items():
        expected[window, :, column, row] = torch.tensor(within).mean(0)
    torch.testing.assert_close(found, expected.flatten(1))
    assert expected[0, 0].numel() == map_cells(0.05)


@pytest.fixture
def given():
    """Maps (12, 2, 15), more values than windows, and coefficients (12, 3) that they tell about.

    Some cells of the second kind are not known.
    """
    rng = rng_for(0, "maps")
    maps = rng.normal(size=(len(SEQUENCES), 2, 15)) * [[[1.0], [0.1]]] + 2
    maps[:, 0] *= np.geomspace(0.01, 1, 15)
    flat = maps.reshape(len(maps), -1)
    coefficients = flat @ rng.normal(size=(30, 3)) + rng.normal(size=(len(SEQUENCES), 3))
    maps[rng.random(maps.shape) < [[[0.0], [0.3]]]] = np.nan
    return maps.astype(np.float32), coefficients.astype(np.float32)


def fitted(maps, coefficients, sequences=SEQUENCES, metric=None):
    regression = MapRegression(*maps.shape[1:], coefficients.shape[1])
    metric = np.eye(coefficients.shape[1]) if metric is None else metric
    return regression, *regression.fit(maps, coefficients, sequences, metric)


def shares(sequences):
    return np.array([1 / sequences.count(one) for one in sequences])


def seen(maps):
    """Maps as the regression sees them, cell by cell."""
    weights, columns = shares(SEQUENCES), []
    for kind in np.moveaxis(maps.astype(np.float64), 1, 0):
        gaps, deviations = [], []
        for cell in kind.T:
            known = ~np.isnan(cell)
            gap = np.zeros(len(cell))
            gap[known] = cell[known] - np.average(cell[known], weights=weights[known])
            gaps.append(gap)
            deviations.append(np.sqrt(np.average(gap**2, weights=weights)))
        typical = np.median(deviations)
        columns += [g / np.hypot(d, 0.3 * typical) for g, d in zip(gaps, deviations, strict=True)]
    return np.stack(columns, axis=1) / np.sqrt(len(columns))


def slowly(rows, coefficients, sequences, ridge):
    """Weighed ridge regression with its mean, by normal equations: a function of rows."""
    weights = shares(sequences)
    mean = np.average(rows, axis=0, weights=weights)
    middle = np.average(coefficients, axis=0, weights=weights)
    gap = rows - mean
    system = gap.T @ (weights[:, None] * gap) + ridge * np.eye(rows.shape[1])
    slope = np.linalg.solve(system, gap.T @ (weights[:, None] * (coefficients - middle)))
    return lambda new: (new - mean) @ slope + middle


@pytest.mark.parametrize("ridge", [0.01, 1.0])
def test_what_is_left_out_is_what_fits_without_it_say(given, monkeypatch, ridge):
    monkeypatch.setattr(canonical, "_RIDGES", np.array([ridge]))
    regression, found, error = fitted(*given)
    rows, coefficients = seen(given[0]), given[1].astype(np.float64)
    whole = slowly(rows, coefficients, SEQUENCES, ridge)
    said = regression(torch.from_numpy(given[0])).numpy()
    np.testing.assert_allclose(said, whole(rows), atol=2e-4)
    squared = []
    for one in set(SEQUENCES):
        inside = np.array(SEQUENCES) == one
        rest = [name for name in SEQUENCES if name != one]
        without = slowly(rows[~inside], coefficients[~inside], rest, ridge)
        np.testing.assert_allclose(found[inside], without(rows[inside]), atol=2e-4)
        squared.append(((found[inside] - coefficients[inside]) ** 2).sum(1).mean())
    assert error == pytest.approx(np.mean(squared) ** 0.5, rel=1e-4)


def test_the_ridge_is_the_best_for_what_is_left_out_in_the_metric(given, monkeypatch):
    metric = np.diag([1.0, 4.0, 0.0])
    _, _, best = fitted(*given, metric=metric)
    each = []
    for ridge in canonical._RIDGES:
        with monkeypatch.context() as only:
            only.setattr(canonical, "_RIDGES", np.array([ridge]))
            _, found, error = fitted(*given, metric=metric)
        off = found - given[1]
        mean = np.average(((off @ metric) * off).sum(1), weights=shares(SEQUENCES))
        assert error == pytest.approx(mean**0.5, rel=1e-4)
        each.append(error)
    assert best == pytest.approx(min(each))
    assert min(each) < 0.99 * max(each)


def test_a_linear_truth_is_found():
    rng = rng_for(0, "linear maps")
    maps = rng.uniform(-1, 1, size=(300, 2, 3)).astype(np.float32)
    slope = rng.normal(size=(6, 2))
    coefficients = (maps.reshape(300, 6) @ slope + 3).astype(np.float32)
    regression, found, error = fitted(maps, coefficients, [str(one) for one in range(300)])
    new = rng.uniform(-0.9, 0.9, size=(20, 2, 3)).astype(np.float32)
    said = regression(torch.from_numpy(new)).numpy()
    np.testing.assert_allclose(said, new.reshape(20, 6) @ slope + 3, atol=0.01)
    assert error < 0.01
    np.testing.assert_allclose(found, coefficients, atol=0.02)


def test_what_is_not_known_counts_as_the_mean_and_extremes_as_the_most_extreme_seen(given):
    regression, _, _ = fitted(*given)
    maps = torch.from_numpy(given[0])
    mean = regression.mean.expand_as(maps)
    torch.testing.assert_close(regression(torch.full_like(maps, torch.nan)), regression(mean))
    high, low = (torch.from_numpy(f(given[0], axis=0)) for f in (np.nanmax, np.nanmin))
    beyond = torch.where(torch.arange(15) % 2 == 0, high + 9, low - 9)
    edge = torch.where(torch.arange(15) % 2 == 0, high, low)
    torch.testing.assert_close(regression(beyond[None]), regression(edge[None]))
    assert (regression(edge[None]) - regression(mean[:1])).abs().max() > 0.1


def test_cells_that_never_change_have_no_say(given):
    maps, coefficients = given
    still = np.concatenate([maps, np.full((len(maps), 2, 5), 7, np.float32)], axis=2)
    still[:, 1, -1] = np.nan
    regression, found, _ = fitted(still, coefficients)
    alone, expected, _ = fitted(maps, coefficients)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    other = torch.from_numpy(still.copy())
    other[..., 15:] = -50
    torch.testing.assert_close(regression(other), alone(torch.from_numpy(maps)))


def test_nothing_is_said_before_the_fit():
    said = MapRegression(2, 4, 3)(torch.ones(5, 2, 4))
    torch.testing.assert_close(said, torch.zeros(5, 3))


def test_one_sequence_cannot_be_left_out(given):
    with pytest.raises(InputError, match="1 training sequence, expected two or more"):
        fitted(*given, sequences=["a"] * len(SEQUENCES))
