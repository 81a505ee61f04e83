"""Groups of samples, as the settings ask for them."""

from pathlib import Path

import pytest

from drapeline.errors import InputError
from drapeline.experiment.config import fill_settings
from drapeline.experiment.groups import plan_groups
from drapeline.motions.table import MotionTable
from toys.schema import SCHEMA

ROOT = Path(__file__).parents[3]
CLIPS = MotionTable(ROOT / "workflow/resources/motions/clips.tsv")
SHORT = {"loop_frames": 60, "frames": 30, "frames_min": 30}


def planned(groups, **settings):
    settings = {"motions": SHORT, "groups": groups, **settings}
    return plan_groups(fill_settings(settings, SCHEMA, "mine.yaml"), CLIPS)


def test_a_group_of_ones_own_takes_the_common_settings_and_its_own():
    groups = planned(
        {
            "mine": {
                "count": 40,
                "solver": "xpbd",
                "motions": {"frames": 20, "frames_min": 20, "sequences": ["walk", "run"]},
                "outfits": {"types": ["Dress"]},
                "simulation": {"attempts": 1},
            }
        },
        body={"female_share": 1},
    )
    assert list(groups) == ["dataset", "static", "mine"]
    mine, dataset = groups["mine"], groups["dataset"]
    assert [plan.sample for plan in mine.plans[:2]] == ["mine00001", "mine00002"]
    assert {len(plans) for plans in mine.shards.values()} == {20}
    assert list(mine.shards) == ["mine00001", "mine00021"]
    assert {plan.outfit_type for plan in mine.plans} == {"Dress"}
    assert {plan.frames for plan in mine.plans} == {20}
    assert list(mine.clips) == ["walk", "run"]
    assert mine.simulation == {**dataset.simulation, "attempts": 1}
    assert mine.outfits["edge_length_m"] == dataset.outfits["edge_length_m"]
    assert not mine.published
    assert dataset.published
    assert (dataset.solver, mine.solver) == ("blender", "xpbd")


def test_ids_of_shipped_groups_and_groups_at_rest():
    groups = planned({"learning": {"count": 3}, "static": {"count": 3}, "dataset": {"count": 3}})
    ids = {name: group.plans[0].sample for name, group in groups.items()}
    assert ids == {"dataset": "00001", "learning": "L00001", "static": "s00001"}
    assert groups["static"].at_rest
    assert not groups["static"].clips
    assert {plan.frames for plan in groups["static"].plans} == {0}


def test_a_group_without_samples_is_left_out():
    groups = planned({"static": {"count": 0}, "dataset": {"count": 1}})
    assert list(groups) == ["dataset"]


def test_a_clip_is_in_one_split_in_all_groups():
    groups = planned({"learning": {"count": 60}, "mine": {"count": 60}})
    split_of = {}
    for group in groups.values():
        for plan in group.plans:
            if plan.sequence:
                assert split_of.setdefault(plan.sequence, plan.split) == plan.split


def test_a_group_more_changes_none_of_those_before_it():
    before = planned({"dataset": {"count": 9}, "learning": {"count": 30}})
    after = planned({"mine": {"count": 5}, "dataset": {"count": 1}, "learning": {"count": 30}})
    assert after["learning"].plans == before["learning"].plans
    assert after["dataset"].plans == before["dataset"].plans[:1]


@pytest.mark.parametrize("prefix", ["", "L", "s"])
def test_ids_are_unique(prefix):
    with pytest.raises(InputError, match=rf"mine.prefix gives a sample the id {prefix}00001,"):
        planned({"learning": {"count": 3}, "mine": {"count": 3, "prefix": prefix}})


def test_a_group_whose_name_ends_in_a_digit_has_ids_that_can_be_read():
    groups = planned({"mine2": {"count": 3}})
    assert groups["mine2"].plans[0].sample == "mine2_00001"
    with pytest.raises(InputError, match="prefix is 'mine2', expected"):
        planned({"mine": {"count": 3, "prefix": "mine2"}})


def test_a_table_of_motions_may_assign_splits(tmp_path):
    clips = (("walk", "test"), ("spin", ""), ("jump", "val"), ("kick", "train"))
    rows = [f"{name}\t{CLIPS.path.parent / name}.npz\t{split}" for name, split in clips]
    table = tmp_path / "clips.tsv"
    table.write_text("\n".join(["name\tfile\tsplit", *rows]) + "\n")
    settings = fill_settings({"groups": {"dataset": {"count": 8}}}, SCHEMA, "mine.yaml")
    plans = plan_groups(settings, MotionTable(table))["dataset"].plans
    split_of = {plan.sequence: plan.split for plan in plans}
    assert {name: split_of[name] for name, split in clips if split} == {
        name: split for name, split in clips if split
    }
    table.write_text(table.read_text().replace("val", "check"))
    with pytest.raises(InputError, match="'jump' has split 'check', expected one of train, val"):
        plan_groups(settings, MotionTable(table))
