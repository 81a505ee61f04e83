"""The body template of garments at rest."""

from collections.abc import Mapping

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_basis
from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.body_template import BodyTemplate
from drapeline.models.gcvae.conditioning import cvar_statistics
from drapeline.registration.to_body.hierarchy import Hierarchy
from drapeline.registration.to_body.topology import Topology


def static_body_template(
    data: StaticData,
    topology: Topology,
    hierarchy: Hierarchy,
    bodies: Mapping[str, BodyModel],
) -> BodyTemplate:
    """Statistics of the training rows; offsets are added to the rest body.

    Args:
        data: registered garments in rest pose.
        topology, hierarchy: of the super-resolved bodies.
        bodies: super-resolved, by gender.
    """
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
