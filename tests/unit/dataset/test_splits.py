from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drapeline.dataset.splits import SplitItem, split_samples
from drapeline.seeding import rng_for


def items_of(sources, bodies=None):
    bodies = range(len(sources)) if bodies is None else bodies
    return [
        SplitItem(f"{i:05d}", f"clip{source}", f"body{body}")
        for i, (source, body) in enumerate(zip(sources, bodies, strict=True))
    ]


def split(items, val_share=0.17, test_share=0.17, seed=0):
    rng = rng_for(seed, "splits")
    return split_samples(rng, items, val_share=val_share, test_share=test_share)


def test_three_clips_fill_three_splits():
    split_of = split(items_of([0, 1, 2]), 0.34, 0.34)
    assert Counter(split_of.values()) == {"train": 1, "val": 1, "test": 1}


@pytest.mark.parametrize(("samples", "clips"), [(16, 8), (18, 14), (16, 16), (24, 9)])
def test_a_small_dataset_comes_close_to_its_shares(samples, clips):
    sizes = Counter(split(items_of([i % clips for i in range(samples)])).values())
    per_clip = -(-samples // clips)
    assert abs(sizes["test"] - 0.17 * samples) <= per_clip / 2 + 1e-9
    assert abs(sizes["val"] - 0.17 * samples) <= per_clip / 2 + 1e-9
    assert sizes["train"] >= samples / 2


def test_a_large_dataset_meets_its_shares():
    rng = np.random.default_rng(0)
    sizes = Counter(split(items_of(rng.integers(0, 700, 2000)), 0.1, 0.2).values())
    assert abs(sizes["test"] - 400) <= 1
    assert abs(sizes["val"] - 200) <= 1


@given(
    st.lists(st.tuples(st.integers(0, 6), st.integers(0, 9)), min_size=1, max_size=30),
    st.floats(0, 0.5),
    st.floats(0, 0.5),
    st.integers(0, 5),
)
def test_no_clip_and_no_body_is_in_two_splits(pairs, val_share, test_share, seed):
    items = items_of(*zip(*pairs, strict=True))
    split_of = split(items, val_share, test_share, seed)
    assert list(split_of) == [item.sample for item in items]
    for key in ("source", "body"):
        seen = {}
        for item in items:
            assert (
                seen.setdefault(getattr(item, key), split_of[item.sample])
                == (split_of[item.sample])
            )


def test_samples_linked_through_others_stay_together():
    # Clip 0 and clip 2 share no body, but each shares one with clip 1.
    items = items_of([0, 1, 1, 2, 3, 4], bodies=["a", "a", "b", "b", "c", "d"])
    split_of = split(items, 0.2, 0.2)
    assert len({split_of[item.sample] for item in items[:4]}) == 1
    assert set(split_of.values()) == {"train", "val", "test"}


def test_the_split_follows_from_the_seed_alone():
    items = items_of([i % 9 for i in range(30)])
    assert split(items, seed=3) == split(items, seed=3)
    assert any(split(items, seed=3) != split(items, seed=seed) for seed in range(4, 8))


def test_a_share_of_zero_leaves_its_split_empty():
    items = items_of(range(12))
    assert set(split(items, 0.0, 0.2).values()) == {"train", "test"}
    assert set(split(items, 0.0, 0.0).values()) == {"train"}


@pytest.mark.parametrize(("clips", "expected"), [(1, {"train"}), (2, {"train", "val"})])
def test_with_fewer_clips_than_splits_training_and_then_validation_come_first(clips, expected):
    assert set(split(items_of([i % clips for i in range(8)])).values()) == expected


def test_one_overlong_clip_is_trained_on():
    split_of = split(items_of([0] * 20 + [1, 2, 3]))
    assert all(split_of[f"{i:05d}"] == "train" for i in range(20))
