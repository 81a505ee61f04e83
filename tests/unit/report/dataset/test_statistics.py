import re
import shutil
import xml.etree.ElementTree as ElementTree

import pytest

from drapeline.errors import InputError
from drapeline.report.dataset.records import accepted_records
from drapeline.report.dataset.statistics import (
    plot_actions,
    plot_bodies,
    plot_garments,
    plot_splits,
    plot_vertices,
)

OF_TABLES = [plot_garments, plot_actions, plot_splits]
OF_RECORDS = [plot_bodies, plot_vertices]


def drawn_text(path):
    """All words of an SVG, which must be well formed."""
    return " ".join(" ".join(node.itertext()) for node in ElementTree.parse(path).iter())


def size_pt(path):
    width, height = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', path.read_text()).groups()
    return float(width), float(height)


def all_figures(data, folder):
    for plot in OF_TABLES:
        plot(folder / f"{plot.__name__}.svg", data.path)
    for plot in OF_RECORDS:
        plot(folder / f"{plot.__name__}.svg", data.records)
    return sorted(folder.glob("*.svg"))


@pytest.mark.parametrize(
    ("plot", "words"),
    [
        (plot_garments, ["Tshirt", "Skirt", "cotton", "denim", "Garments", "3"]),
        (plot_actions, ["walk", "100.0 %, 18 frames", "Share of the frames (%)"]),
        (plot_splits, ["train", "val", "test", "female", "male", "Sequences"]),
    ],
)
def test_figures_of_tables_name_what_they_show(tmp_path, dataset, plot, words):
    plot(tmp_path / "x.svg", dataset.path)
    text = drawn_text(tmp_path / "x.svg")
    for word in words:
        assert word in text


@pytest.mark.parametrize(
    ("plot", "words"),
    [
        (plot_bodies, ["Shape 1 (deviations)", "Tightness 2", "female", "male"]),
        (plot_vertices, ["Vertices per garment", "Tshirt", "Skirt"]),
    ],
)
def test_figures_of_records_name_what_they_show(tmp_path, dataset, plot, words):
    plot(tmp_path / "x.svg", dataset.records)
    text = drawn_text(tmp_path / "x.svg")
    for word in words:
        assert word in text


def test_figures_fit_a_page_and_repeat_to_the_byte(tmp_path, dataset):
    first, second = tmp_path / "a", tmp_path / "b"
    for one, other in zip(all_figures(dataset, first), all_figures(dataset, second), strict=True):
        assert one.read_bytes() == other.read_bytes()
        width, height = size_pt(one)
        assert 400 <= width <= 800
        assert 100 <= height <= 500


def test_without_an_accepted_sample_every_figure_says_so(tmp_path, rejected):
    figures = all_figures(rejected, tmp_path)
    assert len(figures) == 5
    for path in figures:
        assert "No sample was accepted" in drawn_text(path)


def test_a_missing_column_is_named(tmp_path, dataset):
    shutil.copytree(dataset.path, tmp_path / "dataset")
    table = tmp_path / "dataset/samples.tsv"
    table.write_text(table.read_text().replace("fabrics", "cloths", 1))
    with pytest.raises(InputError, match=r"samples.tsv: lacks column fabrics; it has sample,"):
        plot_garments(tmp_path / "x.svg", tmp_path / "dataset")
    assert not (tmp_path / "x.svg").exists()


def test_garments_without_their_fabrics_are_refused(tmp_path, dataset):
    shutil.copytree(dataset.path, tmp_path / "dataset")
    table = tmp_path / "dataset/samples.tsv"
    table.write_text(table.read_text().replace("cotton+denim", "cotton", 1))
    with pytest.raises(InputError, match="expected one fabric for each garment"):
        plot_garments(tmp_path / "x.svg", tmp_path / "dataset")


def test_records_are_the_accepted_samples_in_order(dataset, rejected):
    assert [record.meta["id"] for record in accepted_records(dataset.path)] == [
        "00001", "00002", "00004"
    ]  # fmt: skip
    assert accepted_records(rejected.path) == []
