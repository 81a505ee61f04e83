"""The plan of the learning group."""

from collections import Counter

import pytest

from drapeline.errors import InputError
from drapeline.experiment.learning_plan import plan_learning, some_held_out
from drapeline.outfits.garment_types import OUTFIT_TYPES

CLIPS = {f"clip{k}": frames for k, frames in enumerate((150, 150, 150, 64, 46, 150, 91, 150))}
KNOWN = {"clip0": "train", "clip1": "test", "clip2": "val"}


def plan(seed=1, clips=CLIPS, **changes):
    settings = {
        "frames": 60,
        "frames_min": 40,
        "count": 160,
        "shard_size": 20,
        "speeds": (0.8, 1.2),
        "mirror": True,
        "val_share": 0.25,
        "test_share": 0.25,
        "known_splits": KNOWN,
        "female_share": 2 / 3,
        "outfit_types": OUTFIT_TYPES,
        "male_skirts": False,
    }
    return plan_learning(seed, clips, **{**settings, **changes})


def flat(shards):
    return [one for plans in shards.values() for one in plans]


def test_shards_hold_every_sample_once():
    shards = plan(count=45)
    assert [len(plans) for plans in shards.values()] == [20, 20, 5]
    assert list(shards) == ["000", "001", "002"]
    assert [one.sample for one in flat(shards)] == [f"L{k:05d}" for k in range(1, 46)]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_clips_keep_the_split_that_they_have_elsewhere_and_none_is_divided(seed):
    splits = {}
    for one in flat(plan(seed)):
        assert splits.setdefault(one.sequence, one.split) == one.split
    assert {clip: splits[clip] for clip in KNOWN} == KNOWN
    sizes = Counter(one.split for one in flat(plan(seed)))
    assert sizes["test"] == sizes["val"] == 40


def test_every_split_wears_every_type():
    worn = {(one.split, one.outfit_type) for one in flat(plan())}
    assert len(worn) == 3 * len(OUTFIT_TYPES)


def test_pieces_lie_in_their_clips_and_vary():
    pieces = flat(plan())
    for one in pieces:
        assert 0 <= one.start < one.stop <= CLIPS[one.sequence]
        assert 0.8 <= one.speed <= 1.2
        assert one.frames >= 60 or one.stop - one.start == CLIPS[one.sequence]
        assert one.frames >= 40
        assert one.mirrored == (one.part % 2 == 1)
    assert len({(one.sequence, one.start, one.speed) for one in pieces}) == len(pieces)
    assert len({one.start for one in pieces if one.sequence == "clip0"}) > 5
    assert not any(one.mirrored for one in flat(plan(mirror=False)))


def test_a_short_clip_is_slowed_down_as_far_as_allowed_and_then_refused():
    short = {"kick": 46, "walk": 150}
    assert all(one.frames >= 50 for one in flat(plan(clips=short, frames_min=50)))
    with pytest.raises(InputError, match=r"learning.frames_min is 60.*0\.8.*kick has 46"):
        plan(clips=short, frames_min=60)


def test_a_plan_is_the_same_for_a_seed_and_samples_do_not_depend_on_how_many_there_are():
    assert plan(3) == plan(3) != plan(4)
    few, many = (flat(plan(count=count))[:40] for count in (40, 160))
    assert [(p.start, p.speed) for p in few] == [(p.start, p.speed) for p in many]


def test_some_held_out_samples_are_spread_over_their_split():
    shards = plan()
    held_out = [p.sample for plans in shards.values() for p in plans if p.split == "test"]
    some = some_held_out(shards, split="test", most=3)
    places = [held_out.index(sample) for _, sample in some]
    assert places == [(2 * i + 1) * len(held_out) // 6 for i in range(3)]
    assert all(sample in {p.sample for p in shards[shard]} for shard, sample in some)
    assert len(some_held_out(shards, split="test", most=1000)) == len(held_out)
    assert some_held_out({}, split="test", most=3) == []
