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
