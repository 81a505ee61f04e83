import numpy as np

from drapeline.models.smplicit.garments import FIELD_MODELS, MODEL_OF_GARMENT
from drapeline.outfits.garment_types import GARMENT_TYPES, GARMENTS


def test_every_garment_type_has_one_model():
    learned = [garment for model in FIELD_MODELS.values() for garment in model.garments]
    assert sorted(learned) == sorted(GARMENTS)
    assert {MODEL_OF_GARMENT[name] for name in GARMENTS} == set(FIELD_MODELS)


def test_garments_of_a_model_cover_the_same_region():
    for model in FIELD_MODELS.values():
        assert len({GARMENT_TYPES[name].region for name in model.garments}) == 1


def test_boxes_are_boxes():
    for model in FIELD_MODELS.values():
        low, high = model.box
        assert all(a < b for a, b in zip(low, high, strict=True))


def test_only_the_largest_box_takes_more_points():
    sizes = {name: np.ptp(model.box, axis=0).prod() for name, model in FIELD_MODELS.items()}
    shares = {name: model.space_share for name, model in FIELD_MODELS.items()}
    largest = max(sizes, key=sizes.get)
    assert {name for name, share in shares.items() if share > 1} == {largest}
