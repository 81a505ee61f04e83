"""Metrics of garments in motion, encoded and decoded."""

from collections.abc import Iterable, Mapping

from drapeline.bodies.model import BodyModel
from drapeline.learning_data.moving import MovingGarment
from drapeline.metrics.metric import Measured
from drapeline.metrics.registered import add_kl, measure_motion, measured_in_motion
from drapeline.metrics.table import join, summarise
from drapeline.models.gcvae.codec import GarmentCodec
from drapeline.models.gcvae.codes import encode_garments
from drapeline.models.gcvae.dynamic_garments import DynamicGarments
from drapeline.models.gcvae.posed_points import decode_points, resolve_points
from drapeline.registration.to_body.topology import Topology
from drapeline.rule_log import progress
from drapeline.schema import Table

RESOLVED_SUFFIX = "_settled"  # of a variant whose garments were pushed out of the body


def evaluate_dynamic(
    model: GarmentCodec,
    garments: DynamicGarments,
    held_out: Mapping[str, Iterable[MovingGarment]],
    bodies: Mapping[str, BodyModel],
    topology: Topology,
    variant: str,
) -> Table:
    """Rows of the table of metrics for a dynamic model.

    A model that resolves penetration has rows of its garments before and after that.

    Args:
        garments: every frame that is measured.
        held_out: split -> the same garments with their simulation and skinning weights.
        bodies: super-resolved, by gender.
        topology: of the super-resolved bodies.
        variant: name of the model in the table.
    """
    found = []
    for split, movings in held_out.items():
        measured: dict[str, list[Measured]] = {}
        for moving in progress(movings, label=split):
            rows = garments.data.rows_of(moving.sample, moving.name)
            body = bodies[moving.gender]
            codes = encode_garments(model, garments, rows)
            points = decode_points(model, garments, rows, moving, body, codes.mean)
            frames = garments.data.frame[rows]
            decoded = {variant: points}
            if model.resolves_penetration:
                poses = moving.poses[frames]
                resolved = resolve_points(moving, body, topology, points, poses)
                decoded[variant + RESOLVED_SUFFIX] = resolved
            for name, cloth in decoded.items():
                measures = measure_motion(moving, frames, cloth, body, topology)
                own = measured_in_motion(moving, add_kl(measures, codes.kl_nat()))
                measured.setdefault(name, []).extend(own)
        for name, own in measured.items():
            how = {"model": model.model, "variant": name, "split": split, "seed": model.seed}
            found.append(summarise(own, **how, stream=(name, split)))
    return join(found)
