"""Plans of static outfits, and shards written and read."""

from collections import Counter

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.garment_types import OUTFIT_TYPES
from drapeline.outfits.static import load_static, make_static, save_static
from drapeline.outfits.static_plan import plan_static

SHARES = {"val": 0.1, "test": 0.2}


def plan(count=60, seed=3, *, outfit_types=OUTFIT_TYPES, male_skirts=False, female_share=2 / 3):
    shards = plan_static(seed, count, 25, SHARES, female_share, outfit_types, male_skirts)
    return [item for items in shards.values() for item in items]


def test_counts_and_shares_are_met_exactly():
    plans = plan()
    assert len({p.name for p in plans}) == 60
    assert Counter(p.split for p in plans) == {"train": 42, "val": 6, "test": 12}
    assert Counter(p.gender for p in plans) == {"female": 40, "male": 20}
    assert Counter(p.shard for p in plans) == {"000": 25, "001": 25, "002": 10}


def test_all_six_types_are_balanced_though_males_wear_no_skirts():
    plans = plan(240)
    worn = Counter(name for p in plans for name in p.outfit_type.split("+"))
    assert len(worn) == 6
    assert max(worn.values()) <= 1.1 * min(worn.values())
    assert not {"Skirt", "Dress"} & {
        n for p in plans if p.gender == "male" for n in p.outfit_type.split("+")
    }


def test_every_split_holds_every_outfit_type():
    for split in ("train", "val", "test"):
        assert {p.outfit_type for p in plan(240) if p.split == split} == set(OUTFIT_TYPES)


def test_the_plan_depends_on_the_seed_alone():
    assert plan() == plan()
    assert plan() != plan(seed=4)


def test_males_need_something_to_wear():
    with pytest.raises(InputError, match="nothing for male bodies"):
        plan(outfit_types=["Dress"])
    assert plan(outfit_types=["Dress"], male_skirts=True)


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


def test_a_shard_comes_back_as_it_was(shard, tmp_path):
    outfits = shard(3)
    save_static(tmp_path / "000.npz", outfits)
    for before, after in zip(outfits, load_static(tmp_path / "000.npz"), strict=True):
        assert (before.name, before.split) == (after.name, after.split)
        assert before.outfit.gender == after.outfit.gender
        np.testing.assert_array_equal(before.outfit.signed_tightness, after.outfit.signed_tightness)
        for one, other in zip(before.outfit.garments, after.outfit.garments, strict=True):
            np.testing.assert_array_equal(one.vertices, other.vertices)
            np.testing.assert_array_equal(one.faces, other.faces)
            assert one.about["parameters"] == other.about["parameters"]
    (tmp_path / "000.npz").unlink()
    with pytest.raises(InputError, match="000.npz"):
        load_static(tmp_path / "000.npz")
