"""The page on which all systems stand side by side."""

import re
from html import unescape

import pytest

from drapeline.errors import InputError
from drapeline.metrics.cost import Cost, write_costs
from drapeline.metrics.properties import COMMON
from drapeline.metrics.table import HIGH, LOW, METRICS_FILE, write_metrics
from drapeline.report.models.systems import QUESTIONS, write_systems_page
from toys.metric_rows import metric_row, metric_table

# Rows' model -> heading.
TITLES = {question.model: question.title for question in QUESTIONS}
COSTS = "Time and memory"


def rows_of(model, variant, *values, garment=COMMON, source=""):
    """To and from the true garment, normals and openings; of pictures the first two."""
    metrics = ("surface_to_true_mm", "true_to_surface_mm", "normal_error_deg", "openings_right")
    if model in ("picture", "smplicit"):
        metrics = ("rest_to_true_mm", "true_to_rest_mm")
    return [
        metric_row(variant, garment, metric, value, model=model, source=source)
        for metric, value in zip(metrics, values, strict=False)
    ]


def save(folder, rows, costs=()):
    """An evaluation."""
    folder.mkdir()
    write_metrics(folder / METRICS_FILE, metric_table(rows))
    if costs:
        write_costs(folder, costs)
    return folder


def page_of(folder, *evaluated):
    """Heading -> rows of the first table below it, without their tags."""
    write_systems_page(folder / "page.html", evaluated)
    text = re.sub("</?small>", "", unescape((folder / "page.html").read_text()))
    found = {}
    for part in text.split("<h2>")[1:]:
        title, _, rest = part.partition("</h2>")
        body = re.search(r"<tbody>(.*?)</tbody>", rest, re.DOTALL)
        lines = re.findall(r"<tr>(.*?)</tr>", body[1], re.DOTALL) if body else []
        found[title] = [re.findall(r"<td[^>]*>(.*?)</td>", line) for line in lines]
    return found


def test_every_question_has_its_rows_under_its_heading(tmp_path):
    codes = [
        *rows_of("representation", "static_ppca", 1.25, 2.5, 3.5, 0.5, garment="all"),
        metric_row("static_ppca", "all", "code_numbers", 128, model="representation"),
        *rows_of("moved", "moved_dynamic_ppca", 10.25),
        *rows_of("clean_scan", "static_ppca_scan", 4.25),
        *rows_of("worse_scan", "static_ppca_scan", 8.25),
        *rows_of("picture", "picture_network", 12.25, 13.25, garment="all"),
    ]
    other = rows_of("clean_scan", "garment4d_scan_ours", 2.25)
    found = page_of(tmp_path, save(tmp_path / "codes", codes), save(tmp_path / "other", other))
    assert [*found] == [*TITLES.values(), COSTS]
    name = "Masked PPCA (ours)"
    assert found[TITLES["representation"]] == [[name, "128", "1.25", "2.50", "3.5", "50", "5"]]
    assert [line[:2] for line in found[TITLES["moved"]]] == [[name, "10.2"]]
    clean = [line[1] for line in found[TITLES["clean_scan"]]]
    assert sorted(clean) == ["2.2", "4.2"]
    assert [line[1] for line in found[TITLES["worse_scan"]]] == ["8.2"]
    assert [line[1:3] for line in found[TITLES["picture"]]] == [["12.2", "13.2"]]


def test_a_question_that_nobody_answered_is_left_out(tmp_path):
    found = page_of(tmp_path, save(tmp_path / "moved", rows_of("moved", "moved_nearest", 10.0)))
    assert [*found] == [TITLES["moved"], COSTS]


@pytest.mark.parametrize("model", TITLES)
def test_a_method_from_elsewhere_appears_by_its_name_in_every_question(tmp_path, model):
    ours = {
        "representation": "svae",
        "moved": "moved_nearest",
        "clean_scan": "svae_scan",
        "worse_scan": "svae_scan",
        "picture": "picture_network",
    }[model]
    garment = "all" if model in ("representation", "picture") else COMMON
    rows = [rows_of(model, name, 10.0, 20.0, garment=garment) for name in (ours, "arap")]
    folders = [save(tmp_path / str(k), part) for k, part in enumerate(rows)]
    (lines,) = (lines for title, lines in page_of(tmp_path, *folders).items() if title != COSTS)
    assert [line[0] for line in lines][-1] == "arap"
    assert len(lines) == 2


def test_systems_are_compared_on_garments_that_all_of_them_know(tmp_path):
    rows = [
        *rows_of("clean_scan", "svae_scan", 99.0, garment="all"),
        *rows_of("clean_scan", "svae_scan", 77.0, garment="long lower"),
        *rows_of("clean_scan", "svae_scan", 5.0),
        metric_row("scan_body_fitted", "all", "vertex_error_mm", 3.0, model="clean_scan"),
        metric_row("svae_scan", COMMON, "surface_to_true_mm" + LOW, 4.0, model="clean_scan"),
        metric_row("svae_scan", COMMON, "surface_to_true_mm" + HIGH, 6.0, model="clean_scan"),
    ]
    found = page_of(tmp_path, save(tmp_path / "scans", rows))
    (line,) = found[TITLES["clean_scan"]]
    assert line[1] == "5.0 [4.0, 6.0]"


def test_what_does_not_compete_comes_last(tmp_path):
    rows = [
        *rows_of("moved", "again_rest_shape", 1.0),
        *rows_of("moved", "moved_nearest", 10.0),
        *rows_of("moved", "arap", 20.0),
    ]
    found = page_of(tmp_path, save(tmp_path / "moved", rows))
    assert [line[1] for line in found[TITLES["moved"]]] == ["10.0", "20.0", "1.0"]


def test_people_who_hide_one_another_are_not_what_systems_are_asked_about(tmp_path):
    rows = [
        *rows_of("picture", "picture_network", 12.0, 13.0, garment="all"),
        *rows_of("smplicit", "smplicit_images_fitted", 15.0, 16.0, garment="all"),
        *rows_of("smplicit", "smplicit_images_fitted_in_pair", 17.0, 18.0, garment="all"),
    ]
    found = page_of(tmp_path, save(tmp_path / "pictures", rows))
    assert [line[1:3] for line in found[TITLES["picture"]]] == [["12.0", "13.0"], ["15.0", "16.0"]]


def test_samples_of_each_solver_have_a_table_as_well(tmp_path):
    rows = [
        line
        for source, value in (("", 3.0), ("xpbd", 2.0), ("blender", 4.0))
        for line in rows_of("moved", "moved_nearest", value, source=source)
    ]
    write_systems_page(tmp_path / "page.html", [save(tmp_path / "moved", rows)])
    text = (tmp_path / "page.html").read_text()
    for source in ("xpbd", "blender"):
        assert f"<h3>On the samples of {source} alone</h3>" in text


def test_costs_of_all_questions_are_in_one_table(tmp_path):
    costs = [
        Cost("representation", "svae", 0.125, 12, 800.0),
        Cost("moved", "moved_nearest", 2.5, 7, 900.0),
        Cost("moved", "unmeasured", 0.0, 7, 900.0),
    ]
    codes = save(tmp_path / "codes", rows_of("representation", "svae", 1, garment="all"), costs[:1])
    moved = save(tmp_path / "moved", rows_of("moved", "moved_nearest", 10.0), costs[1:])
    scored = save(tmp_path / "arap", rows_of("moved", "arap", 9.0))
    found = page_of(tmp_path, scored, codes, moved)
    assert found[COSTS] == [
        [TITLES["representation"], "Garment VAE", "0.12", "12", "800"],
        [TITLES["moved"], "SMPLicit, skinned by the body's nearest vertex", "2.50", "7", "900"],
    ]


def test_without_costs_there_is_a_page(tmp_path):
    found = page_of(tmp_path, save(tmp_path / "arap", rows_of("moved", "arap", 9.0)))
    assert found[COSTS] == []
    assert found[TITLES["moved"]][0][0] == "arap"


def test_a_folder_without_metrics_is_named(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=f"empty/{METRICS_FILE}: no such file"):
        write_systems_page(tmp_path / "page.html", [tmp_path / "empty"])
