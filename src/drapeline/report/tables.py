"""Tables of metrics, and pages that are lists of sections."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from drapeline.metrics.metric import LARGER
from drapeline.metrics.registry import metric, variant
from drapeline.metrics.shared import TRAINING_ERROR
from drapeline.metrics.table import ALL, read_metrics, with_intervals
from drapeline.outfits.garment_types import GARMENTS
from drapeline.report.html import Cell, html_table, number, write_page
from drapeline.schema import Column, Schema, Table, make_table, write_table

MEAN_OF_TYPES = "Mean of types"
Rows = Sequence[Mapping[str, object]]
_HEADINGS = {"variant": "Model", "garment": "Garment", "metric": "Measure", "source": "Samples"}
_PRINTED = Schema(
    "numbers that a paper prints",
    {
        "model": Column(),
        "variant": Column(),
        "garment": Column(),
        "metric": Column(),
        "value": Column(float, text=".5g"),
    },
    key=("model", "variant", "garment", "metric"),
)
BESIDE_PAPER = Schema(
    "numbers of ours beside a paper's",
    {
        "table": Column(),
        **{name: _PRINTED.columns[name] for name in _PRINTED.key},
        "ours": Column(float, optional=True, text=".5g"),
        "theirs": Column(float, text=".5g"),
    },
)


def read_test_metrics(path: str | Path, models: Sequence[str] = ()) -> Table:
    """The test split of a table of metrics, a row for each value with its interval.

    Of the training split, surface errors are there as well, as a metric of their own.

    Args:
        models: the rows' models; by default all.

    Raises:
        InputError: the table is missing or unusable.
    """
    table = with_intervals(read_metrics(path))
    learned = table[(table["split"] == "train") & (table["metric"] == "surface_error_mm")]
    table = pd.concat([table[table["split"] == "test"], learned.assign(metric=TRAINING_ERROR)])
    return table[table["model"].isin(models)] if models else table


def printed(model: str, values: Mapping[tuple[str, str], Mapping[str, float | None]]) -> Table:
    """Numbers of a paper, given (variant, garment) -> metric -> value, or None."""
    rows = (
        {"model": model, "variant": name, "garment": garment, "metric": key, "value": value}
        for (name, garment), numbers in values.items()
        for key, value in numbers.items()
        if value is not None
    )
    return make_table(_PRINTED, rows)


def garment_title(name: str) -> str:
    """A garment type, a class of garments or a cloth solver as it is written in tables."""
    return "T-shirt" if name == "Tshirt" else name.capitalize()


def with_mean_of_types(measured: Table) -> Table:
    """The same with means over garment types, which all weigh the same, without intervals."""
    types = measured[measured["garment"].isin(GARMENTS)]
    key = ["model", "variant", "split", "metric", "unit", "seed", "source"]
    means = types.groupby(key, as_index=False, sort=False).agg({"value": "mean", "n": "sum"})
    return pd.concat([measured, means.assign(garment=MEAN_OF_TYPES)], ignore_index=True)


@dataclass(frozen=True)
class MetricTable:
    """A table of metrics: its rows and columns, and what it marks.

    A paper's numbers stand in columns of their own, named and shaded as theirs. The best number of
    a column is green, or bold in Markdown, where two or more compete.
    """

    # Of the rows, in order; a name that ends in `*` stands for all that begin like it, by rising
    # number.
    variants: Sequence[str]
    metrics: Sequence[str]
    garments: Sequence[str] = (ALL,)  # likewise; "all" for all types together
    # What the rows are: of "variant", "garment", "metric" and "source".
    down: Sequence[str] = ("variant",)
    # What the columns are: "metric", "garment" or "source", which is the cloth solver.
    across: str = "metric"
    best: bool = True  # whether the best are marked
    digits: Mapping[str, int] = field(default_factory=dict)  # metric -> digits in place of its own
    # Heading of the number of garments, frames or sequences; nothing for none.
    count: str = "Garments"
    printed: Table | None = None  # a paper's numbers
    paper: str = ""  # its name

    def rows(self, measured: Table) -> list[dict[str, object]]:
        """Rows of cells, for `html_table` or `markdown_table`."""
        ours = self._chosen(measured)
        ours = ours.assign(leads=_leaders(ours) if self.best else False)
        theirs = ours.iloc[:0] if self.printed is None else self._chosen(self.printed)
        every = pd.concat([ours.assign(theirs=False), theirs.assign(theirs=True)])
        every = every.astype({name: ours[name].dtype for name in _HEADINGS})
        shown = {
            whose: [name for name in every[self.across].cat.categories if name in set(part)]
            for whose, part in every.groupby("theirs")[self.across]
        }
        named = every[["model", "variant"]].drop_duplicates()
        grouped = any(variant(*key).group for key in named.itertuples(index=False))
        return [
            {
                **self._titles(dict(zip(self.down, key, strict=True)), part, grouped),
                **self._numbers(part[~part["theirs"]], shown.get(False, [])),
                **self._printed_numbers(part[part["theirs"]], shown.get(True, [])),
            }
            for key, part in every.groupby(list(self.down), observed=True)
        ]

    @property
    def _names(self) -> dict[str, Sequence[str]]:
        return {"variant": self.variants, "garment": self.garments, "metric": self.metrics}

    def _chosen(self, table: Table) -> Table:
        """The rows that are shown, with names in the order of the table's rows and columns."""
        names = self._names | {"variant": _matching(self.variants, table["variant"])}
        if "source" in table:
            by_source = "source" in (*self.down, self.across)
            table = table[(table["source"] != "") == by_source]
            names["source"] = sorted(table["source"])
        for column, order in names.items():
            table = table[table[column].isin(order)]
        orders = {column: list(dict.fromkeys(order)) for column, order in names.items()}
        return table.assign(
            **{name: pd.Categorical(table[name], order) for name, order in orders.items()}
        )

    def _titles(self, key: Mapping[str, str], part: Table, grouped: bool) -> dict[str, object]:
        titles: dict[str, object] = {}
        for name, value in key.items():
            if name == "variant":
                shown = variant(part["model"].iloc[0], value)
                titles |= {"Group": shown.group} if grouped else {}
                titles[_HEADINGS[name]] = shown.title
            else:
                titles[_HEADINGS[name]] = self._title(name, value)
        return titles

    def _title(self, name: str, value: str) -> str:
        if name == "metric":
            return metric(value).heading
        return garment_title(value)

    def _numbers(self, part: Table, shown: Sequence[str]) -> dict[str, object]:
        cells: dict[str, object] = {}
        measured = {getattr(row, self.across): row for row in part.itertuples()}
        for name in shown:
            row = measured.get(name)
            cells[self._title(self.across, name)] = self._cell(row) if row else number("-")
        if self.count:
            counts = {name: int(row.n) for name, row in measured.items() if name != TRAINING_ERROR}
            cells[self.count] = number(self._count(counts, shown))
        return cells

    def _count(self, counts: Mapping[str, int], shown: Sequence[str]) -> str:
        """Over how many garments a row's means are: of all types, or of each column."""
        if not counts:
            return "-"
        apart = [str(counts.get(name, "-")) for name in shown]
        if self.across == "metric" or ALL in counts or len(set(apart)) == 1:
            return str(counts.get(ALL, max(counts.values())))
        return " / ".join(apart)

    def _cell(self, row: Any) -> Cell:
        shown = metric(row.metric)
        shown = shown._replace(digits=self.digits.get(row.metric, shown.digits))
        ends = [] if pd.isna(row.low) or pd.isna(row.high) else [row.low, row.high]
        return number(shown.text(row.value, *ends), *(["good"] if row.leads else []))

    def _printed_numbers(self, part: Table, shown: Sequence[str]) -> dict[str, object]:
        texts = {getattr(row, self.across): f"{row.value:g}" for row in part.itertuples()}
        return {
            f"{self._title(self.across, name)}, {self.paper}": number(
                texts.get(name, "-"), "theirs"
            )
            for name in shown
        }


class Section(NamedTuple):
    """A part of a page."""

    title: str
    table: MetricTable | Rows
    about: str = ""  # paragraph between heading and table
    below: str = ""  # paragraph below the table
    by_source: bool = False  # whether the samples of each cloth solver have a table as well

    def html(self, measured: Table | None = None) -> str:
        """Heading, paragraphs and tables; a `MetricTable` shows what was measured."""
        parts = [f"<h2>{self.title}</h2>", f"<p>{self.about}</p>" if self.about else ""]
        shown = self.table
        parts.append(html_table(shown.rows(measured) if isinstance(shown, MetricTable) else shown))
        if self.by_source and isinstance(shown, MetricTable) and measured is not None:
            alone = replace(shown, printed=None)
            for source in sorted(set(measured["source"]) - {""}):
                rows = alone.rows(measured[measured["source"] == source].assign(source=""))
                if rows:
                    parts += [f"<h3>On the samples of {source} alone</h3>", html_table(rows)]
        parts.append(f"<p>{self.below}</p>" if self.below else "")
        return "\n".join(filter(None, parts))


def write_sections(
    path: str | Path,
    title: str,
    about: Iterable[str],
    sections: Iterable[Section],
    measured: Table | None = None,
) -> None:
    """Write a page: paragraphs, then sections of what `read_test_metrics` has read."""
    paragraphs = (f"<p>{text}</p>" for text in about)
    write_page(path, title, *paragraphs, *(section.html(measured) for section in sections))


def write_beside_paper(path: str | Path, measured: Table, tables: Mapping[str, Table]) -> None:
    """Write our numbers and a paper's in two columns.

    Args:
        path: the `.tsv`.
        measured: rows of the test split, see `read_test_metrics`.
        tables: number of the paper's table -> what it prints.
    """
    key = list(_PRINTED.key)
    ours = measured[measured["source"] == ""].rename(columns={"value": "ours"})[[*key, "ours"]]
    theirs = pd.concat([table.assign(table=name) for name, table in tables.items()])
    both = theirs.rename(columns={"value": "theirs"}).merge(ours, "left", key)
    write_table(path, both[list(BESIDE_PAPER.columns)], BESIDE_PAPER)


_NUMBER = re.compile(r"\d+(\.\d+)?")


def _matching(names: Sequence[str], found: pd.Series) -> list[str]:
    """Names, where those with `*` for a number are replaced by what is found, by rising number."""
    every = []
    for name in names:
        start = name.removesuffix("*")
        if start == name:
            every.append(name)
            continue
        numbers = {one.removeprefix(start) for one in set(found) if one.startswith(start)}
        every += [start + text for text in sorted(filter(_NUMBER.fullmatch, numbers), key=float)]
    return every


def _leaders(chosen: Table) -> pd.Series:
    """Whether each row is the best of its column and group, of two or more that compete."""
    titled = [variant(*key) for key in zip(chosen["model"], chosen["variant"], strict=True)]
    better = chosen["metric"].astype(object).map(lambda name: metric(name).better)
    rank = chosen["value"].where(better != LARGER, -chosen["value"])
    competes = np.array([each.competes for each in titled], dtype=bool)
    rank = rank.where(competes & (better != "").to_numpy())
    groups = pd.Series([each.group for each in titled], index=chosen.index, dtype=object)
    by = [chosen["metric"], chosen["garment"], chosen["source"], groups]
    best = rank.eq(rank.groupby(by, observed=True).transform("min"))
    compete = rank.groupby(by, observed=True).transform("count")
    # Where most are alike, as shares of zero are, none leads.
    return best & (2 * best.groupby(by, observed=True).transform("sum") <= compete)
