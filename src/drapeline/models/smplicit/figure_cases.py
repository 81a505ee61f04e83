"""What the figure of rebuilt garments shows."""

from collections.abc import Mapping

import numpy as np

from drapeline.bodies.rest_body import rest_body
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.garment_fields import FieldData
from drapeline.metrics.predictions import RebuiltGarment
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.settings import Meshing
from drapeline.outfits.garment_types import GARMENTS, first_of_each


def rebuilt_garments(
    model: SmplicitModel,
    data: FieldData,
    meshes: Mapping[int, Mesh],
    held_out: Mapping[tuple[str, str], tuple[np.ndarray, Mesh]],
    meshing: Meshing,
) -> list[RebuiltGarment]:
    """The first held-out garment of each of a model's types.

    Args:
        model: trained.
        data: of its garments.
        meshes: row -> garment as it was made.
        held_out: as `held_out.load_held_out` reads them.
        meshing: how surfaces are extracted.
    """
    rows = {(str(data.outfit[row]), GARMENTS[data.garment[row]]): row for row in range(len(data))}
    return [
        _rebuilt(model, data, rows[key], meshes, *held_out[key], meshing)
        for key in first_of_each((key[1], key) for key in held_out)
    ]


def _rebuilt(
    model: SmplicitModel,
    data: FieldData,
    row: int,
    meshes: Mapping[int, Mesh],
    z: np.ndarray,
    sheet: Mesh,
    meshing: Meshing,
) -> RebuiltGarment:
    garment, gender = GARMENTS[data.garment[row]], GENDERS[data.gender[row]]
    wearer = {"gender": gender, "shape": data.shape[row]}
    body = model.bodies[gender]
    return RebuiltGarment(
        f"{garment}\n{gender}",
        garment,
        meshes[row],
        sheet,
        model.decode(z, **wearer, meshing=meshing).walls,
        model.decode(model.mean_code, **wearer, meshing=meshing).sheet,
        Mesh(rest_body(body, data.shape[row]), body.faces),
    )
