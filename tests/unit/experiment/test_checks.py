"""Refusals of experiments that cannot work, and none of those that can."""

from pathlib import Path

import pytest

from drapeline.errors import InputError
from drapeline.experiment.checks import (
    PlannedSequence,
    planned_sequences,
    refuse_contradictions,
    require_sequences,
    require_simulated,
    require_splits,
)
from drapeline.experiment.config import fill_settings
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.registration.to_body.hierarchy import LEVELS
from toys.schema import SCHEMA

ROOT = Path(__file__).parents[3]
GROUPS = {"dataset": {"val_share": 0, "test_share": 0.2}}


def settings(**given):
    return fill_settings(given, SCHEMA, "x.yaml")


def test_networks_have_widths_for_all_levels_of_the_hierarchies():
    for model in ("svae", "dvae"):
        assert len(settings()["gcvae"][model]["network"]["widths"]) == LEVELS
    refuse_contradictions(settings())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"outfits": {"fabrics": ["denim", "leather"]}},
            "outfits.fabrics is denim, leather in groups.dataset, none of which makes a Top,"
            " expected one of cotton, linen, ",
        ),
        (
            {"groups": {"learning": {"motions": {"speeds": [1.2, 0.8]}}}},
            r"motions.speeds is \[1.2, 0.8\] in groups.learning, expected the lower end first$",
        ),
        (
            {"groups": {"learning": {"motions": {"frames": 30}}}},
            "motions.frames_min is 40 in groups.learning, expected at most motions.frames, .* 30$",
        ),
        (
            {"groups": {"mine": {"motions": {"mirror": True}}}},
            "motions.mirror True in groups.mine, expected motions.anywhere to be true for these$",
        ),
        (
            {"groups": {"mine": {"solver": "none"}}},
            "groups.mine.count is null and its solver none, expected a number$",
        ),
        (
            {"groups": {"mine": {"solver": "none", "count": 3, "published": True}}},
            "groups.mine.published is true and its solver none, expected a solver, since",
        ),
        (
            {"simulation": {"settings": {"steps_min": 30}}},
            r"simulation.settings.steps_min is 30, expected at most steps_max, which is 14$",
        ),
        (
            {"gcvae": {"dvae": {"network": {"widths": [8] * 5}}}},
            r"gcvae.dvae.network.widths is \[8, .*\], expected 6 numbers, one for each level$",
        ),
        (
            {"garment4d": {"posed": {"network": {"body_counts": [8]}}}},
            r"garment4d.posed.network.body_counts is \[8\], expected 3 numbers, one for each level",
        ),
        (
            {"outfits": {"tightness_range": [0.5, -1.5]}},
            r"outfits.tightness_range is \[0.5, -1.5\] in groups.dataset, expected the lower end",
        ),
        (
            {"outfits": {"own_garments": {"Skirt": {"fabric": "silk"}}}},
            r"outfits.own_garments.Skirt names no OBJ file, expected file, female or male$",
        ),
        (
            {"groups": {"static": {"val_share": 0.9, "test_share": 0.9}}},
            r"groups.static.val_share is 0.9 and groups.static.test_share 0.9, expected a sum be",
        ),
        (
            {"garment4d": {"mgn": {"training": {"frames": 4, "stride": 5}}}},
            r"garment4d.mgn.training.stride is 5, expected at most garment4d.mgn.training.frames,"
            r" which is 4: no frame may lie between windows$",
        ),
        (
            {"garment4d": {"labels": {"training": {"frames": 4, "stride": 5}}}},
            r"garment4d.labels.training.stride is 5, expected at most garment4d.labels.training.fr",
        ),
        (
            {"garment4d": {"evaluation": {"stride": 11}}},
            r"garment4d.evaluation.stride is 11, expected at most garment4d.posed.training.frames",
        ),
        (
            {"smplicit": {"loss": {"d_max_m": 0.01}}},
            r"smplicit.meshing.threshold_m is 0.01, expected less than smplicit.loss.d_max_m, which"
            r" is 0.01: the field tells no greater distance$",
        ),
    ],
)
def test_contradictions_are_named_with_both_values(given, message):
    with pytest.raises(InputError, match=message):
        refuse_contradictions(settings(**given))


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"simulation": {"settings": {"steps_min": 14}}},
        {"outfits": {"tightness_range": [0.5, 0.5]}},
        {"groups": {"static": {"val_share": 0, "test_share": 0}}},
    ],
)
def test_what_agrees_passes(given):
    refuse_contradictions(settings(**given))


def test_an_empty_split_is_named_where_it_is_needed():
    planned = ["train"] * 15 + ["test"]
    require_splits(planned, ["train", "test"], groups=GROUPS)
    expected = (
        "groups.dataset.val_share is 0 and its test_share 0.2, which puts none of 16 into val,"
        " expected one or more"
    )
    with pytest.raises(InputError, match=expected):
        require_splits(planned, ["train", "val"], groups=GROUPS)
    with pytest.raises(InputError, match="there is no group of this kind, which puts none of 0"):
        require_splits([], ["train"], groups={})


def sample(outfit_type, split, frames=60):
    return SamplePlan("00001", "female", outfit_type, split, "walk", 0, 30, 30 + frames)


def outfit(outfit_type, split):
    return SamplePlan("s00001", "female", outfit_type, split)


def test_sequences_of_a_type_are_those_who_wear_it_and_static_ones_of_splits_that_move():
    samples = [sample("Top+Skirt", "train"), sample("Dress", "val", 12), sample("Dress", "test", 8)]
    outfits = [outfit("Tshirt+Skirt", split) for split in ("train", "val", "test")]
    assert planned_sequences("Skirt", samples, outfits, frames=4, step=3) == [
        PlannedSequence("simulated", "train", 60),
        PlannedSequence("skinned", "train", 4),
        PlannedSequence("skinned", "val", 4),
    ]
    assert planned_sequences("Trousers", samples, outfits, frames=4, step=3) == []


def test_static_outfits_need_a_sample_as_long_as_their_motion():
    samples = [sample("Dress", "train", 12)]
    message = r"skinned.frames is 5 and step 3, which take 13 frames of a sample, .* longest, 12$"
    with pytest.raises(InputError, match=message):
        planned_sequences("Skirt", samples, [outfit("Dress", "train")], frames=5, step=3)
    assert planned_sequences("Skirt", samples, [], frames=5, step=3) == []


SIMULATED, SKINNED = ("simulated",), ("simulated", "skinned")
ENOUGH = [
    PlannedSequence("simulated", "train", 60),
    PlannedSequence("skinned", "train", 4),
    PlannedSequence("skinned", "val", 4),
]


def require(planned, sources, window):
    require_sequences("Skirt", planned, stage="posed", sources=sources, window=window)


def test_what_is_measured_must_be_simulated():
    wearers = [
        SamplePlan("00001", "female", "Tshirt+Skirt", split, "walk", 0, 0, 60)
        for split in ("train", "test")
    ]
    require_simulated("Skirt", wearers, ["test"])
    with pytest.raises(InputError, match="no simulated Skirt for val, expected one or more"):
        require_simulated("Skirt", wearers, ["val", "test"])


def test_enough_sequences_pass():
    require(ENOUGH, SIMULATED, 4)
    require(ENOUGH, SKINNED, 4)
    # Validation has some of the stage's own source here, so the others' length does not matter.
    require([*ENOUGH, PlannedSequence("simulated", "val", 10)], SIMULATED, 10)


@pytest.mark.parametrize(
    ("planned", "sources", "message"),
    [
        (ENOUGH[1:], SKINNED, "has 1 sequences of a Skirt for train of any source, expected 2 or"),
        (
            [ENOUGH[1], *ENOUGH[1:]],
            SIMULATED,
            r"has 0 sequences .* of garment4d.posed.training.sources \(simulated\), expected 1 or",
        ),
        (ENOUGH[:2], SKINNED, "has 0 sequences of a Skirt for val of any source, expected 1 or"),
    ],
)
def test_too_few_sequences_are_counted(planned, sources, message):
    with pytest.raises(InputError, match=message):
        require(planned, sources, 4)


@pytest.mark.parametrize("sources", [SIMULATED, SKINNED])
def test_a_window_longer_than_a_sequence_is_named(sources):
    message = (
        r"garment4d.posed.training.frames is 10, expected at most 4, the frames of a skinned"
        r" sequence of a Skirt$"
    )
    with pytest.raises(InputError, match=message):
        require(ENOUGH, sources, 10)
