"""The tables of the garment VAE: our numbers and the paper's never share a column."""

import re

import numpy as np
import pytest

from drapeline.metrics.table import HIGH, LOW, write_metrics
from drapeline.outfits.garment_types import GARMENTS
from drapeline.report.models.gcvae.tables import write_gcvae_beside_paper, write_gcvae_page
from drapeline.report.tables import BESIDE_PAPER, MEAN_OF_TYPES
from drapeline.schema import read_table
from toys.metric_rows import metric_row, metric_table


def row(variant, *values, **others):
    models = {"mean_garment": "baseline", "again_rest_shape": "truth"}
    model = models.get(variant, variant.partition("_")[0])
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
        row("svae", "all", "surface_error_mm", 2.222, split="train", n=999),
        row("svae", "all", "active_units", 17),
        row("mean_garment", "all", "surface_error_mm", 11.1),
        row("dvae_unposed_4_prior", "all", "surface_error_mm", 55.5),
        row("again_rest_shape", "all", "surface_error_mm", 6.6),
        *(
            row("dvae_unposed_4", garment, metric, value + k)
            for k, garment in enumerate(GARMENTS[:6])  # CLOTH3D's
            for metric, value in (("surface_error_mm", 20.0), ("normal_error_deg", 30.0))
        ),
        row("dvae_unposed_4", "all", "surface_error_mm", 21.5, n=900),
        row("dvae_unposed_4", "all", "surface_error_mm", 31.7, n=100, source="blender"),
        row("dvae_unposed_4", "Dress", "surface_error_mm", 33.3, n=100, source="blender"),
        row("dvae_unposed_4", "Dress", "normal_error_deg", 44.4, n=100, source="blender"),
        row("dvae_unposed_4", "all", "surface_error_mm", 20.2, n=800, source="xpbd"),
    ]
    write_metrics(tmp_path / "metrics.tsv", metric_table(rows))
    return tmp_path / "metrics.tsv"


@pytest.fixture
def parts(metrics, tmp_path):
    """Heading -> HTML up to the next one."""
    write_gcvae_page(tmp_path / "page.html", metrics)
    found = re.split(r"<h[23]>(.*?)</h[23]>", (tmp_path / "page.html").read_text())
    return dict(zip(found[1::2], found[2::2], strict=False))


def test_static_models_stand_beside_baselines_with_intervals_of_the_test_split(parts):
    text = parts["Table 3a: static garments, ablations and baselines"]
    assert "4.3 <small>[3.9, 4.8]</small>" in text
    assert "1.23" in text  # per cent
    assert "Mean garment of the type" in text
    assert "99.0" not in "".join(parts.values())


def test_what_was_learned_from_stands_beside_what_was_not(parts):
    text = parts["Table 3a: static garments, ablations and baselines"]
    headings = re.findall(r"<th.*?>(.*?)</th>", text)
    assert headings[1:3] == ["Surface error (mm)", "On training garments (mm)"]
    assert ">2.2<" in text
    assert ">17<" in text  # active units
    assert "999" not in text  # the number of garments is that of the test split


def test_models_that_see_the_frame_stand_apart_from_those_that_predict_it(parts):
    seen, predicted = (
        parts[f"Garments in motion, {what}"] for what in ("reconstructed", "predicted")
    )
    assert ">55.5<" in predicted
    assert ">55.5<" not in seen
    assert ">21.5<" in seen
    assert ">21.5<" not in predicted
    for text in (seen, predicted):  # the floor, which is no rival
        assert '<td class="number">6.6</td>' in text


def test_table_4_is_there_for_each_solver(metrics, tmp_path):
    write_gcvae_page(tmp_path / "page.html", metrics)
    text = (tmp_path / "page.html").read_text()
    common, blender, xpbd, *_ = re.split(r"<h3>On the samples of \w+ alone</h3>", text)
    assert [part.count(">31.7<") for part in (common, blender, xpbd)] == [0, 1, 0]


def test_table_4_has_the_mean_of_types(parts):
    assert ">22.5<" in parts["Table 4: garments in motion, reconstructed, surface error (mm)"]
    assert ">32.5<" in parts["Garments in motion, reconstructed, normals error (deg)"]


def test_the_papers_numbers_are_shaded_and_named_as_theirs(metrics, tmp_path):
    write_gcvae_page(tmp_path / "page.html", metrics)
    text = (tmp_path / "page.html").read_text()
    for number in ("14.7", "0.9522", "1.1009", "0.9665", "29.3"):
        assert f'<td class="number theirs">{number}</td>' in text
        assert f'<td class="number">{number}</td>' not in text
    headings = re.findall(r'<th class="number theirs">(.*?)</th>', text)
    assert headings
    assert all(heading.endswith(", CLOTH3D") for heading in headings)


def test_beside_paper_has_two_columns(metrics, tmp_path):
    write_gcvae_beside_paper(tmp_path / "beside.tsv", metrics)
    rows = read_table(tmp_path / "beside.tsv", BESIDE_PAPER)
    key = ["table", "variant", "garment", "metric"]
    found = rows.set_index(key)[["ours", "theirs"]].apply(tuple, axis=1)
    assert found["3a", "svae", "all", "surface_error_mm"] == (4.321, 14.7)
    assert found["3b", "svae", "Dress", "mask_iou"] == (0.95, 0.9665)
    assert found["4", "dvae_unposed_4", MEAN_OF_TYPES, "surface_error_mm"] == (22.5, 26.4)
    # Its angles are in radians and its KL of no stated unit: ours do not stand beside them.
    ours, theirs = found["3a", "svae", "all", "normal_error_rad"]
    assert np.isnan(ours)
    assert theirs == 1.02
    assert ("3a", "svae_no_mask", "all", "mask_iou") not in found.index
