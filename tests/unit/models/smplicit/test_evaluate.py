from types import SimpleNamespace

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, loop_count
from drapeline.models import contract
from drapeline.models.smplicit import evaluate
from drapeline.models.smplicit.evaluate import (
    FieldEvaluation,
    constant_errors,
    field_errors,
    fit_held_out,
    some_points,
    surface_measures,
    transfer_to_body,
    true_meshes,
)
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.network import new_field
from drapeline.models.smplicit.settings import FieldFitSettings, Meshing
from drapeline.models.smplicit.surface.sheet import FieldGarment
from toys.smplicit import toy_bodies, toy_outfits, toy_settings, tube
from toys.smplicit_trainings import train_toy

BODY = tube(0.2, -1.0, 0.5)


def test_measures_of_a_wider_tube():
    true, wider = tube(0.3, -0.5, 0.0, around=96), tube(0.31, -0.5, 0.0, around=96)
    measured = surface_measures(wider, true, BODY)
    assert measured["surface_to_true_mm"] == pytest.approx(10, abs=0.2)
    assert measured["true_to_surface_mm"] == pytest.approx(10, abs=0.2)
    assert measured["normal_error_deg"] == pytest.approx(0, abs=2)
    assert measured["openings_right"] == 1
    assert measured["pieces"] == 1
    assert measured["inside_share"] == 0


def test_a_surface_that_is_too_long_is_far_in_one_direction_alone():
    true, longer = tube(0.3, -0.5, 0.0), tube(0.3, -0.7, 0.0)
    measured = surface_measures(longer, true, BODY)
    assert measured["surface_to_true_mm"] > 20
    assert measured["true_to_surface_mm"] == pytest.approx(0, abs=0.5)


def test_a_closed_end_is_a_wrong_opening():
    true = tube(0.3, -0.5, 0.0)
    last = len(true.vertices)
    ring = np.arange(32)
    cap = np.c_[np.roll(ring, -1), ring, np.full(32, last)]
    middle = np.array([[0, 0, -0.5]], np.float32)
    closed = Mesh(np.concatenate([true.vertices, middle]), np.concatenate([true.faces, cap]))
    assert loop_count(true.faces) == 2
    assert loop_count(closed.faces) == 1
    assert surface_measures(closed, true, BODY)["openings_right"] == 0


def test_surfaces_turned_inside_out_have_wrong_normals():
    true = tube(0.3, -0.5, 0.0)
    measured = surface_measures(Mesh(true.vertices, true.faces[:, ::-1]), true, BODY)
    assert measured["normal_error_deg"] > 170


def test_nothing_left_has_no_distances():
    none = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    measured = surface_measures(none, tube(0.3, -0.5, 0.0), BODY)
    assert np.isnan(measured["surface_to_true_mm"])
    assert measured["openings_right"] == 0
    assert measured["pieces"] == 0


def test_where_surfaces_touch_in_a_vertex_there_are_no_loops_to_count():
    bow = np.array([[0, 1, 2], [0, 3, 4]])
    assert loop_count(bow) == -1


def test_a_garment_is_carried_as_the_body_moves(toy_body):
    body = rest_body(toy_body, np.zeros(10))
    garment = tube(0.3, -0.5, 0.0)
    moved = transfer_to_body(garment, body, body + [0.1, -0.2, 0.3])
    np.testing.assert_allclose(moved.vertices, garment.vertices + [0.1, -0.2, 0.3], atol=1e-6)
    np.testing.assert_allclose(
        transfer_to_body(garment, body, body).vertices, garment.vertices, atol=1e-9
    )


def test_meshes_are_found_by_outfit_and_type(fields):
    meshes = true_meshes(fields, toy_outfits())
    assert sorted(meshes) == list(range(8))
    np.testing.assert_array_equal(meshes[3].vertices, toy_outfits()[3].outfit.garments[0].vertices)


def test_the_constant_is_the_median_of_the_training_points(fields):
    (measured,) = constant_errors(fields, np.array([6]), 0.03)
    known = np.minimum(fields.near_distance[:4], 0.03)
    asked = np.minimum(fields.near_distance[6, 32:], 0.03)
    expected = 1000 * np.abs(np.median(known) - asked).mean()
    assert measured["field_near_mm"] == pytest.approx(expected, rel=1e-5)


@pytest.fixture(scope="module")
def model(tmp_path_factory, fields, toy_body):
    return SmplicitModel(train_toy(tmp_path_factory.mktemp("model"), fields, toy_body))


FIT = FieldFitSettings(steps=3, near=16, space=16)


def test_codes_are_fitted_to_the_first_half_of_the_points(model, fields, monkeypatch):
    rows = fields.rows("test")
    z = fit_held_out(model.network, fields, rows, FieldFitSettings(steps=3, near=32, space=32))
    assert z.shape == (2, 5)
    for name in ("near", "space"):
        changed = np.array(getattr(fields, f"{name}_distance"))
        changed[:, 32:] = 0
        monkeypatch.setattr(fields, f"{name}_distance", changed)
    np.testing.assert_array_equal(
        fit_held_out(model.network, fields, rows, FieldFitSettings(steps=3)), z
    )
    changed[:, :32] = 0
    assert not np.allclose(fit_held_out(model.network, fields, rows, FieldFitSettings(steps=3)), z)


def test_a_larger_weight_of_codes_gives_smaller_ones(model, fields):
    rows = fields.rows("test")
    sizes = [
        np.abs(
            fit_held_out(model.network, fields, rows, FieldFitSettings(steps=10, latent=latent))
        ).mean()
        for latent in (0.0, 100.0)
    ]
    assert sizes[1] < sizes[0]


def test_points_of_a_batch(model, fields):
    batch = fields.batch(fields.rows("test"))
    points = some_points(model.network, batch, slice(4), slice(8))
    assert points.places.shape == (2, 12, 3)
    np.testing.assert_array_equal(points.places[:, :4], batch["near"][:, :4])
    np.testing.assert_array_equal(points.places[:, 4:], batch["space"][:, :8])
    assert points.distance.max() == 1


@pytest.mark.parametrize("at_once", [1, 2, 3])
def test_garments_are_fitted_each_by_itself(model, fields, monkeypatch, at_once):
    rows = np.arange(5)
    each = [fit_held_out(model.network, fields, rows[k : k + 1], FIT) for k in range(5)]
    monkeypatch.setattr(evaluate, "_FITTED_AT_ONCE", at_once)
    together = fit_held_out(model.network, fields, rows, FIT)
    np.testing.assert_allclose(together, np.concatenate(each), atol=1e-3)


def test_errors_are_measured_at_the_other_half_of_the_points(model, fields):
    rows = fields.rows("test")
    (first, _) = field_errors(model.network, fields, rows, np.zeros((2, 5)))
    field = model.field(np.zeros(5), gender="female", shape=fields.shape[6])
    predicted = np.clip(field.distances(fields.near[6, 32:]), 0, 0.03)
    expected = 1000 * np.abs(predicted - np.minimum(fields.near_distance[6, 32:], 0.03)).mean()
    assert first["field_near_mm"] == pytest.approx(expected, rel=1e-4)


def test_all_rows_of_a_split(model, fields, toy_body):
    evaluation = FieldEvaluation(
        model,
        fields,
        true_meshes(fields, toy_outfits()),
        meshing=Meshing(cell_m=0.04, threshold_m=0.028),
        fit=FIT,
        seed=0,
    )
    untrained = new_field("skirt", fields, toy_bodies(toy_body), toy_settings()).eval()
    rows, held_out = evaluation.run("test", untrained)
    assert set(rows.variant.str.removeprefix("smplicit_skirt_")) == {
        *("fitted", "mean_code", "nearest_cut", "nearest_style", "untrained", "constant")
    }
    assert set(rows.split) == {"test"}
    assert held_out.outfit.tolist() == ["s6", "s7"]
    assert held_out.z.shape == (2, 5)
    # Both lengths and widths of skirts are in the training data too.
    assert np.isfinite(rows.value[rows.variant == "smplicit_skirt_nearest_cut"]).all()


def test_the_cost_is_that_of_fitting_and_decoding_and_not_of_measures(
    model, fields, toy_body, monkeypatch
):
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(contract, "process_time", lambda: clock.now)

    def slowly(name, seconds, function):
        def slow(*given):
            clock.now += seconds
            return function(*given)

        monkeypatch.setattr(evaluate, name, slow)

    sheet = tube(0.3, -0.5, 0.0)
    slowly("fit_held_out", 6, lambda *given: np.zeros((2, 5), np.float32))
    slowly("garment_of_field", 2, lambda *given: FieldGarment(sheet, sheet))
    for name in ("surface_measures", "area_distances_mm", "field_errors"):
        slowly(name, 100, getattr(evaluate, name))
    truth = true_meshes(fields, toy_outfits())
    evaluation = FieldEvaluation(model, fields, truth, meshing=Meshing(), fit=FIT, seed=0)
    evaluation.run("test", model.network)
    assert evaluation.cost[:4] == ("representation", "skirt", (6 + 2 * 2) / 2, 2)


def test_an_empty_split_is_refused(model, fields, toy_body, monkeypatch):
    monkeypatch.setattr(fields, "split", np.array(["train"] * 8))
    evaluation = FieldEvaluation(model, fields, {}, meshing=Meshing(), fit=FIT, seed=0)
    with pytest.raises(InputError, match="the test split holds no Skirt, expected one or more"):
        evaluation.run("test", model.network)
