"""Functions that leave mixed precision."""

import torch

from drapeline.models.layers.linear import full_precision


@full_precision
def product(a, b, scale=1):
    return scale * (a @ b)


def test_sixteen_bits_are_widened_within_autocast():
    a = torch.full((2, 2), 1.0 / 3)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert (a @ a).dtype == torch.bfloat16
        found = product(a.bfloat16(), a)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, a.bfloat16().float() @ a)


def test_places_metres_away_keep_their_millimetres():
    place = torch.tensor([[1.0 + 0.001, 0.0]])
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert float(product(place, torch.eye(2))[0, 0]) == float(place[0, 0])
        assert float((place @ torch.eye(2))[0, 0]) == 1.0


def test_without_autocast_nothing_is_changed():
    a = torch.eye(2, dtype=torch.bfloat16)
    assert product(a, a).dtype == torch.bfloat16
    assert product(a.double(), a.double()).dtype == torch.float64
