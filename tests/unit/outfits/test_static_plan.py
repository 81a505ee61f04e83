"""Plans of static outfits."""

from collections import Counter

import pytest

from drapeline.errors import InputError
from drapeline.outfits.garment_types import OUTFIT_TYPES
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
