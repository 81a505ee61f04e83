"""Garments at rest as evaluation and figures take them, with the bodies of a model's template."""

from typing import Protocol

import numpy as np

from drapeline.metrics.registered import StaticRows, Truth
from drapeline.models.gcvae.body_template import BodyTemplate
from drapeline.models.gcvae.codec import Garments
from drapeline.registration.to_body.topology import TOPOLOGIES


class StaticGarments(Garments, StaticRows, Protocol):
    """Registered garments in rest pose: what encoding reads and what evaluation reads."""


def static_truth(template: BodyTemplate, garments: StaticGarments) -> Truth:
    """The dataset as evaluation takes it, with the bodies and faces of a model's template."""
    return Truth(
        garments.offsets,
        garments.mask,
        body=lambda row: template.rest_body(garments.cvar(np.array([row]))[0]),
        faces=lambda row: template.faces[TOPOLOGIES[int(garments.topology(np.array([row]))[0])]],
        body_faces=template.faces[TOPOLOGIES[0]],
    )
