"""Curves and bars of Garment4D from rows of the table of metrics."""

import numpy as np
import pytest

from drapeline.metrics.garment4d import COMPARED
from drapeline.metrics.table import HIGH, LOW, write_metrics
from drapeline.report.models.garment4d.figures import (
    curve,
    plot_ablation,
    plot_neighbour_curve,
    plot_worse,
)
from drapeline.report.tables import read_test_metrics
from toys.metric_rows import metric_row, metric_table


def row(variant, metric, value, garment="Skirt", **others):
    return metric_row(variant, garment, metric, value, **others)


@pytest.fixture
def rows(tmp_path):
    """A sweep over K and one over holes of two models, another model, and a validation split."""
    found = [
        row(f"{prefix}_{number}", "vertex_error_mm" + end, value + number / 100)
        for prefix, numbers in (
            ("neighbours", (256, 1, 16)),
            ("posed_missing", (10, 50)),
            ("ours_missing", (10, 50)),
        )
        for number in numbers
        for end, value in (("", 20.0), (LOW, 18.0), (HIGH, 23.0))
    ]
    rows = [
        *found,
        row("neighbours_4", "vertex_error_mm", 99.0, split="val"),
        row("neighbours_8", "vertex_error_mm", 99.0, model="other"),
        row("posed", "vertex_error_mm", 20.5),
        row("posed_undegraded", "vertex_error_mm", 20.75),
        row("posed", "acceleration_error_m_s2", 3.25),
        row("no_transformer", "vertex_error_mm", 24.5),
        row("no_transformer", "acceleration_error_m_s2", 9.75),
        row("lbs", "vertex_error_mm", 44.5),
    ]
    write_metrics(tmp_path / "metrics.tsv", metric_table(rows))
    return read_test_metrics(tmp_path / "metrics.tsv", ["garment4d"])


def test_curve_rises_over_numbers_of_the_test_split(rows):
    found = curve(rows, "neighbours", "Skirt", "vertex_error_mm")
    np.testing.assert_array_equal(found["at"], [1, 16, 256])
    np.testing.assert_allclose(found["value"], [20.01, 20.16, 22.56])
    np.testing.assert_allclose(found["high"] - found["low"], 5)
    assert not len(curve(rows, "neighbours", "Tshirt", "vertex_error_mm"))


def test_curve_begins_at_the_model_itself_unless_it_was_measured_anew(rows):
    ends = {0.0: "posed_undegraded", 10.0: "lbs"}
    found = curve(rows, "posed_missing", "Skirt", "vertex_error_mm", ends)
    np.testing.assert_allclose(found["value"], [20.75, 20.1, 20.5])
    assert np.isnan(found["low"].iloc[0])
    assert not len(curve(rows, "posed_accuracy", "Skirt", "vertex_error_mm", ends))


def test_curves_of_neighbours_name_what_they_show_or_say_that_there_is_nothing(rows, tmp_path):
    plot_neighbour_curve(tmp_path / "c.svg", rows)
    text = (tmp_path / "c.svg").read_text()
    assert ">256<" in text
    assert ">Skirt<" in text
    assert ">Tshirt<" not in text
    assert ">Not measured.<" in text  # of times


def test_curves_of_worse_inputs_compare_the_models_that_were_measured(rows, tmp_path):
    plot_worse(tmp_path / "c.svg", rows, "missing")
    text = (tmp_path / "c.svg").read_text()
    for name, there in (
        *((COMPARED["posed"], True), (COMPARED["ours"], True), (COMPARED["lbs"], False)),
        *(("Skirt", True), ("Tshirt", False), ("Points missing (%)", True)),
        ("Not measured.", False),
    ):
        assert (f">{name}<" in text) == there, name


@pytest.mark.parametrize("kind", ["accuracy", "body_noise", "point_noise", "views"])
def test_worse_inputs_that_were_not_measured_are_told(rows, tmp_path, kind):
    plot_worse(tmp_path / "c.svg", rows, kind)
    text = (tmp_path / "c.svg").read_text()
    assert ">Not measured.<" in text
    assert ">Skirt<" not in text


def test_ablation_has_a_bar_per_measured_variant(rows, tmp_path):
    plot_ablation(tmp_path / "a.svg", rows, "Skirt")
    text = (tmp_path / "a.svg").read_text()
    for number in ("20.5", "24.5", "44.5", "3.25", "9.75"):
        assert f">{number}<" in text
    assert "Without temporal transformer" in text
    assert "Without body surface encoder" not in text
    plot_ablation(tmp_path / "a.svg", rows, "Tshirt")
    assert (tmp_path / "a.svg").read_text().count(">Not measured.<") == 2
