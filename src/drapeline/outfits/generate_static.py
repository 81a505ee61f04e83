"""Make static outfits from their plans."""

from collections.abc import Mapping, Sequence

from drapeline.bodies.model import BodyModel
from drapeline.bodies.sampling import sample_shape
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.static import StaticOutfit
from drapeline.outfits.static_plan import StaticPlan
from drapeline.outfits.templates import Templates
from drapeline.rule_log import progress
from drapeline.seeding import rng_for


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
