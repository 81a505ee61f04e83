"""The tables of the garment VAE: our numbers and the paper's never share a column."""

import csv

import pytest

from drapeline.metrics.table import HIGH, LOW, write_metrics
from drapeline.outfits.garment_types import GARMENTS
from drapeline.report.models.gcvae.tables import OURS, THEIRS, write_beside_paper, write_gcvae_page
from toys.metric_rows import metric_row


def row(variant, *values, **others):
    model = "dvae" if variant.startswith("dvae") else "svae"
    return metric_row(variant, *values, model=model, **others)


@pytest.fixture
def metrics(tmp_path):
    """Metrics of the full model, of a baseline and of one dynamic model."""
    rows = [
        row("svae", "all", "surface_error_mm", 4.321),
        row("svae", "all", "surface_error_mm" + LOW, 3.9),
        row("svae", "all", "surface_error_mm" + HIGH, 4.8),
        row("svae", "all", "inside_share", 0.0123),
        row("svae", "all", "surface_error_mm", 99.0, split="val"),
        row("svae", "Dress", "surface_error_mm", 7.0),
        row("svae", "Dress", "mask_iou", 0.95),
        row("mean_garment", "all", "surface_error_mm", 11.1),
        *(
            row("dvae_unposed_4", garment, metric, value + k)
            for k, garment in enumerate(GARMENTS)
            for metric, value in (("surface_error_mm", 20.0), ("normal_error_deg", 30.0))
        ),
        row("dvae_unposed_4", "all", "surface_error_mm", 21.5, n=900),
        row("dvae_unposed_4", "all", "surface_error_mm", 31.7, n=100, source="blender"),
        row("dvae_unposed_4", "Dress", "surface_error_mm", 33.3, n=100, source="blender"),
        row("dvae_unposed_4", "Dress", "normal_error_deg", 44.4, n=100, source="blender"),
        row("dvae_unposed_4", "all", "surface_error_mm", 20.2, n=800, source="xpbd"),
    ]
    write_metrics(tmp_path / "metrics.tsv", rows)
    return tmp_path / "metrics.tsv"


def test_page_has_our_rows_with_intervals_of_the_test_split(metrics, tmp_path):
    write_gcvae_page(tmp_path / "page.html", metrics)
    ours = (tmp_path / "page.html").read_text().split(f"<h2>{THEIRS}</h2>")[0]
    assert "4.3 <small>[3.9, 4.8]</small>" in ours
    assert "99.0" not in ours
    assert "1.23" in ours  # per cent
    assert "Mean garment of the type" in ours
    assert "without mask" not in ours  # not trained: no row


def test_table_4_ends_in_the_mean_of_types(metrics, tmp_path):
    write_gcvae_page(tmp_path / "page.html", metrics)
    text = (tmp_path / "page.html").read_text()
    assert "22.5 / 32.5" in text
    assert "20.0 / 30.0" in text


def test_samples_of_each_solver_have_a_table_and_do_not_change_the_others(metrics, tmp_path):
    write_gcvae_page(tmp_path / "page.html", metrics)
    text = (tmp_path / "page.html").read_text()
    common, _, rest = text.partition("<h3>On the samples of blender alone</h3>")
    blender, _, xpbd = rest.partition("<h3>On the samples of xpbd alone</h3>")
    assert "21.5" in common
    assert "31.7" not in common + xpbd
    assert "31.7" in blender
    assert "33.3 / 44.4" in blender
    assert "20.2" in xpbd


def test_the_papers_numbers_stand_apart(metrics, tmp_path):
    write_gcvae_page(tmp_path / "page.html", metrics)
    ours, theirs = (tmp_path / "page.html").read_text().split(f"<h2>{THEIRS}</h2>")
    for number in ("14.7", "0.9522", "1.1009", "0.9665"):
        assert number not in ours
        assert f'<td class="number theirs">{number}</td>' in theirs


def test_beside_paper_has_two_columns(metrics, tmp_path):
    write_beside_paper(tmp_path / "beside.tsv", metrics)
    with open(tmp_path / "beside.tsv") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    found = {(r["table"], r["row"], r["metric"]): (r[OURS], r[THEIRS]) for r in rows}
    assert found["3a", "svae", "surface_error_mm"] == ("4.321", "14.7")
    assert found["3a", "svae_no_mask", "mask_iou"] == ("-", "-")
    assert found["3b", "Dress", "mask_iou"] == ("0.95", "0.9665")
    assert found["4", "dvae_unposed_4 mean", "surface_error_mm"] == ("22.5", "26.4")
    # Its angles are in radians and its KL of no stated unit: ours do not stand beside them.
    assert found["3a", "svae", "normal_error_rad"] == ("-", "1.02")
