import numpy as np
import pytest
import torch

from drapeline.models.garment4d.losses import CotangentLaplacian, UniformLaplacian, posed_loss
from drapeline.models.garment4d.posed import (
    FrameAttention,
    GraphLayers,
    MgnNetwork,
    PosedNetwork,
    mean_of_neighbours,
    pull_to_points,
)
from drapeline.models.garment4d.settings import MgnSettings, PosedSettings, PosedWeights
from drapeline.models.layers.graphs import SparseMatrix
from drapeline.models.layers.pointnet import PointLevel
from toys.gcvae import VERTICES, tube, tube_faces
from toys.paper import printed

PRINTED = PosedWeights(**printed("garment4d.posed.loss"))
FACES = tube_faces(False)
ADJACENCY = SparseMatrix(mean_of_neighbours(FACES, VERTICES))
CHANNELS = (4, 6)
SMALL = PosedSettings(
    iterations=3,
    hidden=12,
    layers=3,
    features=8,
    garment_radii_m=(0.1, 0.2),
    garment_counts=(8, 6),
    body_radii_m=(0.1,),
    body_counts=(6,),
    ball_layers=2,
    pull_neighbours=0,
    smooth_passes=0,
)


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def network(moving=True, **changes):
    """Small, and moved away from the identity that it begins as."""
    net = PosedNetwork(SMALL.replace(**changes), FACES, VERTICES, CHANNELS, generator())
    if moving:
        with torch.no_grad():
            for graph in net.graphs:
                graph.last.weight.normal_(0, 0.01, generator=generator(1))
    return net


def inputs(batch=2, frames=3, seed=0, points=30):
    rng = generator(seed)
    size = (batch, frames)
    garment = torch.from_numpy(tube()).float() * 1.2
    proposal = garment + 0.02 * torch.randn(*size, VERTICES, 3, generator=rng)
    levels = [
        PointLevel(
            garment[torch.randint(VERTICES, (batch * frames, count), generator=rng)],
            torch.randn(batch * frames, count, width, generator=rng),
            torch.ones(batch * frames, count, dtype=torch.bool),
        )
        for count, width in zip((points, points // 2), CHANNELS, strict=True)
    ]
    body = torch.from_numpy(tube()).float() + 0.01 * torch.randn(*size, VERTICES, 3, generator=rng)
    normals = torch.nn.functional.normalize(body * torch.tensor([1.0, 1, 0]), dim=-1)
    return proposal, levels, body, normals


def part(arguments, batch):
    """The arguments of one item of the batch."""
    proposal, levels, body, normals = arguments
    frames = proposal.shape[1]
    rows = slice(batch * frames, (batch + 1) * frames)
    own = slice(batch, batch + 1)
    return (
        proposal[own],
        [PointLevel(*(value[rows] for value in level)) for level in levels],
        body[own],
        normals[own],
    )


def test_an_untrained_network_gives_the_proposal_back():
    arguments = inputs()
    out = network(moving=False)(*arguments)
    assert len(out) == 3
    for garment in out:
        assert torch.equal(garment, arguments[0])


def test_points_pull_an_untrained_network_towards_where_the_garment_is():
    proposal, levels, body, normals = inputs(points=400)
    shifted = proposal + torch.tensor([0.0, 0.0, 0.1])
    out = network(moving=False, pull_neighbours=4)(shifted, levels, body, normals)
    garment = torch.from_numpy(tube()).float() * 1.2
    errors = [(x - garment).norm(dim=-1).mean() for x in (shifted, *out)]
    assert errors[0] > errors[1] > errors[2] > errors[3]


def test_the_pull_is_the_smoothed_way_to_the_mean_of_the_nearest_points():
    proposal, levels, *_ = inputs(batch=1, frames=2)
    garment = proposal.flatten(0, 1)
    cloud = levels[0].points
    near = torch.cdist(garment, cloud).argsort(dim=-1)[..., :4]
    way = torch.stack([cloud[k][near[k]].mean(1) for k in range(2)]) - garment
    smooth = torch.from_numpy(mean_of_neighbours(FACES, VERTICES).toarray()).float()
    expected = smooth @ (smooth @ (smooth @ way))
    found = pull_to_points(levels[0], garment, 4, ADJACENCY)
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-4)


def test_a_cloud_without_garment_points_pulls_nowhere():
    proposal, levels, *_ = inputs(batch=1, frames=2)
    empty = levels[0]._replace(valid=torch.zeros_like(levels[0].valid))
    way = pull_to_points(empty, proposal.flatten(0, 1), 4, ADJACENCY)
    assert torch.equal(way, torch.zeros_like(way))


def test_every_iteration_gathers_around_the_garment_that_the_one_before_it_left():
    net, arguments = network(), inputs()
    gathered = {ball: [] for ball in (*net.body, *net.garment)}
    for ball, centres in gathered.items():
        ball.register_forward_pre_hook(lambda _, given, c=centres: c.append(given[1]))
    with torch.no_grad():
        out = net(*arguments)
    for centres in gathered.values():
        for garment, expected in zip(centres, [arguments[0], *out[:-1]], strict=True):
            assert torch.equal(garment, expected.flatten(0, 1))


@pytest.mark.parametrize("transformer", ["paper", "per_vertex", "none"])
@pytest.mark.parametrize("body_encoder", [True, False])
def test_a_batch_gives_what_its_items_give_one_by_one(transformer, body_encoder):
    net, arguments = network(transformer=transformer, body_encoder=body_encoder), inputs()
    together = net(*arguments)
    for item in range(2):
        for one, all_of in zip(net(*part(arguments, item)), together, strict=True):
            torch.testing.assert_close(one[0], all_of[item], atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("transformer", ["paper", "per_vertex", "none"])
def test_only_a_transformer_lets_frames_see_one_another(transformer):
    net = network(transformer=transformer)
    proposal, levels, body, normals = inputs(batch=1)
    before = net(proposal, levels, body, normals)
    changed = body.clone()
    changed[:, 2] += 0.03
    after = net(proposal, levels, changed, normals)
    assert not torch.allclose(before[0][:, 2], after[0][:, 2])
    for iteration in (0, 1, 2):
        same = torch.equal(before[iteration][:, 0], after[iteration][:, 0])
        assert same == (transformer == "none" or iteration == 0)


def test_without_the_body_encoder_the_body_makes_no_difference():
    proposal, levels, body, normals = inputs()
    for encoder in (True, False):
        net = network(body_encoder=encoder)
        same = torch.equal(
            net(proposal, levels, body, normals)[-1],
            net(proposal, levels, body + 0.05, normals)[-1],
        )
        assert same == (not encoder)


def test_padding_and_the_order_of_frames_make_no_difference():
    net, (proposal, levels, body, normals) = network(), inputs(batch=1)
    out = net(proposal, levels, body, normals)[-1]
    padded = [
        PointLevel(
            torch.cat([level.points, level.points[:, :3] + 0.01], 1),
            torch.cat([level.features, level.features[:, :3] + 1], 1),
            torch.cat([level.valid, torch.zeros_like(level.valid[:, :3])], 1),
        )
        for level in levels
    ]
    torch.testing.assert_close(net(proposal, padded, body, normals)[-1], out)
    order = torch.tensor([2, 0, 1])
    shuffled = [PointLevel(*(value[order] for value in level)) for level in levels]
    again = net(proposal[:, order], shuffled, body[:, order], normals[:, order])[-1]
    torch.testing.assert_close(again, out[:, order], atol=1e-6, rtol=1e-5)


def test_clouds_without_garment_points_give_finite_garments_and_gradients():
    net, (proposal, levels, body, normals) = network(), inputs()
    none = [level._replace(valid=torch.zeros_like(level.valid)) for level in levels]
    out = net(proposal, none, body, normals)
    out[-1].sum().backward()
    assert torch.isfinite(out[-1]).all()
    assert all(torch.isfinite(p.grad).all() for p in net.parameters() if p.grad is not None)


def test_renumbered_vertices_give_renumbered_garments():
    order = torch.randperm(VERTICES, generator=generator())
    place = torch.argsort(order).numpy()
    net, arguments = network(), inputs()
    other = PosedNetwork(SMALL, place[FACES], VERTICES, CHANNELS, generator())
    other.load_state_dict(net.state_dict())
    out = net(*arguments)[-1]
    again = other(arguments[0][:, :, order], *arguments[1:])[-1]
    torch.testing.assert_close(again, out[:, :, order], atol=1e-6, rtol=1e-5)


def test_every_weight_is_reached_by_the_loss():
    net, arguments = network(), inputs()
    laplacian = CotangentLaplacian(tube(), FACES)
    target = torch.from_numpy(tube()).float().expand_as(arguments[0])
    terms = posed_loss(net(*arguments), target, *arguments[2:], laplacian, PRINTED)
    terms["total"].backward()
    for name, weight in net.named_parameters():
        assert weight.grad is not None, name
        assert weight.grad.abs().sum() > 0, name


def test_graph_layers_are_means_over_neighbours_and_sums_over_features():
    matrix = mean_of_neighbours(FACES, VERTICES)
    dense = np.eye(VERTICES)
    for a, b, c in FACES:
        dense[[a, b, c, b, c, a], [b, c, a, a, b, c]] = 1
    dense /= dense.sum(1, keepdims=True)
    np.testing.assert_allclose(matrix.toarray(), dense, atol=1e-12)
    for inputs_ in (2, 9):
        layers = GraphLayers(inputs_, 5, 3, generator()).double()
        with torch.no_grad():
            for layer in (*layers.layers, layers.last):
                layer.weight.normal_(generator=generator(2))
                layer.bias.normal_(generator=generator(3))
        x = torch.randn(VERTICES, 2, inputs_, generator=generator(), dtype=torch.float64)
        hidden, displacement = layers(x, SparseMatrix(matrix).double())
        mean = torch.from_numpy(dense)
        for layer in layers.layers:
            x = torch.relu(torch.einsum("nm,mbf->nbf", mean, x) @ layer.weight.T + layer.bias)
        torch.testing.assert_close(hidden, x, atol=1e-6, rtol=1e-6)
        wanted = torch.einsum("nm,mbf->nbf", mean, x) @ layers.last.weight.T + layers.last.bias
        torch.testing.assert_close(displacement, wanted, atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize("per_vertex", [True, False])
def test_attention_agrees_with_loops(per_vertex):
    attention = FrameAttention(5, per_vertex, generator())
    x = 0.3 * torch.randn(4, 2 * 3, 5, generator=generator(1))
    made = attention(x, 3).unflatten(1, (2, 3))
    query, key, value = (
        (x @ w.T).unflatten(1, (2, 3)) for w in attention.projection.weight.chunk(3)
    )
    for item in range(2):
        for vertex in range(4):
            mine = [vertex] if per_vertex else range(4)
            for frame in range(3):
                scores = torch.stack(
                    [
                        sum((query[n, item, frame] * key[n, item, other]).sum() for n in mine)
                        for other in range(3)
                    ]
                )
                weights = torch.softmax(scores / (5 if per_vertex else 3) ** 0.5, 0)
                wanted = (weights[:, None] * value[vertex, item]).sum(0)
                torch.testing.assert_close(made[vertex, item, frame], wanted)


def test_loss_is_the_weighted_sum_of_its_terms_over_iterations():
    proposal, _, body, normals = inputs()
    laplacian = CotangentLaplacian(tube(), FACES)
    target = proposal + torch.tensor([0.03, 0.0, 0.04])
    weights = PosedWeights(vertices=2, interpenetration=3, laplacian=5, temporal=7)
    one = posed_loss([proposal], target, body, normals, laplacian, weights)
    assert float(one["vertices"]) == pytest.approx(0.0025, rel=1e-4)
    assert float(one["laplacian"]) == pytest.approx(0, abs=1e-7)
    wanted = sum(getattr(weights, name) * one[name] for name in one if name != "total")
    torch.testing.assert_close(one["total"], wanted)
    both = posed_loss([proposal, target], target, body, normals, laplacian, weights)
    last = posed_loss([target], target, body, normals, laplacian, weights)
    for name, value in both.items():
        torch.testing.assert_close(value, one[name] + last[name], atol=1e-7, rtol=1e-5)
    assert float(last["vertices"]) == 0


def test_released_forms_are_roughness_and_distances_of_the_last_iteration():
    proposal, _, body, normals = inputs()
    target = proposal + torch.tensor([0.03, 0.0, 0.04])
    iterations = [proposal, 1.5 * proposal, 2 * proposal]
    released = PRINTED.replace(laplacian_form="released", temporal_form="released")
    uniform = UniformLaplacian(FACES, VERTICES)
    found = posed_loss(iterations, target, body, normals, uniform, released)
    lengths = []
    for vertex in range(VERTICES):
        around = FACES[np.isin(FACES, vertex).any(axis=1)]
        near = np.unique(around[around != vertex])
        away = proposal[:, :, near].mean(2) - proposal[:, :, vertex]
        lengths.append(float(away.norm(dim=-1).mean()))
    assert float(found["laplacian"]) == pytest.approx((1 + 1.5 + 2) * np.mean(lengths), rel=1e-5)
    steps = [
        float((proposal[b, t + 1, v] - proposal[b, t, v]).norm())
        for b in range(len(proposal))
        for t in range(proposal.shape[1] - 1)
        for v in range(VERTICES)
    ]
    assert float(found["temporal"]) == pytest.approx(2 * np.mean(steps), rel=1e-5)
    paper = posed_loss(
        iterations, target, body, normals, CotangentLaplacian(tube(), FACES), PRINTED
    )
    squared = (1 + 2.25 + 4) * np.mean(np.square(steps))
    assert float(paper["temporal"]) == pytest.approx(squared, rel=1e-5)
    for name in ("vertices", "interpenetration"):
        torch.testing.assert_close(found[name], paper[name])


def test_training_finds_a_displacement_that_the_points_tell():
    net, (proposal, levels, body, normals) = network(moving=False, iterations=1), inputs(batch=1)
    laplacian = CotangentLaplacian(tube(), FACES)
    target = proposal + torch.tensor([0.0, 0.0, 0.05])
    optimiser = torch.optim.Adam(net.parameters(), lr=0.01)
    weights = PRINTED.replace(temporal=0, interpenetration=0)
    errors = []
    for _ in range(40):
        out = net(proposal, levels, body, normals)
        optimiser.zero_grad()
        loss = posed_loss(out, target, body, normals, laplacian, weights)
        loss["total"].backward()
        optimiser.step()
        errors.append(float((out[-1] - target).detach().norm(dim=-1).mean()))
    assert min(errors) < 0.1 * errors[0]


def mgn_inputs(frames=3):
    _, levels, _, _ = inputs(batch=2, frames=frames)
    canonical = torch.from_numpy(tube()).float().expand(2, -1, -1)
    weights = torch.nn.functional.one_hot(torch.arange(VERTICES) % 24, 24).float()
    transforms = torch.eye(4).repeat(2, frames, 24, 1, 1)
    transforms[..., :3, 3] = torch.randn(2, frames, 24, 3, generator=generator(4))
    return canonical, levels, weights.expand(2, -1, -1), transforms


def test_mgn_begins_as_skinning_and_displaces_in_the_rest_pose():
    net = MgnNetwork(MgnSettings(widths=(8, 6)), FACES, VERTICES, CHANNELS, generator())
    canonical, levels, weights, transforms = mgn_inputs()
    shift = transforms[:, :, torch.arange(VERTICES) % 24, :3, 3]
    out = net(canonical, levels, weights, transforms)
    torch.testing.assert_close(out, canonical[:, None] + shift)
    with torch.no_grad():
        net.last.bias.copy_(torch.tensor([0.0, 1.0, 2.0]).repeat(VERTICES))
    turned = transforms.clone()
    turned[..., :3, :3] = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    moved = net(canonical, levels, weights, turned)
    wanted = (canonical[:, None] + torch.tensor([0.0, 0.05, 0.1])) @ turned[0, 0, 0, :3, :3].T
    torch.testing.assert_close(moved, wanted + shift)


def test_mgn_sees_each_frame_by_itself_and_all_its_valid_points():
    net = MgnNetwork(MgnSettings(widths=(8, 6)), FACES, VERTICES, CHANNELS, generator())
    with torch.no_grad():
        net.last.weight.normal_(generator=generator(5))
    canonical, levels, weights, transforms = mgn_inputs()
    out = net(canonical, levels, weights, transforms)
    features = levels[-1].features.clone()
    features[4] += 1
    changed = net(canonical, [levels[-1]._replace(features=features)], weights, transforms)
    same = torch.isclose(out, changed).flatten(2).all(2)
    assert same.tolist() == [[True, True, True], [True, False, True]]
    valid = levels[-1].valid.clone()
    valid[4] = False
    hidden = net(canonical, [levels[-1]._replace(valid=valid)], weights, transforms)
    again = net(
        canonical, [levels[-1]._replace(features=features, valid=valid)], weights, transforms
    )
    assert torch.equal(hidden, again)


def test_points_pull_an_untrained_mgn_by_a_share_of_the_way():
    settings = MgnSettings(widths=(8, 6))
    canonical, levels, weights, transforms = mgn_inputs()
    skinned, pulled = (
        MgnNetwork(settings.replace(pull_neighbours=count), FACES, VERTICES, CHANNELS, generator())
        for count in (0, 4)
    )
    before = skinned(canonical, levels, weights, transforms)
    after = pulled(canonical, levels, weights, transforms)
    way = pull_to_points(levels[0], before.flatten(0, 1), 4, ADJACENCY).view_as(before)
    torch.testing.assert_close(after, before + pulled.share * way)
    assert 0 < pulled.share.item() < 1
    (slope,) = torch.autograd.grad(after.sum(), [pulled.share])
    torch.testing.assert_close(slope, way.sum(), rtol=1e-4, atol=1e-4)
