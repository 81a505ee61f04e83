"""Samples, axes, prototypes and edits of codes, on codes whose truth is known."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.models.smplicit.latent import (
    PropertyEdits,
    correlations,
    draw_between,
    explained_share,
    group_means,
    interpolate,
    principal_gaussian,
    single_gaussian,
)
from drapeline.seeding import rng_for

RNG = rng_for(0, "codes")
MIX = RNG.normal(size=(7, 7))
CODES = RNG.normal(size=(60, 7)) @ MIX + RNG.normal(size=7)
SLOPES = RNG.normal(size=(3, 7))
PROPERTIES = dict(zip("abc", 100 + SLOPES @ CODES.T, strict=True))


def test_a_single_gaussian_has_one_mean_and_one_deviation_for_all_numbers():
    gaussian = single_gaussian(CODES)
    assert gaussian.mean == pytest.approx(np.full(7, CODES.mean()))
    assert gaussian.covariance == pytest.approx(CODES.var(ddof=1) * np.eye(7))


def test_the_principal_gaussian_has_the_codes_own_moments():
    gaussian = principal_gaussian(CODES)
    assert gaussian.mean == pytest.approx(CODES.mean(axis=0))
    assert gaussian.covariance == pytest.approx(np.cov(CODES.T))
    assert np.all(np.diff(gaussian.deviations) < 0)
    assert gaussian.directions @ gaussian.directions.T == pytest.approx(np.eye(7), abs=1e-12)


@pytest.mark.parametrize("gaussian", [single_gaussian(CODES), principal_gaussian(CODES)])
def test_draws_have_the_moments_of_their_distribution(gaussian):
    count = 40_000
    drawn = gaussian.draw(rng_for(0, "draws"), count)
    widest = np.sqrt(np.diag(gaussian.covariance)).max()
    # Six deviations of an estimate from so many draws.
    assert np.abs(drawn.mean(axis=0) - gaussian.mean).max() < 6 * widest / np.sqrt(count)
    allowed = 6 * np.sqrt(2 / count) * widest**2
    assert np.abs(np.cov(drawn.T) - gaussian.covariance).max() < allowed


def test_the_seed_decides_what_is_drawn():
    gaussian = principal_gaussian(CODES)
    first, again, other = (gaussian.draw(rng_for(seed, "draws"), 4) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)


def test_new_codes_lie_between_one_of_their_kind_and_a_close_one():
    kinds = np.repeat([0, 1], [40, 20])
    for z in draw_between(CODES, kinds, rng_for(3, "draws"), 200):
        least = np.inf
        for kind in (0, 1):
            codes = CODES[kinds == kind]
            away = np.linalg.norm(codes[:, None] - codes[None], axis=2)
            for first, row in enumerate(away):
                for second in np.argsort(row)[1:6]:
                    over = np.linalg.norm(z - codes[first]) + np.linalg.norm(z - codes[second])
                    least = min(least, over - row[second])
        assert least < 1e-9


def test_more_draws_keep_the_first_and_a_garment_without_others_of_its_kind_stays():
    kinds = np.array([7, *[3] * 59])
    few, many = (draw_between(CODES, kinds, rng_for(0, "draws"), n) for n in (20, 400))
    assert np.array_equal(few, many[:20])
    alone = np.abs(many - CODES[0]).max(axis=1).min()
    assert alone == 0


def test_axes_of_the_first_numbers_leave_the_others_at_their_mean():
    gaussian = principal_gaussian(CODES, 3)
    assert len(gaussian.deviations) == 3
    walked = gaussian.walk(1, [-2, 0, 2])
    assert np.array_equal(walked[:, 3:], np.tile(CODES.mean(axis=0)[3:], (3, 1)))
    assert walked[1] == pytest.approx(gaussian.mean)
    assert np.cov(CODES[:, :3].T) == pytest.approx(gaussian.covariance[:3, :3])


def test_scores_are_what_a_walk_went_by():
    gaussian = principal_gaussian(CODES, 4)
    expected = np.zeros((3, 4))
    expected[:, 2] = [-1.5, 0, 0.5]
    assert gaussian.scores(gaussian.walk(2, [-1.5, 0, 0.5])) == pytest.approx(expected)
    everything = principal_gaussian(CODES)
    assert everything.codes(everything.scores(CODES)) == pytest.approx(CODES)


def test_axes_do_not_depend_on_the_order_of_garments():
    shuffled = principal_gaussian(CODES[RNG.permutation(len(CODES))])
    assert shuffled.directions == pytest.approx(principal_gaussian(CODES).directions)


def test_codes_that_do_not_vary_have_no_axes_and_one_draw():
    gaussian = principal_gaussian(np.ones((5, 3)))
    assert len(gaussian.deviations) == 0
    assert np.array_equal(gaussian.draw(rng_for(0), 2), np.ones((2, 3)))
    assert single_gaussian(np.ones((5, 3))).scores(np.ones((2, 3))).tolist() == [[0, 0, 0]] * 2


def test_interpolation_has_even_steps_and_both_ends():
    path = interpolate(CODES[0], CODES[1], 5)
    assert np.array_equal(path[[0, -1]], CODES[:2])
    assert np.diff(path, axis=0) == pytest.approx(np.tile((CODES[1] - CODES[0]) / 4, (4, 1)))


def test_a_planted_linear_property_correlates_with_its_axis_alone():
    scores = principal_gaussian(CODES).scores(CODES)
    values = np.stack([5 + 2 * scores[:, 1], -scores[:, 3], np.ones(len(CODES))], axis=1)
    found = correlations(scores, values)
    expected = np.zeros((7, 2))
    expected[1, 0], expected[3, 1] = 1, -1
    assert found[:, :2] == pytest.approx(expected, abs=1e-9)
    assert np.isnan(found[:, 2]).all()


def test_correlations_are_those_of_the_garments_that_have_the_property():
    scores, value = CODES[:, :2], PROPERTIES["a"].copy()
    value[::3] = np.nan
    kept = np.isfinite(value)
    twin = [np.corrcoef(scores[kept, k], value[kept])[0, 1] for k in range(2)]
    assert correlations(scores, value[:, None])[:, 0] == pytest.approx(twin)


def test_prototypes_are_means_of_groups_that_are_not_empty():
    first = np.arange(len(CODES)) < 4
    found = group_means(CODES, {"first": first, "none": np.zeros(len(CODES), bool)})
    assert list(found) == ["first"]
    assert found["first"] == pytest.approx(CODES[:4].mean(axis=0))


def test_an_edit_changes_its_property_by_what_is_asked_and_no_other():
    edits = PropertyEdits(CODES, PROPERTIES)
    before = edits.predict(CODES[0])
    after = edits.predict(edits.edit(CODES[0], {"b": 7.5}))
    assert after - before == pytest.approx([0, 7.5, 0], abs=1e-9)
    both = edits.predict(edits.edit(CODES[0], {"a": -2.0, "c": 1.0}))
    assert both - before == pytest.approx([-2, 0, 1], abs=1e-9)


def test_regressions_find_planted_slopes_whatever_the_units():
    scaled = {"a": 1e6 * PROPERTIES["a"], "b": 1e-3 * PROPERTIES["b"]}
    edits = PropertyEdits(CODES, scaled)
    assert edits.slopes == pytest.approx(SLOPES[:2] * [[1e6], [1e-3]])
    assert edits.predict(CODES) == pytest.approx(np.stack(list(scaled.values()), axis=1))
    change = edits.edit(CODES[0], {"b": 1e-3}) - CODES[0]
    assert SLOPES[:2] @ change == pytest.approx([0, 1], abs=1e-6)


def test_an_edit_is_the_likeliest_of_all_that_do_what_is_asked():
    edits = PropertyEdits(CODES, PROPERTIES)
    step = edits.step("a")
    precision = np.linalg.inv(np.cov(CODES.T))
    aside = np.linalg.svd(SLOPES)[2][3:]  # changes that no property notices
    assert aside @ precision @ step == pytest.approx(np.zeros(4), abs=1e-9)


def test_edits_stay_within_what_training_codes_do():
    flat = CODES.copy()
    flat[:, 5] = 0.25
    step = PropertyEdits(flat, {"a": SLOPES[0] @ flat.T}).step("a")
    assert step[5] == pytest.approx(0, abs=1e-12)


def test_garments_without_a_property_do_not_count_in_its_regression():
    value = PROPERTIES["a"].copy()
    value[:10] = np.nan
    assert PropertyEdits(CODES, {"a": value}).slopes[0] == pytest.approx(SLOPES[0])


def test_codes_explain_a_linear_property_and_not_noise():
    noise = rng_for(3, "noise").normal(size=2000)
    codes = rng_for(3, "codes").normal(size=(2000, 4))
    linear = codes @ [1.0, 2.0, 0.0, -1.0]
    shares = explained_share(codes, np.stack([linear, noise, linear + noise], axis=1))
    assert shares[0] == pytest.approx(1)
    assert shares[1] < 0.02
    assert shares[2] == pytest.approx(6 / 7, abs=0.03)


def test_explained_shares_leave_each_garment_out():
    value = PROPERTIES["a"] + RNG.normal(size=len(CODES))
    errors = []
    for left_out in range(len(CODES)):
        kept = np.arange(len(CODES)) != left_out
        edits = PropertyEdits(CODES[kept], {"a": value[kept]})
        errors.append(edits.predict(CODES[left_out])[0] - value[left_out])
    slow = 1 - np.mean(np.square(errors)) / value.var()
    assert explained_share(CODES, value[:, None]) == pytest.approx([slow])


def test_too_few_garments_explain_nothing():
    assert np.isnan(explained_share(CODES[:14], PROPERTIES["a"][:14, None])).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: single_gaussian(CODES[:1]), "expected two codes or more"),
        (lambda: principal_gaussian(CODES[0]), "expected two codes or more"),
        (lambda: draw_between(CODES[:1], np.zeros(1), RNG, 1), "expected two codes or more"),
        (lambda: principal_gaussian(CODES * np.nan), "not finite"),
        (lambda: interpolate(CODES[0], CODES[1], 1), "steps: 1, expected at least 2"),
        (lambda: interpolate(CODES[0], CODES[1, :3], 4), "7 and 3 numbers"),
        (lambda: PropertyEdits(CODES, {"a": np.full(60, np.nan)}), "0 garments have 'a'"),
        (lambda: PropertyEdits(CODES, PROPERTIES).step("d"), "'d', expected one of a, b, c"),
        (
            lambda: PropertyEdits(CODES, {**PROPERTIES, "e": PROPERTIES["a"]}).step("e"),
            "'e' cannot be changed by itself",
        ),
        (
            lambda: PropertyEdits(CODES, {"a": np.ones(60)}).step("a"),
            "'a' cannot be changed by itself",
        ),
    ],
)
def test_unusable_input_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
