"""Static outfits: outfits in rest pose, many to a file, made for learning and never simulated."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.sampling import sample_shape
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static_plan import StaticPlan
from drapeline.outfits.templates import Templates
from drapeline.rule_log import progress
from drapeline.seeding import rng_for
from drapeline.storage import load_npz, read_json, save_npz, write_json


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
                outfit_type=plan.outfit_type,
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
