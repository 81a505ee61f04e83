"""How well cloth moved, in words and numbers."""

from collections.abc import Mapping

# Measure of `health.summary` -> what it is called, and its form; metres are shown as millimetres.
_MM = "{:.1f} mm"
_ROWS = {
    "inside_share_mean": ("vertices inside the body", "{:.2%}"),
    "inside_open_mean": ("of these, not in its folds", "{:.2%}"),
    "depth_m": ("depth there (95th percentile)", _MM),
    "self_crossings_max": ("edges through the garment itself (worst frame)", "{:.0f}"),
    "layer_crossings_max": ("edges through another garment (worst frame)", "{:.0f}"),
    "stretch_low": ("shortest 1 % of edges, of their rest", "{:.0%}"),
    "stretch_high": ("longest 1 % of edges, of their rest", "{:.0%}"),
    "slip_m": ("slip along the body", _MM),
    "lost_openings": ("openings that lost their limb (mean of frames)", "{:.1f}"),
    "acceleration_m_s2": ("mean acceleration", "{:.1f} m/s2"),
}


def health_lines(measures: Mapping[str, Mapping[str, float]]) -> list[str]:
    """A table: a line for each measure that there is, a column for each name."""
    rows = [["", *measures]]
    for key, (words, form) in _ROWS.items():
        cells = [_cell(one[key], form) if key in one else "" for one in measures.values()]
        if any(cells):
            rows.append([words, *cells])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join([first.ljust(widths[0]), *map(str.rjust, cells, widths[1:])]).rstrip()
        for first, *cells in rows
    ]


def _cell(value: float, form: str) -> str:
    return form.format(1e3 * value if form == _MM else value)
