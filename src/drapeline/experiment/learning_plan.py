"""The list of samples that only networks learn from and are tested on: many, and varied."""

from collections.abc import Mapping, Sequence
from itertools import zip_longest

from drapeline.dataset.splits import SplitItem, split_samples
from drapeline.errors import InputError
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.experiment.samples import even_genders, even_outfits
from drapeline.motions.pieces import piece_span
from drapeline.seeding import rng_for


def plan_learning(
    seed: int,
    frames_of: Mapping[str, int],
    *,
    frames: int,
    frames_min: int,
    count: int,
    shard_size: int,
    speeds: tuple[float, float],
    mirror: bool,
    val_share: float,
    test_share: float,
    known_splits: Mapping[str, str],
    female_share: float,
    outfit_types: Sequence[str],
    male_skirts: bool,
) -> dict[str, list[SamplePlan]]:
    """Plan the learning group: each sample has a body, an outfit and a piece of a clip of its own.

    Samples take turns over the clips. A piece begins anywhere in its clip and is slower or faster
    than the recording; every other piece of a clip is mirrored. A short clip is slowed down as far
    as it must be to last `frames_min`, and gives a shorter piece.

    Args:
        frames_of: clip name -> frames at 30 fps.
        frames, frames_min: of a sample, as asked and at least.
        count: number of samples.
        shard_size: samples that one job makes.
        speeds: lower and upper end, seconds of the clip per second of a sample.
        mirror: whether pieces are mirrored at all.
        val_share, test_share: shares of the samples; a clip is never divided.
        known_splits: clip -> its split among the experiment's other samples, which is kept.
        female_share: share of female bodies.
        outfit_types: to take turns over in each split.
        male_skirts: whether male bodies wear skirts and dresses.

    Returns:
        Shard -> the plans of its samples, whose ids are "L" and five digits.

    Raises:
        InputError: a clip is too short even at the lowest speed, or no outfit is left for males.
    """
    ids = [f"L{number:05d}" for number in range(1, count + 1)]
    clips = [list(frames_of)[i % len(frames_of)] for i in range(count)]
    items = [SplitItem(sample, clip, sample) for sample, clip in zip(ids, clips, strict=True)]
    split_of = split_samples(
        rng_for(seed, "learning split"),
        items,
        val_share=val_share,
        test_share=test_share,
        known=known_splits,
    )
    splits = [split_of[sample] for sample in ids]
    genders = even_genders(rng_for(seed, "learning gender"), splits, female_share)
    outfits = even_outfits(genders, splits, outfit_types, male_skirts)
    shards: dict[str, list[SamplePlan]] = {}
    digits = max(len(str((count - 1) // shard_size)), 3)
    for i, (sample, clip) in enumerate(zip(ids, clips, strict=True)):
        part = i // len(frames_of)
        start, stop, speed = _piece(seed, sample, clip, frames_of[clip], frames, frames_min, speeds)
        plan = SamplePlan(
            sample,
            clip,
            part,
            start,
            stop,
            genders[i],
            outfits[i],
            splits[i],
            speed,
            mirror and part % 2 == 1,
        )
        shards.setdefault(f"{i // shard_size:0{digits}d}", []).append(plan)
    return shards


def some_held_out(
    seed: int, shards: Mapping[str, Sequence[SamplePlan]], *, split: str, most: int
) -> list[tuple[str, str]]:
    """Shard and id of some samples of a split, drawn from its clips in turn.

    Args:
        seed: of the draw.
        shards: shard -> plans of its samples.
        split: "train", "val" or "test".
        most: samples to draw; fewer if there are no more.
    """
    by_clip: dict[str, list[tuple[str, str]]] = {}
    for shard, plans in shards.items():
        for plan in plans:
            if plan.split == split:
                by_clip.setdefault(plan.sequence, []).append((shard, plan.sample))
    for clip, held_out in by_clip.items():
        rng_for(seed, "held out", clip).shuffle(held_out)
    turns = zip_longest(*by_clip.values())
    return [drawn for turn in turns for drawn in turn if drawn is not None][:most]


def _piece(
    seed: int,
    sample: str,
    clip: str,
    available: int,
    frames: int,
    frames_min: int,
    speeds: tuple[float, float],
) -> tuple[int, int, float]:
    """First frame of a piece in its clip, the frame after its last, and its speed."""
    rng = rng_for(seed, "piece", sample)
    slowest, fastest = speeds
    speed = float(rng.uniform(slowest, fastest))
    if frames_min > 1:
        speed = min(speed, (available - 1) / (frames_min - 1))
    if speed < slowest:
        raise InputError(
            f"learning.frames_min is {frames_min} and the lowest of learning.speeds {slowest:g},"
            f" which take {piece_span(frames_min, slowest)} frames of a clip, but {clip} has"
            f" {available}; expected fewer, or learning.sequences without it"
        )
    span = min(piece_span(frames, speed), available)
    start = int(rng.integers(available - span + 1))
    return start, start + span, speed
