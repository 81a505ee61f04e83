"""The tables of Garment4D: our numbers and the paper's never share a column."""

import csv
import re

import pytest

from drapeline.dataset.tables import read_table
from drapeline.metrics.table import HIGH, LOW, write_metrics
from drapeline.registration.error_table import COLUMNS, FILE_NAME, write_errors
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.template_tables import NamedGarment, write_tables
from drapeline.report.models.garment4d.tables import (
    DEPARTURES,
    OURS,
    THEIRS,
    write_beside_paper,
    write_garment4d_page,
)
from toys.metric_rows import metric_row
from toys.templates import toy_skirt, toy_template


@pytest.fixture
def metrics(tmp_path):
    """Metrics of two posed models, of a baseline and of a sweep, mostly for skirts."""
    rows = [
        metric_row("posed", "Skirt", "vertex_error_mm", 27.125),
        metric_row("posed", "Skirt", "vertex_error_mm" + LOW, 20.0),
        metric_row("posed", "Skirt", "vertex_error_mm" + HIGH, 35.5),
        metric_row("posed", "Skirt", "acceleration_error_m_s2", 3.5),
        metric_row("posed", "Skirt", "vertex_error_mm", 99.0, split="val"),
        metric_row("posed", "Tshirt", "vertex_error_mm", 88.0, model="other"),
        metric_row("posed", "Skirt", "inside_share", 0.0123),
        metric_row("posed", "Skirt", "inference_s_per_frame", 0.0042),
        metric_row("lbs", "Skirt", "vertex_error_mm", 41.0),
        metric_row("lbs", "Trousers", "vertex_error_mm", 19.0, n=3),
        metric_row("truth", "Skirt", "inside_share", 0.0045),
        metric_row("truth", "Skirt", "to_cloud_mm", 6.25),
        metric_row("truth", "Tshirt", "to_cloud_mm", 5.0),
        metric_row("truth", "Skirt", "canonical_to_original_mm", 0.5),
        metric_row("pca", "Skirt", "canonical_error_mm", 2.0),
        metric_row("pca", "Skirt", "canonical_to_original_mm", 2.5),
        metric_row("mean_garment", "Skirt", "canonical_error_mm", 50.0),
        metric_row("noisy_body", "Skirt", "vertex_error_mm", 33.0),
        metric_row("noisy_body", "Skirt", "acceleration_error_m_s2", 3.75),
        metric_row("lbs_noisy_body", "Trousers", "vertex_error_mm", 44.0),
        metric_row("canonical_noisy_body", "Skirt", "canonical_error_mm", 26.0),
        metric_row("canonical", "Skirt", "canonical_error_mm", 24.0),
        metric_row("canonical", "Skirt", "segmentation_accuracy", 0.953),
        metric_row("one_label", "Skirt", "segmentation_accuracy", 0.444),
        metric_row("posed", "Skirt", "vertex_error_mm", 31.5, source="blender"),
        metric_row("posed", "Skirt", "vertex_error_mm", 29.5, source="xpbd"),
        metric_row("neighbours_16", "Skirt", "vertex_error_mm", 30.0),
        metric_row("neighbours_4", "Skirt", "vertex_error_mm", 31.0),
    ]
    write_metrics(tmp_path / "metrics.tsv", rows)
    return tmp_path / "metrics.tsv"


def sections(path):
    """Heading -> HTML up to the next one."""
    parts = re.split(r"<h[23]>(.*?)</h[23]>", path.read_text())
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def body_rows(html):
    rows = re.findall(r"<tr>(.*?)</tr>", html.split("<tbody>")[1], re.DOTALL)
    return [re.findall(r"<td[^>]*>(.*?)</td>", re.sub("</?small>", "", line)) for line in rows]


def test_posed_table_has_models_by_type_with_intervals(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    text = sections(tmp_path / "page.html")["Table 3: posed garments, vertex error M2 (mm)"]
    assert body_rows(text) == [
        ["Interpolated LBS", "41.0", "-", "19.0", "5 / - / 3"],
        ["Garment4D", "27.1 [20.0, 35.5]", "-", "-", "5 / - / -"],
    ]
    assert '<td class="number good">27.1 <small>[20.0, 35.5]</small></td>' in text
    assert '<td class="number good">19.0</td>' in text
    assert 'good">41.0' not in text


def test_only_the_test_split_of_this_model_is_shown(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    text = (tmp_path / "page.html").read_text()
    assert "99.0" not in text
    assert "88.0" not in text


def test_shares_are_in_per_cent_and_the_truth_is_there_too(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    parts = sections(tmp_path / "page.html")
    assert body_rows(parts["Vertices inside the body"]) == [
        ["Skirt", "Ground truth itself", "0.45", "-", "-"],
        ["Skirt", "Garment4D", "1.23", "-", "-"],
    ]
    labels = parts["Points with the right label (%)"]
    assert [line[1] for line in body_rows(labels)] == ["44.4", "95.3"]
    assert 'good">95.3' in labels
    assert 'good">44.4' not in labels
    assert body_rows(parts["Time per frame (ms)"])[0][1] == "4.2"
    cloud = parts["Table 5: distance of vertices to the cloud, one way (mm)"]
    assert body_rows(cloud)[0][:2] == ["Ground truth itself", "6.25"]


def test_ablations_have_both_errors_and_sweeps_rise(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    parts = sections(tmp_path / "page.html")
    pairs = parts["Ablations (figure 6) and inputs: M2 (mm) / M3 (m/s²)"]
    assert body_rows(pairs) == [["Full model", "27.1 / 3.50", "-", "-"]]
    sweep = parts["Neighbours, holes and wrong labels (figures 8 to 10): M2 (mm)"]
    assert [line[:2] for line in body_rows(sweep)] == [["K = 4", "31.0"], ["K = 16", "30.0"]]
    assert "<p>None.</p>" in parts["Registration to the templates"]


def test_floors_are_shown_and_never_lead(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    parts = sections(tmp_path / "page.html")
    canonical = parts["Table 2: canonical garments, vertex error M1 (mm)"]
    assert [line[1] for line in body_rows(canonical)] == ["50.0", "24.0", "2.0"]
    assert 'good">24.0' in canonical
    distance = body_rows(parts["Distance to the garment as simulated (mm)"])
    assert [line[:2] for line in distance] == [
        ["Best of the garment space: T of the true alpha", "2.5"],
        ["Registered garment itself", "0.5"],
    ]


def test_noisy_bodies_have_tables_of_their_own_and_unknown_accelerations_a_dash(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    parts = sections(tmp_path / "page.html")
    moving = parts["With an inexact body: M2 (mm) / M3 (m/s²)"]
    assert body_rows(moving) == [
        ["Interpolated LBS", "-", "-", "44.0 / -"],
        ["Garment4D", "33.0 / 3.75", "-", "-"],
    ]
    canonical = body_rows(parts["With an inexact body: M1 (mm)"])
    assert [line[:2] for line in canonical] == [["Garment4D", "26.0"]]


def test_departures_from_the_paper_are_told_where_they_hold(metrics, tmp_path):
    for chosen in ([], ["balance"], list(DEPARTURES)):
        write_garment4d_page(tmp_path / "page.html", metrics, departures=chosen)
        text = (tmp_path / "page.html").read_text()
        for name, words in DEPARTURES.items():
            assert (words in text) == (name in chosen)


def test_the_samples_of_each_solver_have_a_table(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    lines = body_rows(sections(tmp_path / "page.html")["By cloth solver"])
    assert lines == [
        ["blender", "M2 (mm)", "Garment4D", "31.5", "-", "-"],
        ["xpbd", "M2 (mm)", "Garment4D", "29.5", "-", "-"],
    ]


def test_the_papers_numbers_stand_apart(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    ours, theirs = (tmp_path / "page.html").read_text().split(f"<h2>{THEIRS}</h2>")
    for number in ("33.71", "30.23", "79.52", "49.39", "26.48", "12.59", "3.273", "+8.42"):
        assert number not in ours
        assert f'<td class="number theirs">{number}</td>' in theirs


def test_registration_is_judged_against_its_targets(metrics, tmp_path):
    garments = [NamedGarment("a", "Skirt", *toy_skirt(0.2, -0.5))]
    write_tables(
        tmp_path / "fits", garments, {"Skirt": toy_template()}, TemplateFitSettings(iterations=1)
    )
    rows = read_table(tmp_path / "fits" / FILE_NAME, COLUMNS)
    values = {
        "original_to_remeshed_mm": (2, 4),
        "remeshed_to_original_mm": (1, 1),
        "boundaries_mm": (6, 12),
        "flipped_faces": (0, 2),
    }
    assert list(values) == [row["metric"] for row in rows]
    # The rows of two garments as they are written but for their values.
    found = [
        {**row, "name": name, "value": values[row["metric"]][k]}
        for k, name in enumerate("ab")
        for row in rows
    ]
    write_errors(tmp_path / "both.tsv", found)
    write_garment4d_page(tmp_path / "page.html", metrics, [tmp_path / "both.tsv"])
    text = sections(tmp_path / "page.html")["Registration to the templates"]
    near, exact, boundaries = "3.00, at most 4.00", "1.00, at most 1.00", "9.00, at most 12.00"
    assert body_rows(text) == [["Skirt", "2", near, exact, boundaries, "2"]]
    assert ">Flipped faces, total<" in text
    assert '"number good">3.00' in text
    assert '"number bad">9.00' in text
    assert '"number bad">2<' in text


def test_beside_paper_has_two_columns(metrics, tmp_path):
    write_beside_paper(tmp_path / "beside.tsv", metrics)
    with open(tmp_path / "beside.tsv") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    found = {(r["table"], r["row"], r["metric"]): (r[OURS], r[THEIRS]) for r in rows}
    assert found["2", "canonical Skirt", "canonical_error_mm"] == ("24", "30.23")
    assert found["3", "posed Skirt", "vertex_error_mm"] == ("27.125", "49.39")
    assert found["3", "posed Tshirt", "vertex_error_mm"] == ("-", "37.83")
    assert found["4", "mgn Trousers", "acceleration_error_m_s2"] == ("-", "4.135")
    assert len(found) == 6 + 9 + 6
