"""The body template of garments in motion."""

from collections.abc import Mapping

import numpy as np
import torch

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_basis
from drapeline.learning_data.vertex_moments import body_statistics, offset_statistics
from drapeline.models.gcvae.body_template import BodyTemplate, rest_bodies
from drapeline.models.gcvae.conditioning import cvar_statistics
from drapeline.models.gcvae.dynamic_garments import DynamicGarments
from drapeline.registration.to_body.hierarchy import Hierarchy
from drapeline.registration.to_body.topology import Topology


def dynamic_body_template(
    garments: DynamicGarments,
    topology: Topology,
    hierarchy: Hierarchy,
    bodies: Mapping[str, BodyModel],
) -> BodyTemplate:
    """Statistics of the training frames, and of the rest bodies of their samples.

    Args:
        garments: frames with their conditions.
        topology, hierarchy: of the super-resolved bodies.
        bodies: super-resolved, by gender.
    """
    data, rows = garments.data, garments.rows("train")
    cvar_mean, cvar_std = cvar_statistics(garments.cvar(rows))
    offset_mean, offset_std = offset_statistics(
        (data.offsets[row], data.mask[data.garment_index[row]]) for row in rows
    )
    base_mean, base_std = body_statistics(data.base[row] for row in rows)
    basis = rest_basis(bodies)
    static_cvar = torch.from_numpy(data.cvar(np.unique(data.garment_index[rows])))
    rest = rest_bodies(torch.from_numpy(basis), static_cvar).permute(2, 0, 1).numpy()
    body_mean, body_std = body_statistics(rest)
    return BodyTemplate(
        edges=hierarchy.edges,
        parents=hierarchy.parents,
        faces={"body": topology.faces, "skirt": topology.skirt_faces},
        offset_mean=offset_mean,
        offset_std=offset_std,
        base_mean=base_mean,
        base_std=base_std,
        body_mean=body_mean,
        body_std=body_std,
        body_basis=basis,
        cvar_mean=cvar_mean,
        cvar_std=cvar_std,
    )
