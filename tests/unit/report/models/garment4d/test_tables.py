"""The tables of Garment4D: our numbers and the paper's never share a column."""

import re

import numpy as np
import pytest

from drapeline.metrics.table import HIGH, LOW, write_metrics
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.error_table import FILE_NAME, write_errors
from drapeline.registration.settings import TemplateFitSettings
from drapeline.registration.to_template.remesh import NamedGarment, write_tables
from drapeline.report.models.garment4d.tables import (
    DEPARTURES,
    write_garment4d_beside_paper,
    write_garment4d_page,
)
from drapeline.report.registration_table import ERRORS
from drapeline.report.tables import BESIDE_PAPER
from drapeline.schema import read_table
from toys.metric_rows import metric_row, metric_table
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
        metric_row("posed_undegraded", "Skirt", "vertex_error_mm", 28.0),
        metric_row("posed_body_noise_50", "Skirt", "vertex_error_mm", 33.0),
        metric_row("lbs_body_noise_50", "Trousers", "vertex_error_mm", 44.0),
        metric_row("ours_views_1", "Skirt", "vertex_error_mm", 34.0),
        metric_row("ours_views_1", "Skirt", "canonical_error_mm", 26.0),
        metric_row("canonical", "Skirt", "canonical_error_mm", 24.0),
        metric_row("canonical_untrained", "Skirt", "canonical_error_mm", 51.0),
        metric_row("regression", "Skirt", "canonical_error_mm", 22.0),
        metric_row("ours", "Skirt", "canonical_error_mm", 21.0),
        metric_row("ours", "Skirt", "segmentation_accuracy", 0.975),
        metric_row("ours_proposals", "Skirt", "vertex_error_mm", 26.0),
        metric_row("ours", "Skirt", "vertex_error_mm", 23.0),
        metric_row("ours_true_labels", "Skirt", "vertex_error_mm", 22.5),
        metric_row("canonical", "Skirt", "segmentation_accuracy", 0.953),
        metric_row("one_label", "Skirt", "segmentation_accuracy", 0.444),
        metric_row("posed", "Skirt", "vertex_error_mm", 31.5, source="blender"),
        metric_row("posed", "Skirt", "vertex_error_mm", 29.5, source="xpbd"),
        metric_row("neighbours_16", "Skirt", "vertex_error_mm", 30.0),
        metric_row("neighbours_4", "Skirt", "vertex_error_mm", 31.0),
    ]
    write_metrics(tmp_path / "metrics.tsv", metric_table(rows))
    return tmp_path / "metrics.tsv"


def sections(path):
    """Heading -> HTML up to the next one."""
    parts = re.split(r"<h[23]>(.*?)</h[23]>", path.read_text())
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def body_rows(html):
    rows = re.findall(r"<tr>(.*?)</tr>", html.split("<tbody>")[1], re.DOTALL)
    return [re.findall(r"<td[^>]*>(.*?)</td>", re.sub("</?small>", "", line)) for line in rows]


def test_each_table_shows_its_metric_of_its_models(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    parts = sections(tmp_path / "page.html")

    def first(title):
        return [line[:2] for line in body_rows(parts[title]) if line[1] != "-"]

    assert first("Table 3: posed garments, vertex error M2 (mm)") == [
        ["Interpolated skinning", "41.0"],
        ["Garment4D, posed stage", "27.1 [20.0, 35.5]"],
        ["Ours, before it is laid on the points", "26.0"],
        ["Ours", "23.0"],
        ["Ours, given the true labels", "22.5"],
    ]
    assert first("Table 2: canonical garments, vertex error M1 (mm)") == [
        ["Mean garment of the type", "50.0"],
        ["Garment4D, canonical stage, untrained", "51.0"],
        ["Garment4D, canonical stage", "24.0"],
        ["Ours, the first guess", "22.0"],
        ["Ours", "21.0"],
        ["True coefficients: the best of the garment space", "2.0"],
    ]
    assert [line[1] for line in first("Points with the right label (%)")] == [
        *("44.4", "95.3", "97.5"),
    ]
    assert first("Time per frame (ms)") == [["Garment4D, posed stage", "4.2"]]
    worse = "Holes, wrong labels (figures 9 and 10), other worse inputs: M2 (mm)"
    assert first(worse) == [
        ["Garment4D, posed stage, the same sequences as they are", "28.0"],
        ["Garment4D, posed stage, poses off by 50 mrad", "33.0"],
        ["Ours, number of cameras: 1", "34.0"],
    ]
    assert first("The same of our garments at rest: M1 (mm)") == [
        ["Ours, number of cameras: 1", "26.0"],
    ]
    sweep = "Neighbours K (figure 8): M2 (mm)"
    assert first(sweep) == [["K = 4", "31.0"], ["K = 16", "30.0"]]
    assert body_rows(parts["Vertices inside the body"])[0][:3] == [
        *("Skirt", "Ground truth itself, as registered", "0.45"),
    ]
    assert body_rows(parts["By cloth solver"]) == [
        ["Vertex error (mm)", "Skirt", "Garment4D, posed stage", "31.5", "29.5", "5"],
    ]
    assert "<p>None.</p>" in parts["Registration to the templates"]


def test_a_type_that_the_paper_lacks_is_shown_behind_its_types_where_it_was_measured(tmp_path):
    title = "Table 3: posed garments, vertex error M2 (mm)"

    def columns(*garments):
        rows = [metric_row("posed", name, "vertex_error_mm", 27.0) for name in garments]
        write_metrics(tmp_path / "metrics.tsv", metric_table(rows))
        write_garment4d_page(tmp_path / "page.html", tmp_path / "metrics.tsv")
        table = sections(tmp_path / "page.html")[title]
        return [name for name in re.findall(r"<th[^>]*>(.*?)</th>", table) if name in GARMENTS]

    own = columns("Skirt")
    assert "Dress" not in own
    more = columns("Dress", "Skirt", "Top")
    assert [name for name in more if name in own] == own
    assert [name for name in more if name not in own] == ["Top", "Dress"]
    assert more[-2:] == ["Top", "Dress"]


def test_only_the_test_split_of_this_model_is_shown(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    text = (tmp_path / "page.html").read_text()
    assert "99.0" not in text
    assert "88.0" not in text


def test_departures_from_the_paper_are_told_where_they_hold(metrics, tmp_path):
    for chosen in ([], ["balance"], list(DEPARTURES)):
        write_garment4d_page(tmp_path / "page.html", metrics, departures=chosen)
        text = (tmp_path / "page.html").read_text()
        for name, words in DEPARTURES.items():
            assert (words in text) == (name in chosen)


def test_the_papers_numbers_are_shaded_and_named_as_theirs(metrics, tmp_path):
    write_garment4d_page(tmp_path / "page.html", metrics)
    text = (tmp_path / "page.html").read_text()
    for number in ("33.71", "30.23", "79.52", "49.39", "26.48", "12.59", "3.273", "+8.42"):
        assert f'<td class="number theirs">{number}</td>' in text
        assert f'<td class="number">{number}</td>' not in text


def test_registration_is_judged_against_its_targets(metrics, tmp_path):
    garments = [NamedGarment("a", "Skirt", *toy_skirt(0.2, -0.5))]
    write_tables(
        tmp_path / "fits", garments, "Skirt", toy_template(), TemplateFitSettings(iterations=1)
    )
    rows = read_table(tmp_path / "fits" / FILE_NAME, ERRORS).to_dict("records")
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
    write_garment4d_beside_paper(tmp_path / "beside.tsv", metrics)
    rows = read_table(tmp_path / "beside.tsv", BESIDE_PAPER)
    found = rows.set_index(["table", "variant", "garment"])[["ours", "theirs"]].apply(tuple, axis=1)
    assert found["2", "canonical", "Skirt"] == (24, 30.23)
    assert found["3", "posed", "Skirt"] == (27.125, 49.39)
    assert np.isnan(found["3", "posed", "Tshirt"][0])
    assert found["4", "mgn", "Trousers"][1] == 4.135
    assert len(found) == 6 + 9 + 6
