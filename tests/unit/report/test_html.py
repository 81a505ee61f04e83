from drapeline.report.html import Cell, html_table, write_page


def test_text_is_escaped(tmp_path):
    rows = [{"a<b": "<script>", "n": Cell("1 & 2", "number", "bad")}]
    write_page(tmp_path / "x.html", "A <title>", html_table(rows))
    text = (tmp_path / "x.html").read_text()
    assert "<h1>A &lt;title&gt;</h1>" in text
    assert "<td>&lt;script&gt;</td>" in text
    assert '<td class="number bad">1 &amp; 2</td>' in text
    assert '<th>a&lt;b</th><th class="number">n</th>' in text


def test_pages_need_no_network(tmp_path):
    write_page(tmp_path / "x.html", "Title", html_table([]))
    text = (tmp_path / "x.html").read_text()
    assert "http" not in text
    assert "<p>None.</p>" in text


def test_rows_may_lack_cells():
    table = html_table([{"a": "1"}, {"a": "2", "b": Cell("3", "number")}])
    assert "<td>1</td><td></td>" in table
    assert '<th class="number">b</th>' in table


def test_intervals_stand_below_their_numbers_and_other_brackets_behind():
    cells = ["4.3 [3.9, 4.8]", "3 of 4 (75 %)"]
    html = html_table([{"n": Cell(cell, "number")} for cell in cells])
    assert "4.3 <small>[3.9, 4.8]</small>" in html
    assert "3 of 4 (75 %)" in html


def test_rows_are_ordered_by_a_number_that_the_text_does_not_begin_with(tmp_path):
    html = html_table([{"time": Cell("1 min 5 s", "number", order=65.0)}, {"time": "none"}])
    assert '<td class="number" data-sort="65">1 min 5 s</td>' in html
    assert "<td>none</td>" in html
    write_page(tmp_path / "page.html", "Times", html)
    page = (tmp_path / "page.html").read_text()
    assert 'document.addEventListener("click"' in page  # the library that sorts
    assert "http" not in page
