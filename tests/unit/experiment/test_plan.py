"""What a sample is going to be depends on the seed, its group and its number alone."""

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drapeline.dataset.record import SPLITS
from drapeline.errors import InputError
from drapeline.experiment.plan import (
    Wardrobe,
    cut_pieces,
    is_female,
    plan_at_rest,
    plan_moving,
    split_clips,
)
from drapeline.frames import GENDERS
from drapeline.outfits.garment_types import CLOTH3D_OUTFITS, GARMENTS, OUTFIT_TYPES, SKIRTS

FRAMES = {"walk": 120, "run": 125, "jump": 60, "crawl": 70, "spin": 130}
MOTIONS = {
    "frames": 60,
    "frames_min": 60,
    "anywhere": False,
    "speeds": (1, 1),
    "mirror": False,
}
ANYWHERE = {"frames_min": 40, "anywhere": True, "speeds": (0.8, 1.2), "mirror": True}
WARDROBE = Wardrobe(2 / 3, OUTFIT_TYPES, male_skirts=False)
# All garments equally often.
EVEN = [*OUTFIT_TYPES, "Dress", "Jumpsuit"]
SHARES = {"val": 0.15, "test": 0.2}
NONE_HELD = {"val": 0.0, "test": 0.0}

counts = st.integers(1, 60)
seeds = st.integers(0, 2**32)
shares = st.tuples(st.floats(0, 0.45), st.floats(0, 0.45)).map(
    lambda pair: dict(zip(("val", "test"), pair, strict=True))
)


def plan(seed=1, count=18, clips=FRAMES, wanted=SHARES, known=None, wardrobe=WARDROBE, **motions):
    pieces = cut_pieces(seed, clips, {**MOTIONS, **motions})
    splits = split_clips(seed, "group", pieces.sizes, wanted, known or {})
    total = pieces.count if count is None else count
    return plan_moving(total, "", pieces.of_sample, splits, wardrobe)


@settings(max_examples=40, deadline=None)
@given(seeds, counts, counts, shares, st.booleans())
def test_whoever_asks_for_more_keeps_what_he_has(seed, count, more, wanted, anywhere):
    motions = ANYWHERE if anywhere else {}
    few, many = (plan(seed, n, wanted=wanted, **motions) for n in (count, count + more))
    assert many[:count] == few
    wardrobe = WARDROBE._replace(outfit_types=EVEN)
    few, many = (plan_at_rest(n, "s", wanted, wardrobe) for n in (count, count + more))
    assert many[:count] == few


@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(1, 80), shares, st.dictionaries(st.sampled_from("abcde"), st.just("val")))
def test_a_clip_is_in_one_split_and_keeps_the_one_it_has(seed, clips, wanted, known):
    sizes = {**dict.fromkeys("abcde", 1), **{f"clip{i}": 1 + i % 3 for i in range(clips)}}
    split_of = split_clips(seed, "group", sizes, wanted, known)
    assert split_of.keys() == sizes.keys()
    assert set(split_of.values()) <= {*SPLITS}
    assert {clip: split_of[clip] for clip in known} == known
    # Another group that comes after it has the same splits, whatever it asks for.
    assert split_clips(seed, "other", sizes, {"val": 0.4, "test": 0.1}, split_of) == split_of


@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(3, 200), st.floats(0.05, 0.4), st.floats(0.05, 0.4))
def test_shares_hold_for_the_first_of_many_clips_too(seed, clips, val, test):
    wanted = {"val": val, "test": test}
    split_of = split_clips(seed, "group", {f"clip{i}": 1 for i in range(clips)}, wanted, {})
    for first in range(3, clips + 1):
        filled = Counter(list(split_of.values())[:first])
        assert filled.keys() == {*SPLITS}
        for split, share in {**wanted, "train": 1 - val - test}.items():
            assert filled[split] <= max(share * first + 1, 1)
            assert filled[split] >= share * first - 2


def test_with_two_clips_one_is_for_training_and_one_for_testing():
    assert split_clips(1, "group", {"a": 1, "b": 1}, SHARES, {}) == {"a": "train", "b": "test"}
    assert split_clips(1, "group", {"a": 1}, SHARES, {}) == {"a": "train"}
    assert split_clips(1, "group", dict.fromkeys("abc", 1), {"val": 0, "test": 0}, {}) == (
        dict.fromkeys("abc", "train")
    )


def test_seeds_and_groups_draw_splits_of_their_own():
    sizes = {f"clip{i}": 1 for i in range(30)}
    drawn = [split_clips(seed, group, sizes, SHARES, {}) for seed in (1, 2) for group in ("a", "b")]
    assert len({tuple(splits.items()) for splits in drawn}) == 4


@pytest.mark.parametrize("share", [0.0, 0.2, 1 / 3, 0.5, 0.6, 2 / 3, 0.9, 1.0])
def test_genders_come_in_their_share_and_both_of_them_at_once(share):
    genders = [is_female(number, share) for number in range(300)]
    for count in range(1, 301):
        assert abs(sum(genders[:count]) - share * count) < 2
    if 0 < share < 1:
        assert genders[:2] == [True, False]


def test_genders_are_not_tied_to_the_clips_that_samples_take_turns_over():
    for period in range(2, 12):
        for place in range(period):
            assert 0 < sum(is_female(place + period * turn, 2 / 3) for turn in range(12)) < 12


@pytest.mark.parametrize("share", [0.5, 2 / 3, 1.0])
@pytest.mark.parametrize("count", [4, 6, 8, 12])
def test_outfits_do_not_fall_into_step_with_the_clips_that_samples_take_turns_over(share, count):
    clips = {f"clip{number}": 200 for number in range(count)}
    wardrobe = Wardrobe(share, CLOTH3D_OUTFITS, male_skirts=False)
    seen = {}
    for sample in plan(
        count=10 * count, clips=clips, wanted=NONE_HELD, wardrobe=wardrobe, **ANYWHERE
    ):
        for garment in sample.outfit_type.split("+"):
            seen.setdefault(garment, set()).add(sample.sequence)
    assert all(len(moved_by) >= count - 1 for moved_by in seen.values())


@pytest.mark.parametrize("seed", range(5))
def test_small_splits_see_both_genders_and_the_first_outfits(seed):
    worn, genders = {}, {}
    for sample in plan(seed, count=15, clips={**FRAMES, "kick": 60}):
        worn.setdefault(sample.split, set()).add(sample.outfit_type)
        genders.setdefault(sample.split, set()).add(sample.gender)
    assert worn.keys() == {*SPLITS}
    for split in SPLITS:
        assert genders[split] == {*GENDERS}
        assert "Tshirt+Trousers" in worn[split]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("at_rest", [True, False])
def test_every_split_has_every_garment_once_counts_allow_it(seed, at_rest):
    wardrobe = WARDROBE._replace(outfit_types=EVEN)
    wanted = {"val": 0.25, "test": 0.25}
    plans = (
        plan_at_rest(40, "s", wanted, wardrobe)
        if at_rest
        else plan(seed, 60, wanted=wanted, wardrobe=wardrobe, **ANYWHERE)
    )
    for split in SPLITS:
        worn = Counter(g for p in plans if p.split == split for g in p.outfit_type.split("+"))
        assert worn.keys() == {*GARMENTS}
        assert max(worn.values()) <= 2 * min(worn.values()) + 2


def test_outfits_are_balanced_and_men_wear_no_skirts_unless_asked():
    plans = plan(count=90)
    worn = Counter(sample.outfit_type for sample in plans)
    men = Counter(sample.outfit_type for sample in plans if sample.gender == "male")
    assert set(worn) == set(OUTFIT_TYPES)
    assert max(worn.values()) - min(worn.values()) <= 6  # two for each split
    assert set(men) == {kind for kind in OUTFIT_TYPES if not set(SKIRTS) & set(kind.split("+"))}
    free = plan(count=90, wardrobe=WARDROBE._replace(male_skirts=True))
    assert "Dress" in {sample.outfit_type for sample in free if sample.gender == "male"}


def test_a_type_that_is_named_twice_is_worn_twice_as_often():
    types = ["Tshirt+Skirt", "Dress", "Top+Skirt", "Dress"]
    plans = plan_at_rest(80, "s", SHARES, Wardrobe(1.0, types, male_skirts=False))
    for split in SPLITS:
        worn = Counter(p.outfit_type for p in plans if p.split == split)
        assert abs(worn["Dress"] - 2 * worn["Tshirt+Skirt"]) <= 2


@settings(max_examples=40, deadline=None)
@given(shares, st.integers(1, 300))
def test_at_rest_every_prefix_has_its_shares(wanted, count):
    filled = Counter(p.split for p in plan_at_rest(count, "s", wanted, WARDROBE))
    for split, share in {**wanted, "train": 1 - sum(wanted.values())}.items():
        assert abs(filled[split] - share * count) < 2


def test_samples_take_turns_over_the_clips_and_then_reuse_them():
    names = [sample.sequence for sample in plan()]
    assert names[:5] == ["walk", "run", "jump", "crawl", "spin"]
    assert names[5:8] == ["walk", "run", "spin"]
    assert names[8:13] == names[:5]


def test_without_a_count_each_sub_sequence_is_used_once():
    plans = plan(count=None)
    used = [(sample.sequence, sample.part) for sample in plans]
    assert len(used) == len(set(used)) == 8
    for sample in plans:
        assert sample.stop - sample.start == 60
        assert sample.start == 60 * sample.part
        assert sample.sub_sequence == f"{sample.sequence}_s{sample.part}"


def test_clips_are_cut_end_to_end_and_short_remainders_left_out():
    for least, parts in ((1, [(0, 60), (60, 120), (120, 130)]), (20, [(0, 60), (60, 120)])):
        plans = plan(count=None, clips={"a": 130}, frames_min=least)
        assert [(sample.start, sample.stop) for sample in plans] == parts


@pytest.mark.parametrize(("frames", "shortest"), [(60, 30), (25, 25)])
def test_the_least_length_is_a_second_unless_named(frames, shortest):
    clips = {"long": 2 * frames + shortest, "short": 2 * frames + shortest - 1}
    plans = plan(count=None, clips=clips, frames=frames, frames_min=None)
    lengths = [(sample.sequence, sample.stop - sample.start) for sample in plans]
    assert ("long", shortest) in lengths
    assert ("short", shortest - 1) not in lengths


def test_pieces_that_begin_anywhere_lie_in_their_clips_at_speeds_of_the_range():
    plans = plan(count=100, clips={**FRAMES, "short": 36}, **ANYWHERE)
    starts = set()
    for number, sample in enumerate(plans):
        available = {**FRAMES, "short": 36}[sample.sequence]
        assert 0 <= sample.start < sample.stop <= available
        assert 0.8 <= sample.speed <= 1.2
        assert 40 <= sample.frames <= 61  # a piece ends with its clip's next frame
        assert sample.mirrored == (number // 6 % 2 == 1)
        starts.add(sample.start)
    assert len(starts) > 20
    assert not any(sample.mirrored for sample in plan(**{**ANYWHERE, "mirror": False}))
    # Slowed down as far as it must be, and no further.
    assert max(s.speed for s in plans if s.sequence == "short") <= 35 / 39


def test_clips_that_are_too_short_are_named_with_the_key():
    expected = (
        r"motions.frames_min is 100, but .*: jump 60, crawl 70; expected at most 60,"
        r" or motions.sequences without them$"
    )
    with pytest.raises(InputError, match=expected):
        plan(frames=300, frames_min=100)
    with pytest.raises(InputError, match=r": c0 5, .* c9 5 and 3 more; expected at most 5"):
        plan(clips={f"c{i}": 5 for i in range(13)})
    with pytest.raises(InputError, match=r"lowest of motions.speeds 0.8, .*but short has 20"):
        plan(clips={"short": 20}, **ANYWHERE)


def test_nothing_to_wear_is_named_once_somebody_has_nothing():
    wardrobe = Wardrobe(2 / 3, ["Dress", "Top+Skirt"], male_skirts=False)
    assert plan_at_rest(1, "s", SHARES, wardrobe)[0].gender == "female"
    with pytest.raises(InputError, match="nothing for male bodies .* body.female_share: 1"):
        plan_at_rest(20, "s", SHARES, wardrobe)
