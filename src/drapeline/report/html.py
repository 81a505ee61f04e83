"""Small self-contained HTML pages with tables that can be sorted and filtered."""

import re
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from drapeline.storage import atomic_file

_STYLE = """
body { font: 15px/1.5 system-ui, "DejaVu Sans", Arial, sans-serif; color: #222; background: #fff;
  margin: 2rem auto; padding: 0 1.5rem; max-width: 84rem; }
h1 { font-size: 1.5rem; margin: 0 0 .3rem; } h2 { font-size: 1.1rem; margin: 2rem 0 .4rem; }
p { max-width: 46rem; color: #444; margin: .3rem 0 .8rem; }
.wide { overflow-x: auto; }
input[type=search] { font: inherit; font-size: .87rem; padding: .2rem .5rem; width: 14rem; }
table { border-collapse: collapse; font-size: .87rem; font-variant-numeric: tabular-nums; }
th, td { padding: .32rem .8rem .32rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid #e3e5e8; }
th { font-weight: 600; border-bottom: 2px solid #6b6f76; vertical-align: bottom; cursor: pointer; }
th[aria-sort=ascending]::after { content: " \\25B4"; }
th[aria-sort=descending]::after { content: " \\25BE"; }
table.many { font-size: .77rem; } table.many :is(th, td) { padding-right: .15rem; }
table.many th { font-size: .7rem; letter-spacing: -.035em; }
table.many .theirs { padding-left: .1rem; }
td:first-child { min-width: 5rem; max-width: 22rem; }
table.many td:first-child { min-width: 5rem; }
td.number, th.number { text-align: right; }
tr:hover td { background: #f4f7fa; }
td.good { color: #00694d; } td.bad { color: #b03a00; font-weight: 600; }
.theirs { background: #f6f3ea; } td.theirs, th.theirs { padding-left: .8rem; }
small { color: #6b6f76; font-weight: 400; } td.number small { display: block; }
""".strip()
# Rows are sorted by the numbers that cells begin with. Tables of many rows get a field above them
# that hides the rows without its text.
_TABLES = """
for (const cell of document.querySelectorAll("td.number:not([data-sort])"))
  cell.dataset.sort = (cell.textContent.match(/-?\\d[\\d.]*/) ?? [""])[0];
for (const table of document.querySelectorAll("table")) {
  if (table.tBodies[0].rows.length < 10) continue;
  const field = document.createElement("input");
  Object.assign(field, { type: "search", placeholder: "Filter rows", ariaLabel: "Filter rows" });
  field.addEventListener("input", () => {
    const wanted = field.value.toLowerCase();
    for (const row of table.tBodies[0].rows)
      row.hidden = !row.textContent.toLowerCase().includes(wanted);
  });
  table.parentNode.before(field);
}
""".strip()


_MANY_COLUMNS = 11  # from which on the cells of a table are smaller, so that it fits a window
_INTERVAL = re.compile(r" (\[[^\]]*\])$")


class Cell(str):
    """A table cell's text with CSS classes: `number`, `good`, `bad`, `theirs`.

    Attributes:
        classes: of CSS.
        order: what rows are sorted by, if that is not the number that the text begins with.
    """

    __slots__ = ("classes", "order")

    classes: tuple[str, ...]
    order: float | None

    def __new__(cls, text: object, *classes: str, order: float | None = None) -> "Cell":
        """Make a text that knows its classes."""
        cell = super().__new__(cls, text)
        cell.classes = classes
        cell.order = order
        return cell


def number(text: object, *classes: str, order: float | None = None) -> Cell:
    """A cell of the class `number`, whose texts stand below one another."""
    return Cell(text, "number", *classes, order=order)


def html_table(rows: Sequence[Mapping[str, object]]) -> str:
    """Rows as an HTML table, with the columns of all rows in order of appearance.

    A heading has those of the classes `number` and `theirs` that its column's first cell has. An
    interval in brackets stands below its number.
    """
    if not rows:
        return "<p>None.</p>"
    columns = list(dict.fromkeys(column for row in rows for column in row))
    first = {c: next(row[c] for row in rows if c in row) for c in columns}
    head = "".join(
        f"<th{_classes(first[column], heading=True)}>{_heading(column)}</th>" for column in columns
    )
    body = "\n".join(
        f"<tr>{''.join(_data(row.get(column, '')) for column in columns)}</tr>" for row in rows
    )
    classes = "sortable asc n-last" + (" many" if len(columns) >= _MANY_COLUMNS else "")
    return (
        f'<div class="wide"><table class="{classes}">\n<thead><tr>'
        f"{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>"
    )


def _heading(text: str) -> str:
    """Escaped; it does not break at a hyphen, as in "T-shirt"."""
    return escape(text).replace("-", "&#8209;")


def _data(cell: object) -> str:
    text, order = escape(str(cell)), ""
    if isinstance(cell, Cell) and "number" in cell.classes:
        text = _INTERVAL.sub(r" <small>\1</small>", text)
        order = "" if cell.order is None else f' data-sort="{cell.order:g}"'
    return f"<td{_classes(cell)}{order}>{text}</td>"


def _classes(cell: object, heading: bool = False) -> str:
    names = list(cell.classes) if isinstance(cell, Cell) else []
    if heading:
        names = [name for name in names if name in {"number", "theirs"}]
    return f' class="{" ".join(names)}"' if names else ""


def write_page(path: str | Path, title: str, *parts: str) -> None:
    """Write a page: a title and parts in HTML."""
    sorting = files("drapeline.report") / "vendor" / "sortable.min.js"
    text = (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{_STYLE}\n</style></head>\n"
        f"<body>\n<h1>{escape(title)}</h1>\n" + "\n".join(parts) + "\n"
        f"<script>\n{sorting.read_text()}{_TABLES}\n</script>\n</body></html>\n"
    )
    with atomic_file(path) as scratch:
        scratch.write_text(text)
