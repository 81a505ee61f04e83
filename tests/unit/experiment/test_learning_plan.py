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


def test_some_held_out_samples_are_of_all_clips_and_kinds_of_their_split():
    """Samples take turns over clips, genders and outfits, so that every n-th may be all alike."""
    shards = plan(count=208, clips=dict.fromkeys([f"clip{k}" for k in range(13)], 150))
    held_out = [one for one in flat(shards) if one.split == "test"]
    some = some_held_out(1, shards, split="test", most=12)
    of = {(shard, one.sample): one for shard, plans in shards.items() for one in plans}
    drawn = [of[chosen] for chosen in some]
    assert len({one.sample for one in drawn}) == 12
    assert {one.split for one in drawn} == {"test"}
    clips = Counter(one.sequence for one in drawn)
    assert set(clips) == {one.sequence for one in held_out}
    assert max(clips.values()) - min(clips.values()) <= 1
    assert {one.mirrored for one in drawn} == {False, True}
    assert {one.gender for one in drawn} == {"female", "male"}
    assert some == some_held_out(1, shards, split="test", most=12)
    assert some != some_held_out(2, shards, split="test", most=12)
    assert len(some_held_out(1, shards, split="test", most=1000)) == len(held_out)
    assert some_held_out(1, {}, split="test", most=3) == []
