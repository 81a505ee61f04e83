import re
import shutil
import xml.etree.ElementTree as ElementTree

import pytest

from drapeline.dataset.collect import accepted_records
from drapeline.errors import InputError
from drapeline.report.dataset.statistics import (
    _TABLE_2,
    plot_actions,
    plot_bodies,
    plot_garments,
    plot_splits,
    plot_vertices,
    write_paper_tables,
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
        (plot_garments, ["Tshirt", "Skirt", "jersey", "denim", "Garments", "3"]),
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
    table.write_text(table.read_text().replace("jersey+denim", "jersey", 1))
    with pytest.raises(InputError, match="expected one fabric for each garment"):
        plot_garments(tmp_path / "x.svg", tmp_path / "dataset")


def test_records_are_the_accepted_samples_in_order(dataset, rejected):
    assert [record.meta["id"] for record in accepted_records(dataset.path)] == [
        "00001", "00002", "00004"
    ]  # fmt: skip
    assert accepted_records(rejected.path) == []


def test_the_papers_actions_add_up_to_all_frames():
    assert sum(_TABLE_2.values()) == pytest.approx(100, abs=0.6)


def test_their_numbers_are_marked_and_never_in_our_column(tmp_path, dataset):
    write_paper_tables(tmp_path / "x.html", dataset.path)
    text = (tmp_path / "x.html").read_text()
    assert '<td class="theirs">2.1M</td>' in text
    assert '<td class="number theirs">27.49 %</td>' in text
    assert "CLOTH3D, as printed" in text
    for number in ("2.1M", "7.2K", "~9.6K", "27.49 %", "33.36 %"):
        assert f"<td>{number}</td>" not in text
        assert f'<td class="number">{number}</td>' not in text


def test_our_numbers_are_those_of_the_dataset(tmp_path, dataset):
    write_paper_tables(tmp_path / "x.html", dataset.path)
    text = (tmp_path / "x.html").read_text()
    # "walk" is the paper's Walk, and all of our 18 frames.
    assert (
        '<td>Walk</td><td class="number">3</td><td class="number">18</td>'
        '<td class="number">100.00 %</td><td class="number theirs">27.49 %</td>' in text
    )
    assert "<td>Frames</td><td>18</td>" in text
    assert "<td>Colour images</td><td>✓</td>" in text
    assert "<td>Female to male</td><td>2:1</td>" in text


def test_an_empty_dataset_still_has_its_page(tmp_path, rejected):
    write_paper_tables(tmp_path / "x.html", rejected.path)
    text = (tmp_path / "x.html").read_text()
    assert "<td>Frames</td><td>0</td>" in text
    assert '<td>Walk</td><td class="number">-</td>' in text


def test_missing_tables_and_columns_are_named(tmp_path, dataset):
    with pytest.raises(InputError, match=r"statistics_overview.tsv: no such file"):
        write_paper_tables(tmp_path / "x.html", tmp_path)
    shutil.copytree(dataset.path, tmp_path / "dataset")
    table = tmp_path / "dataset/statistics_actions.tsv"
    table.write_text(table.read_text().replace("percent", "share"))
    with pytest.raises(InputError, match=r"statistics_actions.tsv: lacks column percent"):
        write_paper_tables(tmp_path / "x.html", tmp_path / "dataset")
