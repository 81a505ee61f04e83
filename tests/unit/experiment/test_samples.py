from collections import Counter

import pytest

from drapeline.dataset.splits import SPLITS
from drapeline.errors import InputError
from drapeline.experiment.samples import plan_samples, sub_sequences
from drapeline.outfits.garment_types import OUTFIT_TYPES

FRAMES = {"walk": 120, "run": 125, "jump": 60, "crawl": 70, "spin": 130}


def plan(seed=1, count=18, clips=FRAMES, **changes):
    settings = {
        "frames": 60,
        "frames_min": 60,
        "count": count,
        "val_share": 0.2,
        "test_share": 0.2,
        "female_share": 2 / 3,
        "outfit_types": OUTFIT_TYPES,
        "male_skirts": False,
    }
    return plan_samples(seed, clips, **{**settings, **changes})


def test_clips_are_cut_end_to_end_and_short_remainders_left_out():
    assert sub_sequences({"a": 130}, frames=60, frames_min=1) == {
        "a": [(0, 60), (60, 120), (120, 130)]
    }
    assert sub_sequences({"a": 130}, frames=60, frames_min=20) == {"a": [(0, 60), (60, 120)]}
    assert sub_sequences({"a": 19}, frames=60, frames_min=20) == {"a": []}


def test_samples_take_turns_over_the_clips_and_then_reuse_them():
    names = [s.sequence for s in plan().values()]
    assert names[:5] == ["walk", "run", "jump", "crawl", "spin"]
    assert names[5:8] == ["walk", "run", "spin"]
    assert names[8:13] == names[:5]


def test_without_a_count_each_sub_sequence_is_used_once():
    plans = plan(count=None)
    used = [(s.sequence, s.part) for s in plans.values()]
    assert len(used) == len(set(used)) == 8
    assert all(s.stop - s.start == 60 and s.start == 60 * s.part for s in plans.values())


@pytest.mark.parametrize("count", [3, 18, 100])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_genders_are_two_to_one_up_to_rounding_and_mixed_in_every_split(count, seed):
    plans = plan(seed, count).values()
    assert [s.gender for s in plans].count("female") == round(count * 2 / 3)
    for split in SPLITS:
        genders = [s.gender for s in plans if s.split == split]
        assert abs(genders.count("female") - len(genders) * 2 / 3) <= 1
        for start in range(len(genders) - 5):
            assert 3 <= genders[start : start + 6].count("female") <= 5


def test_outfits_are_balanced_and_men_wear_no_skirts_unless_asked():
    plans = plan(count=90).values()
    worn = Counter(s.outfit_type for s in plans)
    men = Counter(s.outfit_type for s in plans if s.gender == "male")
    assert set(worn) == set(OUTFIT_TYPES)
    assert max(worn.values()) - min(worn.values()) <= 3  # one for each split
    assert set(men) == {"Tshirt+Trousers", "Top+Trousers", "Jumpsuit"}
    assert "Dress" in {
        s.outfit_type for s in plan(count=90, male_skirts=True).values() if s.gender == "male"
    }


@pytest.mark.parametrize("seed", range(5))
def test_every_split_wears_the_first_types_and_one_named_twice_is_worn_twice(seed):
    outfit_types = ["Tshirt+Trousers", "Tshirt+Skirt", "Dress", "Jumpsuit", "Dress"]
    worn = {}
    for sample in plan(seed, count=30, outfit_types=outfit_types).values():
        worn.setdefault(sample.split, Counter())[sample.outfit_type] += 1
    for split in worn.values():
        assert split["Tshirt+Trousers"]
        assert split["Tshirt+Skirt"]
    assert worn["train"]["Dress"] >= 2 * worn["train"]["Jumpsuit"] - 2


@pytest.mark.parametrize("seed", range(5))
def test_splits_share_no_clip_and_none_is_empty(seed):
    clips = {}
    for sample in plan(seed).values():
        clips.setdefault(sample.split, set()).add(sample.sequence)
    assert set(clips) == {"train", "val", "test"}
    assert sum(len(names) for names in clips.values()) == len(set().union(*clips.values()))


def test_the_plan_depends_on_the_seed_alone():
    assert plan(3) == plan(3)
    assert plan(3) != plan(4)


def test_clips_that_are_too_short_are_named_with_the_key():
    expected = (
        r"motions.frames_min is 100, but .*: jump 60, crawl 70; expected at most 60,"
        r" or motions.sequences without them$"
    )
    with pytest.raises(InputError, match=expected):
        plan(frames=300, frames_min=100)


def test_of_many_short_clips_ten_are_named():
    with pytest.raises(InputError, match=r": c0 5, .* c9 5 and 3 more; expected at most 5"):
        plan(clips={f"c{i}": 5 for i in range(13)})


@pytest.mark.parametrize(("frames", "shortest"), [(60, 30), (25, 25)])
def test_the_least_length_is_a_second_unless_named(frames, shortest):
    clips = {"long": 2 * frames + shortest, "short": 2 * frames + shortest - 1}
    plans = plan(count=None, clips=clips, frames=frames, frames_min=None)
    lengths = [(s.sequence, s.stop - s.start) for s in plans.values()]
    assert ("long", shortest) in lengths
    assert ("short", shortest - 1) not in lengths


def test_a_least_length_above_the_length_is_named():
    with pytest.raises(InputError, match=r"frames_min is 100, expected at most .*, which is 60"):
        plan(frames=60, frames_min=100)


def test_nothing_to_wear_is_named():
    with pytest.raises(InputError, match="nothing for male bodies .* body.female_share: 1"):
        plan(outfit_types=["Dress", "Top+Skirt"])


def test_sub_sequences_are_named_as_in_cloth3d_and_tops_leave_the_arms_bare():
    for sample in plan().values():
        assert sample.sub_sequence == f"{sample.sequence}_s{sample.start // 60}"
        assert (sample.removable == "forearms") == ("Top" in sample.outfit_type)
