"""Static outfits made from their plans."""

import numpy as np
import pytest

from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.generate_static import make_static
from drapeline.outfits.static_plan import plan_static

SHARES = {"val": 0.1, "test": 0.2}


@pytest.fixture(scope="module")
def shard(toy_body, templates):
    plans = plan_static(3, 4, 4, SHARES, 1.0, ["Top", "Skirt"], male_skirts=False)["000"]

    def make(seed):
        return make_static(
            plans,
            {"female": templates},
            {"female": toy_body},
            seed=seed,
            shape_range=1.0,
            edge_length_m=0.05,
            ranges=OutfitRanges(tightness=(0.0, 0.0)),
        )

    return make


def test_no_two_outfits_share_a_body_or_parameters(shard):
    outfits = shard(3)
    shapes = np.array([o.outfit.shape for o in outfits])
    assert np.abs(shapes[:, None] - shapes[None]).sum(-1)[~np.eye(4, dtype=bool)].min() > 0.1
    seeds = [g.about["parameters"]["fold_seed"] for o in outfits for g in o.outfit.garments]
    assert len(set(seeds)) == len(seeds)
    again, other = shard(3), shard(4)
    for first, second, third in zip(outfits, again, other, strict=True):
        np.testing.assert_array_equal(first.outfit.shape, second.outfit.shape)
        np.testing.assert_array_equal(
            first.outfit.garments[0].vertices, second.outfit.garments[0].vertices
        )
        assert not np.array_equal(first.outfit.shape, third.outfit.shape)
