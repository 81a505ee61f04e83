import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from drapeline.dataset.record import SampleRecord
from drapeline.dataset.writer import summarise_health
from drapeline.errors import InputError
from drapeline.report.dataset.health import MEASURES, plot_measure, plot_speed, write_health_page
from drapeline.simulation.health import HealthGarment, HealthMonitor


def health(**means):
    return {name: {"mean": m, "min": m / 2, "max": 2 * m} for name, m in means.items()}


def record_of(base, name="00001", **means):
    meta = {**base.meta, "id": name, "health": health(**means)}
    return replace(base, meta=meta)


class Rows(HTMLParser):
    """Cells of every table row, with their classes."""

    def __init__(self, text):
        super().__init__()
        self.rows, self._open = [], False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        self._open = tag in {"td", "th"}
        if self._open:
            self.rows[-1].append(["", dict(attrs).get("class", "")])

    def handle_endtag(self, tag):
        self._open = False

    def handle_data(self, data):
        if self._open:
            self.rows[-1][-1][0] += data


def page_rows(path):
    return {row[0][0]: row for row in Rows(path.read_text()).rows}


def test_every_measure_is_one_that_the_simulation_takes():
    square = np.array([[0, 0, 2], [1, 0, 2], [1, 1, 2], [0, 1, 2.0]])
    body = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    sides = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    garment = HealthGarment("Skirt", np.array([[0, 1, 2, 3]]), np.ones(4))
    monitor = HealthMonitor([garment], sides)
    for _ in range(3):
        monitor.add([square], body)
    summary = summarise_health(monitor.arrays())
    for measure in MEASURES.values():
        for key, statistic in filter(None, measure.keys):
            assert statistic in summary[key]


def test_values_come_in_the_shown_unit(dataset):
    record = record_of(dataset.records[0], inside_share=0.004, depth_max_m=0.003)
    assert MEASURES["penetration"].values(record) == pytest.approx((0.2, 0.4, 0.8))
    assert MEASURES["depth"].values(record)[1] == pytest.approx(3)
    assert np.isnan(MEASURES["stretch"].values(record)).all()


@pytest.mark.parametrize(
    ("name", "values", "good"),
    [
        ("penetration", [0.5], True),
        ("penetration", [0.51], False),
        ("stretch", [0.85, 1.2], True),
        ("stretch", [0.84, 1.1], False),
        ("stretch", [0.9, 1.21], False),
        ("acceleration", [1e6], True),
    ],
)
def test_goals(name, values, good):
    assert MEASURES[name].holds(*values) is good


def test_figures_have_label_unit_and_samples(tmp_path, dataset):
    plot_measure(tmp_path / "x.svg", dataset.records, MEASURES["penetration"])
    text = (tmp_path / "x.svg").read_text()
    for word in ("Garment vertices inside the body (%)", "00004", "goal: at most 0.5 %"):
        assert word in text
    plot_speed(tmp_path / "speed.svg", dataset.records)
    assert "frames/s on one core" in (tmp_path / "speed.svg").read_text()


def test_many_samples_are_ranked_and_not_named(tmp_path, dataset):
    records = [record_of(dataset.records[0], f"{i:05}", inside_share=0.001) for i in range(200)]
    plot_measure(tmp_path / "x.svg", records, MEASURES["penetration"])
    text = (tmp_path / "x.svg").read_text()
    assert "00100" not in text
    assert "Samples, by value" in text
    assert float(re.search(r'height="([\d.]+)pt"', text).group(1)) < 1200


def test_an_unmeasured_quantity_still_gives_a_figure(tmp_path, dataset, rejected):
    for data in (dataset, rejected):
        plot_measure(tmp_path / "x.svg", data.records, MEASURES["slip"])
        assert "not measured in any accepted sample" in (tmp_path / "x.svg").read_text()


def test_a_sample_without_speed_is_named(tmp_path, dataset):
    broken = replace(dataset.records[0], meta={**dataset.records[0].meta, "simulation": {}})
    with pytest.raises(InputError, match=r"meta.json: lacks simulation.frames_per_second"):
        plot_speed(tmp_path / "x.svg", [broken])


def test_the_page_judges_and_gives_reasons(tmp_path, dataset):
    records: list[SampleRecord] = [
        record_of(dataset.records[0], "00001", inside_share=0.002),
        record_of(dataset.records[1], "00002", inside_share=0.009),
        record_of(dataset.records[2], "00004", inside_share=0.001),
    ]
    write_health_page(tmp_path / "x.html", dataset.path, records)
    rows = page_rows(tmp_path / "x.html")
    assert rows["Samples accepted"][2] == ["✗ 3 of 4 (75 %)", "number bad"]
    assert rows["Garment vertices inside the body (%)"][2] == ["✓ 0.40", "number good"]
    assert rows["00003"][1] == ["rejected", "bad"]
    assert rows["00003"][2][0] == "1.20 % of the vertices inside the body"
    assert ["0.90", "number bad"] in rows["00002"]
    assert ["0.20", "number"] in rows["00001"]


def test_the_page_of_rejected_samples_alone(tmp_path, rejected):
    write_health_page(tmp_path / "x.html", rejected.path, rejected.records)
    assert page_rows(tmp_path / "x.html")["Samples accepted"][2][0] == "✗ 0 of 1 (0 %)"
