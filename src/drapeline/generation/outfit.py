"""A unique outfit for a body (CLOTH3D 3.2)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import sample_shape
from drapeline.bodies.sequence import BodySequence
from drapeline.experiment.sample_plan import SamplePlan
from drapeline.generation.settings import BodySettings, OutfitSettings
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.outfit import Outfit
from drapeline.outfits.settings import OwnGarment
from drapeline.outfits.templates import Templates
from drapeline.seeding import rng_for


@dataclass(frozen=True)
class Wearer:
    """Body, templates and own garments that samples of one gender are made from."""

    body: BodyModel
    templates: Templates  # panels that garments are cut from
    own: Mapping[str, OwnGarment]  # garment type -> the user's garment in its place


def dress(
    plan: SamplePlan, motion: BodySequence, wearer: Wearer, settings: OutfitSettings, seed: int
) -> Outfit:
    """A unique outfit of the planned type, for the body that moves.

    Args:
        motion: the wearer's shape is taken.
    """
    return _sample(rng_for(seed, "outfit", plan.sample), plan, motion.shape, wearer, settings)


def dress_at_rest(
    plan: SamplePlan, bodies: BodySettings, wearer: Wearer, settings: OutfitSettings, seed: int
) -> Outfit:
    """A unique outfit of the planned type, for a body of its own that does not move.

    Args:
        bodies: which shapes there are.
        seed: the experiment's; with the sample's id it fixes its body and its outfit.
    """
    shapes = rng_for(seed, "static", plan.sample, "shape")
    shape = sample_shape(shapes, wearer.body, bodies.shape_range, bodies.bmi_range)
    rng = rng_for(seed, "static", plan.sample, "outfit")
    return _sample(rng, plan, shape, wearer, settings)


def _sample(
    rng: np.random.Generator,
    plan: SamplePlan,
    shape: np.ndarray,
    wearer: Wearer,
    settings: OutfitSettings,
) -> Outfit:
    return sample_outfit(
        rng,
        wearer.templates,
        wearer.body,
        gender=plan.gender,
        shape=shape,
        outfit_type=plan.outfit_type,
        edge_length_m=settings.edge_length_m,
        vertices_min=settings.vertices_min,
        ranges=OutfitRanges(
            tightness=settings.tightness_range,
            elastic_chance=settings.elastic_probability,
            fits=settings.fits,
        ),
        fabrics=settings.fabrics,
        own=wearer.own,
    )
