"""Body templates for networks trained on registered garments: statistics of their data."""

from collections.abc import Mapping

import numpy as np
import torch

from drapeline.bodies.model import BodyModel
from drapeline.learning_data.static import StaticData
from drapeline.learning_data.vertex_moments import body_statistics, offset_statistics
from drapeline.models.gcvae.body_template import BodyTemplate, rest_basis, rest_bodies
from drapeline.models.gcvae.dynamic_garments import DynamicGarments
from drapeline.models.training.batches import cvar_statistics
from drapeline.registration.to_body.hierarchy import Hierarchy
from drapeline.registration.to_body.topology import Topology


def static_body_template(
    data: StaticData,
    topology: Topology,
    hierarchy: Hierarchy,
    bodies: Mapping[str, BodyModel],
) -> BodyTemplate:
    """Statistics of the static training rows; offsets are added to the rest body."""
    cvar_mean, cvar_std = cvar_statistics(data.cvar(data.rows("train")))
    return BodyTemplate(
        edges=hierarchy.edges,
        parents=hierarchy.parents,
        faces={"body": topology.faces, "skirt": topology.skirt_faces},
        offset_mean=data.mean,
        offset_std=data.std,
        base_mean=data.body_mean,
        base_std=data.body_std,
        body_mean=data.body_mean,
        body_std=data.body_std,
        body_basis=rest_basis(bodies),
        cvar_mean=cvar_mean,
        cvar_std=cvar_std,
    )


def dynamic_body_template(
    garments: DynamicGarments,
    topology: Topology,
    hierarchy: Hierarchy,
    bodies: Mapping[str, BodyModel],
) -> BodyTemplate:
    """Statistics of the training frames; the rest body's are those of the samples' wearers."""
    data, rows = garments.data, garments.rows("train")
    cvar_mean, cvar_std = cvar_statistics(garments.cvar(rows))
    offset_mean, offset_std = offset_statistics(
        (data.offsets[row], data.mask[data.wearer[row]]) for row in rows
    )
    base_mean, base_std = body_statistics(data.base[row] for row in rows)
    basis = rest_basis(bodies)
    worn = torch.from_numpy(data.cvar(np.unique(data.wearer[rows])))
    rest = rest_bodies(torch.from_numpy(basis), worn).permute(2, 0, 1).numpy()
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
