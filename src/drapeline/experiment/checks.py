"""Checks of an experiment before any job runs: contradictions, splits and stages without data."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from typing import Any, NamedTuple

from drapeline.errors import InputError
from drapeline.experiment.groups import AT_REST, own_settings
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import GENDERS
from drapeline.outfits.fabrics import FABRICS, fabrics_of

# A shape space needs a mean and a direction.
_SPACE_GARMENTS = 2
# How many numbers there are, one for each level of meshes or of points.
_LENGTHS = {
    **{f"gcvae.{model}.network.widths": 6 for model in ("svae", "dvae")},
    **{
        f"garment4d.posed.network.{points}_{key}": 3
        for points in ("garment", "body")
        for key in ("radii_m", "counts")
    },
}


def refuse_contradictions(settings: Mapping[str, Any]) -> None:
    """Check settings that are each in range but contradict one another.

    Raises:
        InputError: names the keys, their values and what is expected.
    """
    solver = settings["simulation"]["settings"]
    if solver["steps_min"] > solver["steps_max"]:
        raise InputError(
            f"simulation.settings.steps_min is {solver['steps_min']}, expected at most"
            f" steps_max, which is {solver['steps_max']}"
        )
    bmi = settings["body"]["bmi_range"]
    if bmi is not None and bmi[0] > bmi[1]:
        raise InputError(f"body.bmi_range is {list(bmi)}, expected the lower end first")
    for name, group in settings["groups"].items():
        _refuse_group(name, group, settings)
    for name, own in settings["outfits"]["own_garments"].items():
        if not isinstance(own, str) and not any(own[key] for key in ("file", *GENDERS)):
            raise InputError(
                f"outfits.own_garments.{name} names no OBJ file, expected file, female or male"
            )
    for path, count in _LENGTHS.items():
        value = reduce(lambda part, key: part[key], path.split("."), settings)
        if len(value) != count:
            raise InputError(f"{path} is {value}, expected {count} numbers, one for each level")
    clip, threshold = (
        settings["smplicit"][part][key]
        for part, key in (("loss", "d_max_m"), ("meshing", "threshold_m"))
    )
    if threshold >= clip:
        raise InputError(
            f"smplicit.meshing.threshold_m is {threshold}, expected less than"
            f" smplicit.loss.d_max_m, which is {clip}: the field tells no greater distance"
        )
    for stage in ("labels", "canonical", "posed", "mgn"):
        training = settings["garment4d"][stage]["training"]
        strides = {f"garment4d.{stage}.training.stride": training["stride"]}
        if stage in ("posed", "mgn"):
            strides["garment4d.evaluation.stride"] = settings["garment4d"]["evaluation"]["stride"]
        for key, stride in strides.items():
            if stride > training["frames"]:
                raise InputError(
                    f"{key} is {stride}, expected at most garment4d.{stage}.training.frames, which"
                    f" is {training['frames']}: no frame may lie between windows"
                )


def _refuse_group(name: str, group: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    """Check a group by the settings that hold for it."""
    key = f"groups.{name}"
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", name):
        raise InputError(f"groups has '{name:.100}', expected a letter, then letters and digits")
    val, test = group["val_share"], group["test_share"]
    if val + test >= 1:
        raise InputError(
            f"{key}.val_share is {val} and {key}.test_share {test}, expected a sum below 1"
        )
    if group["solver"] == AT_REST:
        if group["count"] is None:
            raise InputError(f"{key}.count is null and its solver none, expected a number")
        if group["published"]:
            raise InputError(
                f"{key}.published is true and its solver none, expected a solver, since the dataset"
                " is of people in motion"
            )
    motions, outfits = (
        own_settings(settings[part], group[part]) for part in ("motions", "outfits")
    )
    for part, ends in (
        ("motions.speeds", motions["speeds"]),
        ("outfits.tightness_range", outfits["tightness_range"]),
    ):
        if ends[0] > ends[1]:
            raise InputError(f"{part} is {list(ends)} in {key}, expected the lower end first")
    for garment in sorted({name for worn in outfits["types"] for name in worn.split("+")}):
        if not fabrics_of(garment, outfits["fabrics"]):
            raise InputError(
                f"outfits.fabrics is {', '.join(outfits['fabrics'])} in {key}, none of which"
                f" makes a {garment}, expected one of {', '.join(fabrics_of(garment, FABRICS))}"
            )
    if motions["frames_min"] is not None and motions["frames_min"] > motions["frames"]:
        raise InputError(
            f"motions.frames_min is {motions['frames_min']} in {key}, expected at most"
            f" motions.frames, which is {motions['frames']}"
        )
    if not motions["anywhere"] and (list(motions["speeds"]) != [1, 1] or motions["mirror"]):
        raise InputError(
            f"motions.speeds is {list(motions['speeds'])} and motions.mirror"
            f" {motions['mirror']} in {key}, expected motions.anywhere to be true for these"
        )


def require_splits(
    planned: Iterable[str], needed: Sequence[str], *, groups: Mapping[str, Mapping[str, Any]]
) -> None:
    """Check that a plan puts something into every split that is going to be used.

    Args:
        planned: split of everything in the plan.
        needed: splits that must not be empty.
        groups: that were planned, with their `val_share` and `test_share`.

    Raises:
        InputError: one of the splits is empty.
    """
    counts = Counter(planned)
    shares = " and ".join(
        f"groups.{name}.val_share is {own['val_share']} and its test_share {own['test_share']}"
        for name, own in groups.items()
    )
    for split in needed:
        if not counts[split]:
            raise InputError(
                f"{shares or 'there is no group of this kind'}, which puts none of"
                f" {counts.total()} into {split}, expected one or more; samples of one clip are"
                " never divided between splits"
            )


def require_simulated(garment: str, wearers: Iterable[SamplePlan], splits: Sequence[str]) -> None:
    """Check that a garment type is simulated in every split that is measured.

    Args:
        wearers: samples that wear it.
        splits: that are measured.

    Raises:
        InputError: a split has none.
    """
    found = {sample.split for sample in wearers}
    for split in splits:
        if split not in found:
            raise InputError(
                f"the plan has no simulated {garment} for {split}, expected one or more to measure;"
                " outfits.types, the counts of groups and the shares of their splits decide"
            )


class PlannedSequence(NamedTuple):
    """A garment in motion that Garment4D is going to learn from or be tested on."""

    source: str  # "simulated" or "skinned"
    split: str  # "train", "val" or "test"
    frames: int  # its length


def planned_sequences(
    garment: str,
    samples: Iterable[SamplePlan],
    outfits: Iterable[SamplePlan],
    *,
    frames: int,
    step: int,
) -> list[PlannedSequence]:
    """Every sequence of a garment type, provided that no sample is rejected.

    Args:
        samples: simulated; static outfits move as those of their split do.
        outfits: static, put into motion.
        frames: number of frames of a static outfit in motion.
        step: between them, in frames of the sample.

    Raises:
        InputError: no sample is long enough for a static outfit to move through.
    """
    samples, outfits = list(samples), list(outfits)
    span = (frames - 1) * step + 1
    longest = max((sample.frames for sample in samples), default=0)
    if outfits and longest < span:
        raise InputError(
            f"garment4d.skinned.frames is {frames} and step {step}, which take {span} frames of a"
            f" sample, expected at most those of the longest, {longest}"
        )
    moving = {sample.split for sample in samples if sample.frames >= span}
    return [
        *(
            PlannedSequence("simulated", sample.split, sample.frames)
            for sample in samples
            if garment in sample.outfit_type.split("+")
        ),
        *(
            PlannedSequence("skinned", outfit.split, frames)
            for outfit in outfits
            if garment in outfit.outfit_type.split("+") and outfit.split in moving
        ),
    ]


def require_sequences(
    garment: str,
    planned: Iterable[PlannedSequence],
    *,
    stage: str,
    sources: Sequence[str],
    window: int,
) -> None:
    """Check that a stage of Garment4D has the sequences that it is trained and selected on.

    Args:
        stage: of the settings, for the message.
        sources: of the training sequences; validation takes any if these provide none.
        window: frames T.

    Raises:
        InputError: there are too few sequences, or one is shorter than a window.
    """
    planned = list(planned)
    train = [sequence for sequence in planned if sequence.split == "train"]
    val = [sequence for sequence in planned if sequence.split == "val"]
    own = [sequence for sequence in train if sequence.source in sources]
    for split, available, least, origin in (
        ("train", train, _SPACE_GARMENTS, "of any source"),
        ("train", own, 1, f"of garment4d.{stage}.training.sources ({', '.join(sources)})"),
        ("val", val, 1, "of any source"),
    ):
        if len(available) < least:
            raise InputError(
                f"the plan has {len(available)} sequences of a {garment} for {split} {origin},"
                f" expected {least} or more; outfits.types, the counts of groups, the"
                " shares of their splits and garment4d.skinned.shards decide"
            )
    seen = own + ([sequence for sequence in val if sequence.source in sources] or val)
    shortest = min(seen, key=lambda sequence: sequence.frames)
    if shortest.frames < window:
        raise InputError(
            f"garment4d.{stage}.training.frames is {window}, expected at most {shortest.frames},"
            f" the frames of a {shortest.source} sequence of a {garment}"
        )
