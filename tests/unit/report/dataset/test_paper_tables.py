import shutil

import pytest

from drapeline.errors import InputError
from drapeline.report.dataset.paper_tables import _TABLE_2, write_paper_tables


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
