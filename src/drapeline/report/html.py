"""Small self-contained HTML pages with tables."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from drapeline.storage import atomic_file

_STYLE = """
body { font: 15px/1.5 system-ui, "DejaVu Sans", Arial, sans-serif; color: #222; background: #fff;
  margin: 2rem auto; padding: 0 1.5rem; max-width: 72rem; }
h1 { font-size: 1.5rem; margin: 0 0 .3rem; } h2 { font-size: 1.1rem; margin: 2rem 0 .4rem; }
p { max-width: 46rem; color: #444; margin: .3rem 0 .8rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .87rem; font-variant-numeric: tabular-nums; }
th, td { padding: .32rem .8rem .32rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid #e3e5e8; }
th { font-weight: 600; border-bottom: 2px solid #6b6f76; vertical-align: bottom; }
td.number, th.number { text-align: right; } td.number { white-space: nowrap; }
tr:hover td { background: #f4f7fa; }
td.good { color: #00694d; } td.bad { color: #b03a00; font-weight: 600; }
.theirs { background: #f6f3ea; } td.theirs, th.theirs { padding-left: .8rem; }
small { color: #6b6f76; font-weight: 400; }
""".strip()


class Cell(str):
    """A table cell's text with CSS classes: `number`, `good`, `bad`, `theirs`."""

    __slots__ = ("classes",)

    def __new__(cls, text: object, *classes: str) -> "Cell":
        """Make a text that knows its classes."""
        cell = super().__new__(cls, text)
        cell.classes = classes
        return cell


def html_table(rows: Sequence[Mapping[str, object]]) -> str:
    """Rows as an HTML table, with the columns of all rows in order of appearance.

    A heading has those of the classes `number` and `theirs` that its column's first cell has.
    """
    if not rows:
        return "<p>None.</p>"
    columns = list(dict.fromkeys(column for row in rows for column in row))
    first = {c: next(row[c] for row in rows if c in row) for c in columns}
    head = "".join(
        f"<th{_classes(first[column], heading=True)}>{escape(column)}</th>" for column in columns
    )
    body = "\n".join(
        "<tr>"
        + "".join(
            f"<td{_classes(row.get(c, ''))}>{escape(str(row.get(c, '')))}</td>" for c in columns
        )
        + "</tr>"
        for row in rows
    )
    return (
        '<div class="wide"><table>\n<thead><tr>'
        f"{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>"
    )


def _classes(cell: object, heading: bool = False) -> str:
    names = cell.classes if isinstance(cell, Cell) else ()
    if heading:
        names = [name for name in names if name in {"number", "theirs"}]
    return f' class="{" ".join(names)}"' if names else ""


def write_page(path: str | Path, title: str, *parts: str) -> None:
    """Write a page: a title and parts in HTML."""
    text = (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{_STYLE}\n</style></head>\n"
        f"<body>\n<h1>{escape(title)}</h1>\n" + "\n".join(parts) + "\n</body></html>\n"
    )
    with atomic_file(path) as scratch:
        scratch.write_text(text)
