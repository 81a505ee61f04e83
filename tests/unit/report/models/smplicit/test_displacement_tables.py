import re

import pytest

from drapeline.errors import InputError
from drapeline.metrics.table import write_metrics
from drapeline.report.models.smplicit.displacement_tables import write_displacement_page
from toys.metric_rows import metric_row, metric_table


def row(variant, metric, value, **changes):
    garment = changes.pop("garment", "all")
    variant = f"smplicit_{variant}"
    return metric_row(variant, garment, metric, value, **{"model": "smplicit", **changes})


def test_every_number_is_where_it_belongs(tmp_path):
    upper, skirt = tmp_path / "upper.tsv", tmp_path / "skirt.tsv"
    write_metrics(
        upper,
        metric_table(
            [
                row("displacement_upper_network", "vertex_error_mm", 31.25),
                row("displacement_upper_network", "area_ratio", 0.93),
                row("displacement_upper_network", "vertex_error_mm", 77.0, garment="Top"),
                row("upper_fitted", "surface_to_true_mm", 88.0),
            ]
        ),
    )
    write_metrics(skirt, metric_table([row("displacement_skirt_nearest", "inside_share", 0.125)]))
    write_displacement_page(tmp_path / "page.html", [upper, skirt])
    page = (tmp_path / "page.html").read_text()
    (body,) = re.findall(r"<tbody>(.*?)</tbody>", page, re.DOTALL)
    first, second = re.findall(r"<tr>(.*?)</tr>", body, re.DOTALL)
    for text in ("Upper body", "With the network<", ">31.2<", ">93<"):
        assert text in first
    for text in ("Skirts", "nearest vertex", ">12.50<"):
        assert text in second
    assert "77.0" not in page
    assert "88.0" not in page


def test_missing_tables_are_named(tmp_path):
    with pytest.raises(InputError, match="nowhere.tsv: no such file"):
        write_displacement_page(tmp_path / "page.html", [tmp_path / "nowhere.tsv"])
