"""What encoding and decoding must not depend on, whatever the model."""

from copy import deepcopy

import numpy as np
import pytest
import torch

from drapeline.models.gcvae.codec import planes
from toys.gcvae import VERTICES
from toys.learning import doubles


def rows_of(batch, rows):
    return {
        key: [value[i] for i in rows] if isinstance(value, list) else value[torch.tensor(rows)]
        for key, value in batch.items()
    }


@pytest.fixture(params=["network", "ppca"])
def model(request):
    model = request.getfixturevalue("untrained" if request.param == "network" else "fitted")
    return deepcopy(model).double()


@pytest.fixture
def batch(batch):
    """In 64 bits, so that no rounding hides a difference."""
    return doubles(batch)


def test_planes_hold_one_coordinate_of_one_vertex_of_all_samples_side_by_side():
    x = torch.arange(24.0).view(2, 4, 3)
    assert planes(x).is_contiguous()
    assert torch.equal(planes(x), x.permute(1, 2, 0))


def test_a_batch_is_its_samples_one_by_one(model, batch):
    code = model.encode(batch)
    offsets, mask = model.decode(code.mean, batch["cvar"], batch["topology"])
    assert offsets.shape == (9, VERTICES, 3)
    assert mask.shape == (9, VERTICES)
    for row in range(9):
        one = rows_of(batch, [row])
        alone = model.encode(one)
        for part, whole in zip(alone, code, strict=True):
            torch.testing.assert_close(part[0], whole[row])
        made, seen = model.decode(alone.mean, one["cvar"], one["topology"])
        torch.testing.assert_close(made[0], offsets[row])
        torch.testing.assert_close(seen[0], mask[row])


def test_the_order_of_a_batch_of_both_topologies_does_not_matter(model, batch):
    order = np.random.default_rng(0).permutation(9).tolist()
    code, turned = model.encode(batch), model.encode(rows_of(batch, order))
    torch.testing.assert_close(turned.mean, code.mean[order])
    there = model.decode(code.mean, batch["cvar"], batch["topology"])
    here = model.decode(code.mean[order], batch["cvar"][order], batch["topology"][order])
    for a, b in zip(here, there, strict=True):
        torch.testing.assert_close(a, b[order])


def test_decoding_needs_only_z_and_conditions(model, batch):
    """Given z, the output does not change with the garment that went in: nothing leaks past z."""
    inputs = batch["offsets"].clone().requires_grad_(True)
    parts = model.parts({**batch, "offsets": inputs})
    order = torch.cat([part.rows for part in parts.values()])
    z = model.encode_parts(parts).mean
    assert torch.autograd.grad(z.sum(), inputs)[0].abs().sum() > 0
    counts = {name: len(part.rows) for name, part in parts.items()}
    free = z.detach().requires_grad_(True)
    out = sum(x.sum() for x in model.decode_parts(free, batch["cvar"][order], counts).values())
    by_z, by_input = torch.autograd.grad(out, (free, inputs), allow_unused=True)
    assert by_z.abs().sum() > 0
    assert by_input is None
