"""Static outfits: outfits in rest pose, many to a file, made for learning and never simulated."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.sampling import sample_shape
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.outfits.outfit import GARMENTS, Garment, Outfit, sample_outfit
from drapeline.outfits.ranges import OutfitRanges
from drapeline.outfits.templates import Templates
from drapeline.rule_log import progress
from drapeline.seeding import rng_for
from drapeline.storage import load_npz, read_json, save_npz, write_json

_GOLDEN = (5**0.5 - 1) / 2
_SKIRTED = {"Skirt", "Dress"}


@dataclass(frozen=True)
class StaticPlan:
    """What a static outfit is going to be; it has a body and parameters of its own.

    Attributes:
        name: "s" and five digits.
        gender: "female" or "male".
        kind: garments joined by "+".
        split: "train", "val" or "test".
        shard: the file it goes to.
    """

    name: str
    gender: str
    kind: str
    split: str
    shard: str


class StaticOutfit(NamedTuple):
    """An outfit of a shard.

    Attributes:
        name: of its plan.
        split: "train", "val" or "test".
        outfit: garments with vertices and faces; textures and pins are left out.
    """

    name: str
    split: str
    outfit: Outfit


def plan_static(
    seed: int,
    count: int,
    shard_size: int,
    shares: Mapping[str, float],
    female_share: float,
    kinds: Sequence[str],
    male_skirts: bool,
) -> dict[str, list[StaticPlan]]:
    """Plan every static outfit; types of garments come out as even as genders allow.

    Args:
        seed: the experiment's.
        count: outfits.
        shard_size: outfits per file, the last file may have fewer.
        shares: "val" and "test", shares of the outfits; the rest is for training.
        female_share: share of female bodies, met exactly up to rounding.
        kinds: outfits to choose from.
        male_skirts: whether male bodies wear skirts and dresses too.

    Returns:
        Shard name -> its plans. Kinds and genders are spread evenly over the splits.

    Raises:
        InputError: no kind is left for male bodies.
    """
    allowed = {
        "female": list(kinds),
        "male": [k for k in kinds if male_skirts or not _SKIRTED & set(k.split("+"))],
    }
    females = round(count * female_share)
    if females < count and not allowed["male"]:
        raise InputError(
            f"static.kinds is {', '.join(kinds)}, which leaves nothing for male bodies to wear;"
            " expected one without a skirt, or outfits.male_skirts: true"
        )
    rng = rng_for(seed, "static plan")
    genders = rng.permutation([GENDERS[0]] * females + [GENDERS[1]] * (count - females)).tolist()
    chosen = _even_kinds(genders, allowed)
    splits = _even_splits(rng, list(zip(chosen, genders, strict=True)), shares)
    digits = len(str((count - 1) // shard_size))
    plans: dict[str, list[StaticPlan]] = {}
    for i, (gender, kind, split) in enumerate(zip(genders, chosen, splits, strict=True)):
        shard = f"{i // shard_size:0{max(digits, 3)}d}"
        plan = StaticPlan(f"s{i + 1:05d}", gender, kind, split, shard)
        plans.setdefault(shard, []).append(plan)
    return plans


def _even_kinds(genders: Sequence[str], allowed: Mapping[str, Sequence[str]]) -> list[str]:
    """For each outfit in turn the kind whose garments are the rarest so far.

    Males choose first: what they cannot wear is then made up for by females.
    """
    worn, used = dict.fromkeys(GARMENTS, 0), dict.fromkeys(allowed["female"], 0)
    chosen = [""] * len(genders)
    for i in sorted(range(len(genders)), key=lambda i: genders[i] == GENDERS[0]):
        names = {kind: kind.split("+") for kind in allowed[genders[i]]}
        rarity = {
            kind: (sum(worn[n] for n in ns) / len(ns), used[kind]) for kind, ns in names.items()
        }
        chosen[i] = min(rarity, key=rarity.__getitem__)
        used[chosen[i]] += 1
        for name in names[chosen[i]]:
            worn[name] += 1
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


def make_static(
    plans: Sequence[StaticPlan],
    templates: Mapping[str, Templates],
    bodies: Mapping[str, BodyModel],
    *,
    seed: int,
    shape_range: float,
    edge_length_m: float,
    ranges: OutfitRanges,
) -> list[StaticOutfit]:
    """Make the outfits of a shard, 0.2 to 0.6 s each at edges of 2 cm.

    Args:
        plans: of one shard.
        templates, bodies: by gender.
        seed: the experiment's; with an outfit's name it fixes its body and its parameters.
        shape_range: shapes are uniform in plus or minus this.
        edge_length_m: mean edge length wanted.
        ranges: what outfits are drawn from.
    """
    return [
        StaticOutfit(
            plan.name,
            plan.split,
            sample_outfit(
                rng_for(seed, "static", plan.name, "outfit"),
                templates[plan.gender],
                bodies[plan.gender],
                gender=plan.gender,
                shape=sample_shape(rng_for(seed, "static", plan.name, "shape"), shape_range),
                kind=plan.kind,
                edge_length_m=edge_length_m,
                ranges=ranges,
            ),
        )
        for plan in progress(plans, total=len(plans), label="outfits")
    ]


def save_static(path: str | Path, outfits: Iterable[StaticOutfit]) -> None:
    """Write arrays to `path` under `{name}/{garment}/...`, the rest to a `.json` beside it."""
    outfits = list(outfits)
    save_npz(
        path,
        **{
            f"{name}/{g.name}/{key}": getattr(g, key)
            for name, _, outfit in outfits
            for g in outfit.garments
            for key in ("vertices", "faces")
        },
    )
    write_json(
        Path(path).with_suffix(".json"),
        [
            {
                "name": name,
                "split": split,
                "gender": outfit.gender,
                "shape": outfit.shape.tolist(),
                "tightness": outfit.tightness.tolist(),
                "signed_tightness": outfit.signed_tightness.tolist(),
                "garments": [{"name": g.name, **g.about} for g in outfit.garments],
            }
            for name, split, outfit in outfits
        ],
    )


def load_static(path: str | Path) -> list[StaticOutfit]:
    """Read what `save_static` wrote.

    Raises:
        InputError: a file is missing or lacks a garment's arrays.
    """
    told = read_json(Path(path).with_suffix(".json"))
    arrays = load_npz(
        path,
        *(
            f"{about['name']}/{g['name']}/{key}"
            for about in told
            for g in about["garments"]
            for key in ("vertices", "faces")
        ),
    )
    return [_read(about, arrays) for about in told]


def _read(about: dict, arrays: Mapping[str, np.ndarray]) -> StaticOutfit:
    garments = tuple(
        Garment(
            g["name"],
            arrays[f"{about['name']}/{g['name']}/vertices"],
            arrays[f"{about['name']}/{g['name']}/faces"],
            uv=np.zeros((0, 2), np.float32),
            uv_faces=np.zeros((0, 4), np.int32),
            pin=np.zeros(0, np.float32),
            elastic=np.zeros(0, np.float32),
            about={k: v for k, v in g.items() if k != "name"},
        )
        for g in about["garments"]
    )
    outfit = Outfit(
        garments,
        np.array(about["shape"]),
        np.array(about["tightness"]),
        np.array(about["signed_tightness"]),
        about["gender"],
    )
    return StaticOutfit(about["name"], about["split"], outfit)
