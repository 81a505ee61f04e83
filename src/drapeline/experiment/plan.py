"""The plan of a group: what each sample is going to be, before anything exists.

What a sample is depends on the seed, its group and its number, not on how many samples there are:
whoever asks for more keeps those that he has.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from drapeline.dataset.record import SPLITS
from drapeline.errors import InputError
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.frames import FPS, GENDERS
from drapeline.motions.variation import piece_span
from drapeline.outfits.garment_types import outfit_types_by_gender
from drapeline.seeding import rng_for

_GOLDEN = (5**0.5 - 1) / 2
_LISTED = 10  # clips that a message names


class ClipPiece(NamedTuple):
    """Piece of a clip that a sample's motion is cut from; fields of `SamplePlan`."""

    sequence: str
    part: int
    start: int
    stop: int
    speed: float = 1.0
    mirrored: bool = False


class Wardrobe(NamedTuple):
    """Who wears what in a group."""

    female_share: float  # share of female bodies
    # To take turns over in each split; a type named twice is worn twice as often.
    outfit_types: Sequence[str]
    male_skirts: bool  # whether male bodies wear skirts and dresses


def plan_moving(
    count: int,
    prefix: str,
    pieces: Callable[[int, str], ClipPiece],
    splits: Mapping[str, str],
    wardrobe: Wardrobe,
) -> list[SamplePlan]:
    """Plan samples in motion.

    Args:
        prefix: of their ids, before five digits.
        pieces: number and id of a sample -> what its motion is cut from.
        splits: clip -> split, see `split_clips`.

    Raises:
        InputError: male bodies are left with nothing to wear.
    """
    dressing, plans = _Dressing(wardrobe), []
    for number in range(count):
        sample = f"{prefix}{number + 1:05d}"
        piece = pieces(number, sample)
        split = splits[piece.sequence]
        plans.append(
            SamplePlan(sample, *dressing.next_in(split, piece.sequence), split, **piece._asdict())
        )
    return plans


def plan_at_rest(
    count: int, prefix: str, shares: Mapping[str, float], wardrobe: Wardrobe
) -> list[SamplePlan]:
    """Plan samples at rest, whose bodies and outfits have nothing in common.

    Args:
        prefix: of their ids, before five digits.
        shares: "val" and "test", shares of the samples; the rest is for training.

    Raises:
        InputError: male bodies are left with nothing to wear.
    """
    dressing, filled, plans = _Dressing(wardrobe), Counter[str](), []
    for number in range(count):
        split = _emptiest(shares, filled, number + 1)
        filled[split] += 1
        sample = f"{prefix}{number + 1:05d}"
        plans.append(SamplePlan(sample, *dressing.next_in(split), split))
    return plans


def _emptiest(shares: Mapping[str, float], filled: Mapping[str, float], total: float) -> str:
    """The split that lacks most of its share of a total; of equals, the smaller one."""
    parts = _with_train(shares)
    return max(parts, key=lambda split: (parts[split] * total - filled[split], -parts[split]))


def _with_train(shares: Mapping[str, float]) -> dict[str, float]:
    """Split -> share, without those of which nothing is wanted."""
    parts = {"train": 1 - sum(shares.values()), **shares}
    return {split: parts[split] for split in SPLITS if parts[split] > 0}


def split_clips(
    seed: int,
    group: str,
    sizes: Mapping[str, float],
    shares: Mapping[str, float],
    known: Mapping[str, str],
) -> dict[str, str]:
    """Assign every clip to a split, whatever the number of samples.

    CLOTH3D was split by sequence, so that parts of the same clip are in several splits. Here a clip
    is in one split, in all groups. The first clips fill a split each, and then a clip goes to one
    that lacks some of its share of the clips so far, the likelier the more it lacks: so the shares
    hold for those who use the first few of many clips, too.

    Args:
        seed: draws the splits.
        sizes: clip -> its share of the samples, in any unit; in the order in which samples take
            turns over them.
        shares: "val" and "test", shares of the samples; the rest is for training.
        known: clip -> split that an earlier group has given it, which it keeps.

    Returns:
        Clip -> "train", "val" or "test".
    """
    rng, parts = rng_for(seed, "split", group), _with_train(shares)
    first = [split for split in ("train", "test", "val") if split in parts]
    total, filled = 0.0, defaultdict[str, float](float)
    split_of = {}
    for clip, size in sizes.items():
        total += size
        split = known.get(clip) or next((split for split in first if not filled[split]), "")
        if not split:
            lacks = {s: max(share * total - filled[s], 0) for s, share in parts.items()}
            chances = np.array([*lacks.values()]) / sum(lacks.values())
            split = str(rng.choice([*lacks], p=chances))
        split_of[clip] = split
        filled[split] += size
    return split_of


class _Dressing:
    """Genders and outfits of samples, which each split goes through in turn by itself."""

    def __init__(self, wardrobe: Wardrobe) -> None:
        self._wardrobe = wardrobe
        self._allowed = self._types(males=False)
        self._used: Counter[tuple[str, str, int]] = Counter()
        self._moved: Counter[tuple[str | None, str]] = Counter()
        self._members: Counter[str] = Counter()

    def _types(self, *, males: bool) -> dict[str, list[str]]:
        wardrobe = self._wardrobe
        return outfit_types_by_gender(
            wardrobe.outfit_types, male_skirts=wardrobe.male_skirts, males=males
        )

    def next_in(self, split: str, clip: str | None = None) -> tuple[str, str]:
        """Gender and outfit type of the next sample of a split, which moves through a clip.

        It wears what its split has used least so far; of equals, what its clip has moved least.
        Clips and types, which both come in turn, would otherwise fall into step: each type would
        see some of the clips only. Small splits wear the first types of the list, so that a garment
        type which is tested was trained too.
        """
        gender = GENDERS[0 if is_female(self._members[split], self._wardrobe.female_share) else 1]
        self._members[split] += 1
        if not self._allowed[gender]:
            self._types(males=True)  # says what is wrong
        # A type named twice has two places in the list, and two turns.
        seen: Counter[str] = Counter()
        places = []
        for outfit_type in self._wardrobe.outfit_types:
            if outfit_type in self._allowed[gender]:
                places.append((split, outfit_type, seen[outfit_type]))
            seen[outfit_type] += 1
        place = min(places, key=lambda one: (self._used[one], self._moved[clip, one[1]]))
        self._used[place] += 1
        self._moved[clip, place[1]] += 1
        return gender, place[1]


def is_female(number: int, share: float) -> bool:
    """Whether the body of a split's sample is female: a low-discrepancy sequence of the share.

    A golden-ratio sequence does not fall into step with the clips that samples take turns over.
    It begins so that the first two samples are of both genders, unless all are of one.
    """
    start = min(share, 1 - _GOLDEN) / 2 if share <= _GOLDEN else (share + 1) / 2 - _GOLDEN
    return (start + number * _GOLDEN) % 1 < share


@dataclass(frozen=True)
class Pieces:
    """Pieces of clips for a group's samples."""

    of_sample: Callable[[int, str], ClipPiece]  # number and id of a sample -> its piece
    sizes: Mapping[str, float]  # clip -> how often samples come back to it, in any unit
    # How many there are before one comes again; for pieces that begin anywhere, one of each clip.
    count: int


def cut_pieces(seed: int, frames_of: Mapping[str, int], motions: Mapping[str, Any]) -> Pieces:
    """Pieces of clips, as the settings `motions` ask for them.

    Args:
        frames_of: clip -> frames at 30 fps.
        motions: `frames`, `frames_min`, `anywhere`, `speeds` and `mirror`, as in the config. A
            `frames_min` of None means a second, or `frames` where that is less.

    Raises:
        InputError: a clip is too short.
    """
    frames = motions["frames"]
    least = min(FPS, frames) if motions["frames_min"] is None else motions["frames_min"]
    if not motions["anywhere"]:
        return pieces_in_turn(frames_of, frames, least)
    return pieces_anywhere(
        seed, frames_of, frames, least, speeds=motions["speeds"], mirror=motions["mirror"]
    )


def pieces_in_turn(frames_of: Mapping[str, int], frames: int, frames_min: int) -> Pieces:
    """Cut every clip into pieces one after another: the first of all clips, then the second ...

    So few samples still see many clips. Samples beyond the last piece begin again, with other
    bodies and outfits.

    Args:
        frames_of: clip -> frames at 30 fps.
        frames, frames_min: longest and shortest piece; a shorter remainder is dropped.

    Raises:
        InputError: a clip is shorter than `frames_min`.
    """
    _refuse_short_clips(frames_of, frames_min)
    starts = {
        clip: list(range(0, available - frames_min + 1, frames))
        for clip, available in frames_of.items()
    }
    pieces = [
        ClipPiece(clip, part, own[part], min(own[part] + frames, frames_of[clip]))
        for part in range(max(map(len, starts.values())))
        for clip, own in starts.items()
        if part < len(own)
    ]

    def piece(number: int, sample: str) -> ClipPiece:
        return pieces[number % len(pieces)]

    return Pieces(piece, {clip: len(own) for clip, own in starts.items()}, len(pieces))


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


def pieces_anywhere(
    seed: int,
    frames_of: Mapping[str, int],
    frames: int,
    frames_min: int,
    *,
    speeds: tuple[float, float],
    mirror: bool,
) -> Pieces:
    """Pieces that begin anywhere in their clips, which samples take turns over.

    A piece is slower or faster than the recording, and every other piece of a clip is mirrored. A
    short clip is slowed down as far as it must be to last `frames_min`, and gives a shorter piece.

    Args:
        frames_of: clip -> frames at 30 fps.
        frames, frames_min: of a sample, as asked and at least.
        speeds: lower and upper end, seconds of the clip per second of a sample.
        mirror: whether pieces are mirrored at all.

    Raises:
        InputError: a clip is too short even at the lowest speed.
    """
    clips, (slowest, fastest) = list(frames_of), speeds
    for clip, available in frames_of.items():
        if available < piece_span(frames_min, slowest):
            raise InputError(
                f"motions.frames_min is {frames_min} and the lowest of motions.speeds {slowest:g},"
                f" which take {piece_span(frames_min, slowest)} frames of a clip, but {clip} has"
                f" {available}; expected fewer, or motions.sequences without it"
            )

    def piece(number: int, sample: str) -> ClipPiece:
        part, place = divmod(number, len(clips))
        available = frames_of[clips[place]]
        rng = rng_for(seed, "piece", sample)
        speed = float(rng.uniform(slowest, fastest))
        if frames_min > 1:
            speed = min(speed, (available - 1) / (frames_min - 1))
        span = min(piece_span(frames, speed), available)
        start = int(rng.integers(available - span + 1))
        return ClipPiece(clips[place], part, start, start + span, speed, mirror and part % 2 == 1)

    return Pieces(piece, dict.fromkeys(clips, 1), len(clips))
