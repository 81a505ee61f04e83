"""The domain of networks that are trained on registered garments."""

from collections.abc import Mapping

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.nets.domain import Domain, rest_basis
from drapeline.nets.dynamic_data import DynamicGarments, masked_statistics, moments
from drapeline.nets.gcvae_data import cvar_statistics
from drapeline.registration.hierarchy import Hierarchy
from drapeline.registration.static_data import BODY_STD_FLOOR_M, STD_FLOOR_M, StaticData
from drapeline.registration.topology import Topology


def static_domain(
    data: StaticData,
    topology: Topology,
    hierarchy: Hierarchy,
    bodies: Mapping[str, BodyModel],
) -> Domain:
    """Statistics of the static training rows; offsets are added to the rest body."""
    cvar_mean, cvar_std = cvar_statistics(data.cvar(data.rows("train")))
    return Domain(
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


def dynamic_domain(
    garments: DynamicGarments,
    topology: Topology,
    hierarchy: Hierarchy,
    bodies: Mapping[str, BodyModel],
) -> Domain:
    """Statistics of the training frames; the rest body's are those of the samples' wearers."""
    data, rows = garments.data, garments.rows("train")
    cvar_mean, cvar_std = cvar_statistics(garments.cvar(rows))
    offset_mean, offset_std = masked_statistics(data, rows, STD_FLOOR_M)
    base_mean, base_std = moments(data.base[rows], BODY_STD_FLOOR_M)
    basis = rest_basis(bodies)
    wearers = np.unique(data.wearer[rows])
    cvar = data.static_cvar()[wearers]
    male = cvar[:, 10:11]
    one = np.concatenate([np.ones_like(male), cvar[:, :10]], 1)
    factors = np.concatenate([one * (1 - male), one * male], 1)
    body_mean, body_std = moments(np.einsum("gk,kvc->gvc", factors, basis), BODY_STD_FLOOR_M)
    return Domain(
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
