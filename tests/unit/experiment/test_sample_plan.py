"""What follows from a sample's plan."""

from dataclasses import replace

from drapeline.experiment.sample_plan import SamplePlan

PLAN = SamplePlan("00001", "female", "Top+Skirt", "train", "walk", 2, 30, 91)


def test_the_name_of_a_piece_is_cloth3ds():
    assert PLAN.sub_sequence == "walk_s2"


def test_a_faster_sample_is_shorter_than_its_piece_of_the_clip():
    assert PLAN.frames == 61
    assert replace(PLAN, speed=1.5).frames == 41
    assert replace(PLAN, speed=0.5).frames == 121


def test_forearms_may_be_left_out_where_no_garment_can_have_sleeves():
    assert PLAN.removable == "forearms"
    assert replace(PLAN, outfit_type="Tshirt+Skirt").removable == "hands"
