"""What jobs ask a cluster for."""

import pytest

from drapeline.experiment.resources import asked_mb, asked_minutes, cloth_factor


def test_short_jobs_ask_for_the_least():
    assert asked_minutes(0) == asked_minutes(190) == 10
    assert asked_mb(0) == asked_mb(600) == 1000


def test_requests_exceed_what_is_expected_and_grow_with_each_try():
    assert asked_minutes(3600) == 180
    assert asked_minutes(3600, attempt=2) == 360
    assert asked_mb(3000) == 4500
    assert asked_mb(3000, attempt=3) == 13500


def test_nobody_asks_for_more_than_a_day():
    assert asked_minutes(1e7) == asked_minutes(1e7, attempt=3) == 1440


def test_vertices_grow_with_the_square_of_the_edges_number():
    assert cloth_factor(0.02) == pytest.approx(1)
    assert cloth_factor(0.01) == pytest.approx(4)
