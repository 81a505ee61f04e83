"""Which static outfits there are going to be."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drapeline.frames import GENDERS
from drapeline.outfits.garment_types import GARMENTS, outfit_types_by_gender
from drapeline.seeding import rng_for

_GOLDEN = (5**0.5 - 1) / 2


@dataclass(frozen=True)
class StaticPlan:
    """What a static outfit is going to be; it has a body and parameters of its own.

    Attributes:
        name: "s" and five digits.
        gender: "female" or "male".
        outfit_type: garments joined by "+".
        split: "train", "val" or "test".
        shard: the file it goes to.
    """

    name: str
    gender: str
    outfit_type: str
    split: str
    shard: str


def plan_static(
    seed: int,
    count: int,
    shard_size: int,
    shares: Mapping[str, float],
    female_share: float,
    outfit_types: Sequence[str],
    male_skirts: bool,
) -> dict[str, list[StaticPlan]]:
    """Plan every static outfit; types of garments come out as even as genders allow.

    Args:
        seed: the experiment's.
        count: outfits.
        shard_size: outfits per file, the last file may have fewer.
        shares: "val" and "test", shares of the outfits; the rest is for training.
        female_share: share of female bodies, met exactly up to rounding.
        outfit_types: some of `OUTFIT_TYPES`.
        male_skirts: whether male bodies wear skirts and dresses too.

    Returns:
        Shard name -> its plans. Types and genders are spread evenly over the splits.

    Raises:
        InputError: male bodies are left with nothing to wear.
    """
    females = round(count * female_share)
    allowed = outfit_types_by_gender(outfit_types, male_skirts=male_skirts, males=females < count)
    rng = rng_for(seed, "static plan")
    genders = rng.permutation([GENDERS[0]] * females + [GENDERS[1]] * (count - females)).tolist()
    chosen = _even_types(genders, allowed)
    splits = _even_splits(rng, list(zip(chosen, genders, strict=True)), shares)
    digits = len(str((count - 1) // shard_size))
    plans: dict[str, list[StaticPlan]] = {}
    for i, (gender, outfit_type, split) in enumerate(zip(genders, chosen, splits, strict=True)):
        shard = f"{i // shard_size:0{max(digits, 3)}d}"
        plan = StaticPlan(f"s{i + 1:05d}", gender, outfit_type, split, shard)
        plans.setdefault(shard, []).append(plan)
    return plans


def _even_types(genders: Sequence[str], allowed: Mapping[str, Sequence[str]]) -> list[str]:
    """For each outfit in turn the type whose garments are the rarest so far.

    Males choose first: what they cannot wear is then made up for by females.
    """
    worn, used = dict.fromkeys(GARMENTS, 0), dict.fromkeys(allowed["female"], 0)
    chosen = [""] * len(genders)
    for i in sorted(range(len(genders)), key=lambda i: genders[i] == GENDERS[0]):
        garments = {name: name.split("+") for name in allowed[genders[i]]}
        rarity = {
            name: (sum(worn[g] for g in parts) / len(parts), used[name])
            for name, parts in garments.items()
        }
        chosen[i] = min(rarity, key=rarity.__getitem__)
        used[chosen[i]] += 1
        for garment in garments[chosen[i]]:
            worn[garment] += 1
    return chosen


def _even_splits(
    rng: np.random.Generator, groups: Sequence[tuple[str, str]], shares: Mapping[str, float]
) -> list[str]:
    """Exact shares; a golden-ratio sequence over the sorted groups spreads each split evenly."""
    count = len(groups)
    order = sorted(rng.permutation(count).tolist(), key=lambda i: groups[i])
    rank = np.argsort(np.argsort((np.arange(count) * _GOLDEN + rng.random()) % 1))
    test = round(count * shares["test"])
    val = round(count * shares["val"])
    splits = [""] * count
    for i, place in zip(order, rank.tolist(), strict=True):
        splits[i] = "test" if place < test else "val" if place < test + val else "train"
    return splits
