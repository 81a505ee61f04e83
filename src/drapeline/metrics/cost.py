"""What models take: time of a core and memory, in the table beside the metrics of an evaluation."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from drapeline.schema import Column, Schema, Table, make_table, read_table, write_table

COST_FILE = "cost.tsv"  # of an evaluation's folder
COSTS = Schema(
    "a table of costs",
    {
        "model": Column(),
        "variant": Column(),
        "seconds": Column(float, low=0, text=".4g"),
        "garments": Column(int, low=0),
        "megabytes": Column(float, low=0, text=".4g"),
    },
    key=("model", "variant"),
)


class Cost(NamedTuple):
    """What a variant takes."""

    # model, variant: as in a table of metrics.
    model: str
    variant: str
    seconds: float  # of a core, for a garment at rest or in a frame
    garments: int  # that it is the mean over
    megabytes: float  # most that the job had in memory so far, whatever it was for


def write_costs(folder: Path, costs: Iterable[Cost]) -> None:
    """Add the table to the folder of an evaluation."""
    table = make_table(COSTS, [one._asdict() for one in costs])
    write_table(folder / COST_FILE, table, COSTS)


def read_costs(folders: Sequence[str | Path]) -> Table:
    """The rows of all evaluations that have some.

    Raises:
        InputError: a table is unusable.
    """
    files = [Path(folder) / COST_FILE for folder in folders]
    found = [read_table(file, COSTS) for file in files if file.is_file()]
    return pd.concat([make_table(COSTS, []), *found], ignore_index=True)
