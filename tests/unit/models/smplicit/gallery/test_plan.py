"""What a gallery shows, on codes of tubes whose sizes they say exactly."""

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.metrics.properties import properties_of
from drapeline.models.smplicit.gallery.plan import (
    SHEETS,
    TrainingMeasures,
    code_space,
    nearest_type,
    plan_gallery,
    training_measures,
)
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.outfits.garment_types import GARMENTS
from drapeline.seeding import rng_for
from toys.gallery import LATENT, save_toy_model, toy_outfits, training_codes

CUT = 6
CODES = training_codes()
# One property follows a number of z_cut, one follows z_style, and the last one neither.
VALUES = {
    "leg": 0.55 + 0.2 * CODES.z[:, 0].astype(float),
    "waist": 0.2 + 0.1 * CODES.z[:, 9].astype(float),
    "width": rng_for(3, "noise").normal(size=len(CODES.z)),
}


def measures(values):
    return TrainingMeasures(values, np.full(len(next(iter(values.values()))), 2))


@pytest.fixture(scope="module")
def space():
    return code_space("skirt", CODES, measures(VALUES), CUT)


@pytest.fixture(scope="module")
def planned(space, toy_body):
    return plan_gallery(CODES, space, dict.fromkeys(GENDERS, toy_body), seed=1, count=3)


def of_sheet(planned, sheet):
    return [item for item in planned if item.sheet == sheet]


def test_axes_point_to_where_their_property_increases(space):
    strongest = np.abs(space.correlation).argmax(axis=1)
    assert (space.correlation[np.arange(CUT), strongest] > 0).all()
    assert space.correlation[0, 0] > 0.99
    scores = space.cut.scores(CODES.z)
    assert np.corrcoef(scores[:, 0], VALUES["leg"])[0, 1] == pytest.approx(space.correlation[0, 0])


def test_only_what_codes_tell_of_is_edited(space):
    assert space.explained[:2] == pytest.approx([1, 1])
    assert space.explained[2] < 0.5
    assert space.edits.names == ("leg", "waist")


def test_prototypes_are_means_of_their_kinds(space):
    short = CODES.z[VALUES["leg"] <= 0.5]
    assert space.prototypes["short skirt"] == pytest.approx(short.mean(axis=0), abs=1e-6)
    assert list(space.prototypes) == ["short skirt", "long skirt"]


def test_every_sheet_is_filled(planned):
    assert list(dict.fromkeys(item.sheet for item in planned)) == list(SHEETS)
    for sheet in SHEETS:
        rows = {}
        for item in of_sheet(planned, sheet):
            rows.setdefault(item.row, []).append(item.column)
        assert len(set(map(tuple, rows.values()))) == 1  # all rows have the same columns


def test_samples_follow_seed_and_distribution(space, planned, toy_body):
    bodies = dict.fromkeys(GENDERS, toy_body)
    again = plan_gallery(CODES, space, bodies, seed=1, count=3)
    other = plan_gallery(CODES, space, bodies, seed=2, count=3)
    z = [np.stack([item.z for item in of_sheet(plan, "samples")]) for plan in (again, other)]
    first = np.stack([item.z for item in of_sheet(planned, "samples")])
    assert np.array_equal(first, z[0])
    assert not np.allclose(first, z[1])
    assert first.shape == (9, LATENT)


def test_more_samples_keep_the_first_ones(space, planned, toy_body):
    more = plan_gallery(CODES, space, dict.fromkeys(GENDERS, toy_body), seed=1, count=5)
    for row in dict.fromkeys(item.row for item in of_sheet(planned, "samples")):
        few, many = (
            [item.z for item in of_sheet(plan, "samples") if item.row == row]
            for plan in (planned, more)
        )
        assert np.array_equal(few, many[:3])


def test_types_are_sampled_from_codes_of_their_own(toy_body):
    types = np.where(np.arange(len(CODES.z)) % 2, *map(GARMENTS.index, ("Dress", "Jumpsuit")))
    codes = replace_codes(garment=types)
    codes.z[types == GARMENTS.index("Dress"), 0] += 50
    values = {name: np.full(len(types), 0.5) for name in properties_of("whole")}
    space = code_space("whole", codes, measures(values), CUT)
    shown = of_sheet(
        plan_gallery(codes, space, dict.fromkeys(GENDERS, toy_body), seed=0, count=9), "samples"
    )
    own = [item.z[0] for item in shown if item.row.startswith("between")]
    assert all(value < 10 or value > 40 for value in own)
    assert min(own) < 10 < 40 < max(own)
    assert len(shown) == 27


def replace_codes(**changes):
    return CODES._replace(z=CODES.z.copy(), **changes)


def test_transitions_start_and_end_at_prototypes(space, planned):
    row = of_sheet(planned, "transitions")
    assert row[0].z == pytest.approx(space.prototypes["short skirt"])
    assert row[-1].z == pytest.approx(space.prototypes["long skirt"])
    assert [item.column for item in row] == ["0%", "25%", "50%", "75%", "100%"]


def test_axes_stay_among_training_garments_and_keep_the_style(space, planned):
    scores = space.cut.scores(CODES.z)
    shown = of_sheet(planned, "axes")
    for item in shown:
        axis = int(item.row.split()[1]) - 1
        found = space.cut.scores(item.z)
        assert found[axis] == pytest.approx(item.score)
        assert np.delete(found, axis) == pytest.approx(np.zeros(CUT - 1), abs=1e-6)
        assert scores[:, axis].min() - 1e-6 <= item.score <= scores[:, axis].max() + 1e-6
        assert abs(item.score) <= 2
        assert item.z[CUT:] == pytest.approx(CODES.z[:, CUT:].mean(axis=0), abs=1e-6)
    assert len({item.row for item in shown}) == 2


def test_bodies_differ_and_the_code_does_not(planned, toy_body):
    shown = of_sheet(planned, "bodies")
    assert len(shown) == 10
    for row in ("short skirt", "long skirt"):
        items = [item for item in shown if item.row == row]
        assert len({item.z.tobytes() for item in items}) == 1
        assert len({(item.gender, tuple(item.shape)) for item in items}) == 5
        for item in items:
            height = np.ptp(rest_body(toy_body, np.array(item.shape))[:, 2])
            assert item.column == f"{item.gender}, {height:.2f} m"


def test_edits_ask_for_usual_values_and_their_regression_gives_them(space, planned):
    shown = of_sheet(planned, "edits")
    start = space.edits.predict(CODES.z.mean(axis=0))
    for index, name in enumerate(space.edits.names):
        items = [item for item in shown if item.about == name]
        asked = [item.asked for item in items]
        assert asked[0] == pytest.approx(np.quantile(VALUES[name], 0.05))
        assert asked[-1] == pytest.approx(np.quantile(VALUES[name], 0.95))
        found = np.stack([space.edits.predict(item.z) for item in items])
        assert found[:, index] == pytest.approx(asked)
        kept = np.delete(found, index, axis=1)
        expected = np.tile(np.delete(start, index), (len(items), 1))
        assert kept == pytest.approx(expected, abs=1e-6)


def test_codes_that_tell_nothing_still_have_a_gallery(toy_body):
    few = CODES._replace(**{key: value[:5] for key, value in CODES._asdict().items()})
    values = {name: np.full(5, 0.55) for name in VALUES}
    space = code_space("skirt", few, measures(values), CUT)
    assert space.edits is None
    assert list(space.prototypes) == ["mean garment"]
    shown = plan_gallery(few, space, dict.fromkeys(GENDERS, toy_body), seed=0, count=1)
    assert {item.sheet for item in shown} == set(SHEETS) - {"edits", "transitions"}


def test_the_nearest_training_garment_gives_the_type():
    types = np.where(np.arange(len(CODES.z)) == 7, GARMENTS.index("Dress"), 3)
    codes = replace_codes(garment=types)
    assert nearest_type(codes.z[7] + 1e-4, codes) == "Dress"
    assert nearest_type(codes.z[8], codes) == "Skirt"


def test_properties_are_measured_on_the_training_garments(tmp_path, toy_body):
    few = CODES._replace(**{key: value[:4] for key, value in CODES._asdict().items()})
    save_toy_model(tmp_path / "skirt", toy_body, few)
    model = SmplicitModel(tmp_path / "skirt")
    found, openings = training_measures(model, toy_outfits(CODES))
    assert list(found) == list(properties_of("lower"))
    assert openings.tolist() == [2] * 4
    slope = np.diff(found["leg"]) / np.diff(few.z[:, 0])
    assert slope == pytest.approx(np.full(3, slope[0]), rel=1e-3)
    with pytest.raises(InputError, match=r"was trained on s00003/Skirt"):
        training_measures(model, toy_outfits(CODES)[:3])


def test_a_type_has_the_openings_that_most_of_it_have():
    openings = np.full(len(CODES.z), 2)
    openings[:3] = [-1, 3, 5]
    space = code_space("skirt", CODES, TrainingMeasures(VALUES, openings), CUT)
    assert space.openings == {"Skirt": 2}
