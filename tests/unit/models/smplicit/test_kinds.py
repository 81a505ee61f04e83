"""Kinds of garments that SMPLicit's gallery shows."""

import numpy as np

from drapeline.metrics.properties import PROPERTIES, properties_of
from drapeline.models.smplicit.garments import FIELD_MODELS, KINDS, kind_members, region_of
from drapeline.outfits.garment_types import GARMENTS


def test_every_model_has_properties_and_kinds_of_its_own_garments():
    for name, model in FIELD_MODELS.items():
        assert set(properties_of(region_of(name))) <= set(PROPERTIES)
        for kind in KINDS[name].values():
            assert kind.garment in model.garments
            assert set(kind.bounds) <= set(properties_of(region_of(name)))


def test_kinds_are_told_by_type_and_length():
    types = np.array(
        [GARMENTS.index(name) for name in ("Tshirt", "Tshirt", "Top", "Tshirt", "Jacket")]
    )
    values = {
        "sleeve": np.array([0.3, 0.9, 0.05, 0.55, 0.9]),
        "hem": np.array([0.7, 1.1, 0.8, 0.9, 1.2]),
        "neckline": np.array([0.1, np.nan, 0.1, 0.1, 0.1]),
        "width": np.full(5, 0.03),
    }
    members = kind_members("upper", types, values)
    assert {name: np.flatnonzero(chosen).tolist() for name, chosen in members.items()} == {
        "t-shirt": [0],
        "long-sleeved shirt": [1],
        "long shirt": [1],
        "top": [2],
        "jacket": [4],
    }
