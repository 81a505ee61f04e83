"""How figures are saved."""

import re

from PIL import Image

from drapeline.report.style import label_bar, place_legend_above, saved_figure, show_message


def draw(path):
    with saved_figure(path, width_in=4.0, height_in=3.0) as (_, (axes,)):
        axes.barh([0], [2.0], label="bars")
        label_bar(axes, 2.0, 0, "two")
        place_legend_above(axes)


def test_equal_figures_are_equal_files_whose_text_is_text(tmp_path):
    for name in ("a.svg", "b.svg", "c.png"):
        draw(tmp_path / name)
    text = (tmp_path / "a.svg").read_text()
    assert text == (tmp_path / "b.svg").read_text()
    assert {"two", "bars"} <= set(re.findall(r"<text[^>]*>([^<]*)</text>", text))
    with Image.open(tmp_path / "c.png") as image:
        assert image.size == (640, 480)


def test_a_figure_that_fails_leaves_no_file(tmp_path):
    try:
        with saved_figure(tmp_path / "a.svg"):
            raise KeyError
    except KeyError:
        assert not list(tmp_path.iterdir())


def test_an_empty_plot_says_why_and_has_no_axes(tmp_path):
    with saved_figure(tmp_path / "a.svg") as (_, (axes,)):
        show_message(axes, "Nothing yet")
        assert not axes.axison
    assert "Nothing yet" in (tmp_path / "a.svg").read_text()


def test_dollars_and_braces_of_a_name_are_text(tmp_path):
    with saved_figure(tmp_path / "a.svg") as (_, (axes,)):
        axes.barh(["$$ walk $\\x$"], [1.0])
    assert "$$ walk $\\x$" in (tmp_path / "a.svg").read_text()
