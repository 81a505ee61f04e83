"""What the history of a finished training says."""

from pathlib import Path


def column(folder: Path, name: str) -> list[float]:
    """A column of the history, a number per epoch."""
    header, *rows = (folder / "history.tsv").read_text().splitlines()
    place = header.split("\t").index(name)
    return [float(row.split("\t")[place]) for row in rows]
