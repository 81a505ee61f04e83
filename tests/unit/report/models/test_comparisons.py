"""The pages that compare all models: by their codes, and on the same scans."""

import re
from html import unescape

from drapeline.metrics.table import HIGH, LOW, write_metrics
from drapeline.outfits.garment_types import GARMENT4D_TYPES
from drapeline.report.models.comparisons import write_representations, write_scans_page
from toys.metric_rows import metric_row, metric_table


def row(variant, garment, value, metric="surface_to_true_mm", split="test"):
    return metric_row(variant, garment, metric, value, model="representation", split=split)


def bodies(page):
    """Rows of each table, without their tags."""
    found = []
    for body in re.findall(r"<tbody>(.*?)</tbody>", re.sub("</?small>", "", unescape(page)), re.S):
        lines = re.findall(r"<tr>(.*?)</tr>", body, re.DOTALL)
        found.append([re.findall(r"<td[^>]*>(.*?)</td>", line) for line in lines])
    return found


def test_each_code_has_a_row_and_what_was_not_measured_a_dash(tmp_path):
    rows = [
        row("static_ppca", "Skirt", 3.25),
        row("static_ppca", "Skirt", 3.0, "surface_to_true_mm" + LOW),
        row("static_ppca", "Skirt", 3.5, "surface_to_true_mm" + HIGH),
        row("static_ppca", "Trousers", 77.0, split="val"),
        row("garment4d_pca", "all", 4.5),
        *(row("static_ppca", kind, 128, "code_numbers") for kind in GARMENT4D_TYPES),
        row("garment4d_pca", "Skirt", 64, "code_numbers"),
        row("garment4d_pca", "Trousers", 51, "code_numbers"),
    ]
    write_metrics(tmp_path / "metrics.tsv", metric_table(rows))
    write_representations(tmp_path / "page.html", tmp_path / "metrics.tsv")
    to_true, sizes = bodies((tmp_path / "page.html").read_text())
    assert [line[:3] for line in to_true] == [
        ["Masked PPCA (ours)", "3.25 [3.00, 3.50]", "-"],
        ["PCA of Garment4D's templates", "-", "4.50"],
    ]
    assert sizes == [
        ["Masked PPCA (ours)", "128", "128", "128"],
        ["PCA of Garment4D's templates", "64", "-", "51"],
    ]


def test_representations_of_a_further_model_are_shown_under_their_own_names(tmp_path):
    rows = [
        row("implicit_registered", "Skirt", 1.25),
        row("implicit_code", "Skirt", 2.75),
        row("implicit_code", "Skirt", 96, "code_numbers"),
        row("body_registered", "Skirt", 0.5),
        row("svae", "Skirt", 3.25),
        row("svae", "Skirt", 128, "code_numbers"),
    ]
    write_metrics(tmp_path / "metrics.tsv", metric_table(rows))
    write_representations(tmp_path / "page.html", tmp_path / "metrics.tsv")
    first, *_ = bodies((tmp_path / "page.html").read_text())
    assert [line[:2] for line in first] == [
        ["Garment VAE", "3.25"],
        ["implicit_code", "2.75"],
        ["No code: registered to the body", "0.50"],
        ["implicit_registered", "1.25"],
    ]


def fit(variant, garment, value, metric="surface_to_true_mm", source=""):
    return metric_row(variant, garment, metric, value, model="scan", split="test", source=source)


def test_fits_have_a_row_each_and_the_papers_figures_a_table_of_their_own(tmp_path):
    rows = [
        fit("smplicit_scan_joint", "all", 12.34),
        fit("smplicit_scan_joint", "long lower", 21.0),
        fit("smplicit_scan_joint", "long lower", 20.0, "surface_to_true_mm" + LOW),
        fit("smplicit_scan_joint", "long lower", 22.0, "surface_to_true_mm" + HIGH),
        fit("svae_scan", "all", 56.78),
        fit("svae_scan", "all", 43.21, "true_to_surface_mm"),
        fit("scan_body_fitted", "all", 3.4, "vertex_error_mm"),
    ]
    write_metrics(tmp_path / "metrics.tsv", metric_table(rows))
    write_scans_page(tmp_path / "page.html", tmp_path / "metrics.tsv")
    page = (tmp_path / "page.html").read_text()
    ours, back, bodies, paper = page.split("<table")[1:]
    assert "12.3" in ours
    assert "21.0 <small>[20.0, 22.0]</small>" in ours
    assert "Short upper" not in ours
    assert "3.4" in bodies
    assert "TailorNet" in paper
    assert "0.32" in paper
    assert "0.32" not in ours + back
    assert "43.2" in back
    assert ours.count("<tr") == 3


def test_garments_of_several_solvers_have_tables_of_their_own(tmp_path):
    values = {"": 12.34, "blender": 56.78, "xpbd": 9.87}
    rows = [fit("smplicit_scan_joint", "all", value, source=name) for name, value in values.items()]
    write_metrics(tmp_path / "metrics.tsv", metric_table(rows))
    write_scans_page(tmp_path / "page.html", tmp_path / "metrics.tsv")
    every, blender, xpbd, *_ = (tmp_path / "page.html").read_text().split("<table")[1:]
    assert "12.3" in every
    assert "samples of blender alone" in every
    assert "56.8" in blender
    assert "9.9" in xpbd
