"""The list of samples, made from frame counts and a seed before anything else exists."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import cycle, islice

import numpy as np

from drapeline.dataset.splits import SPLITS, SplitItem, split_samples
from drapeline.errors import InputError
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import FPS, GENDERS
from drapeline.outfits.garment_types import outfit_types_by_gender
from drapeline.seeding import rng_for

_LISTED = 10  # clips that a message names


def sub_sequences(
    frames_of: Mapping[str, int], *, frames: int, frames_min: int
) -> dict[str, list[tuple[int, int]]]:
    """Cut every clip into (start, stop) pieces of `frames`; a short remainder may be left out."""
    return {
        name: [
            (start, min(start + frames, count))
            for start in range(0, count, frames)
            if min(start + frames, count) - start >= frames_min
        ]
        for name, count in frames_of.items()
    }


def plan_samples(
    seed: int,
    frames_of: Mapping[str, int],
    *,
    frames: int,
    frames_min: int | None,
    count: int | None,
    val_share: float,
    test_share: float,
    female_share: float,
    outfit_types: Sequence[str],
    male_skirts: bool,
) -> dict[str, SamplePlan]:
    """Plan every sample (CLOTH3D 3: one outfit and body per sub-sequence, genders 2:1).

    Samples take turns over the clips, so that few samples still see many clips. When more are
    wanted than there are sub-sequences, a sub-sequence is used again with another body and outfit.

    Args:
        frames_of: clip name -> frames at 30 fps.
        frames, frames_min: longest and shortest sub-sequence; None means a second, or `frames`
            where that is less.
        count: number of samples; None means every sub-sequence once.
        val_share, test_share: shares of the samples.
        female_share: share of female bodies, met exactly up to rounding.
        outfit_types: some of `OUTFIT_TYPES`, to take turns over in each split anew; a type named
            twice is worn twice as often.
        male_skirts: whether male bodies wear skirts and dresses.

    Raises:
        InputError: `frames_min` is above `frames` or the length of a clip, or no outfit is left
            for male bodies.
    """
    if frames_min is None:
        frames_min = min(FPS, frames)
    if frames_min > frames:
        raise InputError(
            f"motions.frames_min is {frames_min}, expected at most motions.frames,"
            f" which is {frames}"
        )
    _refuse_short_clips(frames_of, frames_min)
    pieces = sub_sequences(frames_of, frames=frames, frames_min=frames_min)
    turns = _turns(pieces)
    total = len(turns) if count is None else count
    chosen = list(islice(cycle(turns), total))
    ids = [f"{number:05d}" for number in range(1, total + 1)]
    # Every sample has a body of its own, so the clip alone joins samples into one split.
    items = [SplitItem(sample, name, sample) for sample, (name, _) in zip(ids, chosen, strict=True)]
    split_of = split_samples(
        rng_for(seed, "split"), items, val_share=val_share, test_share=test_share
    )
    splits = [split_of[sample] for sample in ids]
    genders = even_genders(rng_for(seed, "gender"), splits, female_share)
    outfits = even_outfits(genders, splits, outfit_types, male_skirts)
    plans = {}
    for sample, (name, part), gender, outfit_type in zip(
        ids, chosen, genders, outfits, strict=True
    ):
        start, stop = pieces[name][part]
        plans[sample] = SamplePlan(
            sample, name, part, start, stop, gender, outfit_type, split_of[sample]
        )
    return plans


def _refuse_short_clips(frames_of: Mapping[str, int], frames_min: int) -> None:
    short = {name: count for name, count in frames_of.items() if count < frames_min}
    if not short:
        return
    listed = ", ".join(f"{name} {count}" for name, count in list(short.items())[:_LISTED])
    listed += f" and {len(short) - _LISTED} more" if len(short) > _LISTED else ""
    raise InputError(
        f"motions.frames_min is {frames_min}, but some clips have fewer frames at {FPS} fps:"
        f" {listed}; expected at most {min(short.values())}, or motions.sequences without them"
    )


def _turns(pieces: Mapping[str, Sequence[tuple[int, int]]]) -> list[tuple[str, int]]:
    """First pieces of all clips, then second pieces, and so on."""
    longest = max(len(parts) for parts in pieces.values())
    return [
        (name, part)
        for part in range(longest)
        for name, parts in pieces.items()
        if part < len(parts)
    ]


def even_genders(rng: np.random.Generator, splits: Sequence[str], female_share: float) -> list[str]:
    """The exact share, mixed evenly within each split: small splits see both genders too.

    Args:
        rng: draws where in the mix the first sample is.
        splits: of all samples.
        female_share: of all of them.
    """
    total = len(splits)
    females = round(total * female_share)
    # Bresenham's line: female wherever the running share asks for the next one.
    offset = rng.integers(total) if total else 0
    steps = [(index + 1) * females // total - index * females // total for index in range(total)]
    genders = [""] * total
    by_split = sorted(range(total), key=lambda i: SPLITS.index(splits[i]))
    for place, i in enumerate(by_split):
        genders[i] = GENDERS[0] if steps[(place + offset) % total] else GENDERS[1]
    return genders


def even_outfits(
    genders: Sequence[str], splits: Sequence[str], outfit_types: Sequence[str], male_skirts: bool
) -> list[str]:
    """Outfit of each sample: of those its gender may wear the one its split used least so far.

    Small splits then wear the first types of the list, so that a garment type which is tested
    was trained too. In each split males choose first: what they cannot wear is left to females.

    Args:
        genders, splits: of all samples.
        outfit_types: to take turns over; a type named twice is worn twice as often.
        male_skirts: whether male bodies wear skirts and dresses.

    Raises:
        InputError: male bodies are left with nothing to wear.
    """
    allowed = outfit_types_by_gender(outfit_types, male_skirts=male_skirts, males="male" in genders)
    slots = {
        gender: [
            (name, list(outfit_types[:i]).count(name))
            for i, name in enumerate(outfit_types)
            if name in own
        ]
        for gender, own in allowed.items()
    }
    used: Counter[tuple[str, tuple[str, int]]] = Counter()
    chosen = [""] * len(genders)
    for i in sorted(range(len(genders)), key=lambda i: genders[i] == GENDERS[0]):
        slot = min(slots[genders[i]], key=lambda slot: used[splits[i], slot])
        used[splits[i], slot] += 1
        chosen[i] = slot[0]
    return chosen
