"""Tables 1 and 2 of the CLOTH3D paper beside the same counts of our data.

The paper's numbers describe other data: they are marked and stand in a column of their own.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from drapeline.dataset.statistics import NO_ACTION
from drapeline.dataset.tables import read_table
from drapeline.report.html import Cell, html_table, write_page

OURS = "This dataset"
THEIRS = "CLOTH3D, as printed"

# Bertiche, Madadi and Escalera, CLOTH3D: Clothed 3D Humans, ECCV 2020.
_TABLE_1 = {
    "Res.": "1cm",
    "Missing": "x",
    "Dyn.": "✓",
    "Garments": "~9.6K",
    "Fabrics": "✓",
    "Poses": "High",
    "Subjects": "7.2K",
    "Layered": "✓",
    "#frames": "2.1M",
    "Type": "Synth.",
    "RGB": "x",
    "GT error": "None",
}
_TEXT = {
    "Sequences": "over 7000",
    "Female to male": "2:1",
    "Vertices per outfit": "around 20K",
    "Megabytes per sequence": "35 to 40",
    "Training : test": "80 : 20",
}
_TABLE_2 = {
    "Walk": 27.49, "Animal": 10.79, "Fight": 4.38, "Jump": 2.78, "Run": 2.49, "Sing": 2.38,
    "Wait": 2.31, "Swim": 1.97, "Story": 1.70, "Sports": 1.63, "Dance": 1.37, "Yoga": 1.01,
    "Spin": 0.90, "Exercise": 0.84, "Climb": 0.71, "Carry": 0.67, "Stand": 0.66, "Wash": 0.63,
    "Balancing": 0.54, "Trick": 0.51, "Sit": 0.28, "Interact": 0.20, "Drink": 0.14, "Pose": 0.14,
    "Bend": 0.12, "Others": 33.36,
}  # fmt: skip


def write_paper_tables(path: str | Path, dataset: str | Path) -> None:
    """Write the page with tables 1 and 2.

    Args:
        path: the HTML page.
        dataset: folder of a collected dataset.

    Raises:
        InputError: the dataset's statistics are missing or lack a column.
    """
    dataset = Path(dataset)
    overview = read_table(
        dataset / "statistics_overview.tsv", ("measure", "all", "train", "val", "test")
    )
    actions = read_table(
        dataset / "statistics_actions.tsv", ("action", "sequences", "frames", "percent")
    )
    write_page(
        path,
        "Tables 1 and 2 of CLOTH3D, for this dataset",
        "<p>Shaded columns hold the numbers that the paper prints for its own dataset. They say how"
        " large and varied the original is; they are not a target, and nothing here was computed"
        " from its data.</p>",
        "<h2>Table 1: what the dataset holds</h2>",
        html_table(_table_1({row["measure"]: row for row in overview})),
        "<h2>More of this dataset, by split</h2>",
        html_table([_numbers(row) for row in overview]),
        "<h2>Table 2: share of the frames per action label</h2>",
        "<p>Labels follow the paper's where the motion is the same; a dash means that the dataset"
        " has no such label.</p>",
        html_table(_table_2(actions)),
    )


def _table_1(measures: Mapping[str, Mapping[str, str]]) -> list[dict[str, str]]:
    def ours(measure: str) -> str:
        return measures.get(measure, {}).get("all", "-")

    def split(name: str) -> str:
        return measures.get("sequences", {}).get(name, "-")

    frames = int(ours("frames")) if ours("frames").isdigit() else 0
    mine = {
        "Res.": f"{ours('edge length (mm)')} mm",
        "Missing": "x",
        "Dyn.": "✓",
        "Garments": f"{ours('garments')} of {ours('garment types')} types",
        "Fabrics": f"✓ ({ours('fabrics')})",
        "Poses": f"{ours('actions')} actions of {ours('motion clips')} clips",
        "Subjects": ours("subjects (bodies)"),
        "Layered": f"✓ ({ours('layered outfits')} of {ours('sequences')} outfits)",
        "#frames": f"{frames:,}",
        "Type": "Synth.",
        "RGB": "✓",
        "GT error": "None",
        "Sequences": ours("sequences"),
        "Female to male": f"{ours('female')}:{ours('male')}",
        "Vertices per outfit": ours("vertices per outfit"),
        "Megabytes per sequence": ours("megabytes per sequence"),
        "Training : test": f"{split('train')} : {split('val')} (validation) : {split('test')}",
    }
    meaning = {
        "Res.": "Resolution (mean edge length)",
        "Missing": "Missing data",
        "Dyn.": "Dynamics",
        "Garments": "Garments",
        "Fabrics": "Fabrics known",
        "Poses": "Variety of poses",
        "Subjects": "Subjects (body shapes)",
        "Layered": "Layered garments",
        "#frames": "Frames",
        "Type": "Origin",
        "RGB": "Colour images",
        "GT error": "Error of the ground truth",
    }
    return [
        {
            "Feature": meaning.get(key, key),
            OURS: mine[key],
            THEIRS: Cell(value, "theirs"),
            "Where": Cell("table 1" if key in _TABLE_1 else "text", "theirs"),
        }
        for key, value in {**_TABLE_1, **_TEXT}.items()
    ]


def _table_2(actions: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """Our labels first, the largest on top, then the paper's that we lack."""
    mine = {row["action"].capitalize(): row for row in actions}
    labels = [*mine, *(label for label in _TABLE_2 if label not in mine)]
    labels.sort(key=lambda label: label == NO_ACTION)  # what is left over comes last
    return [
        {
            "Action": label,
            "Sequences": Cell(mine[label]["sequences"] if label in mine else "-", "number"),
            "Frames": Cell(mine[label]["frames"] if label in mine else "-", "number"),
            OURS: Cell(_percent(mine[label]["percent"]) if label in mine else "-", "number"),
            THEIRS: Cell(
                _percent(_TABLE_2[label]) if label in _TABLE_2 else "-", "number", "theirs"
            ),
        }
        for label in labels
    ]


def _percent(value: str | float) -> str:
    return f"{float(value):.2f} %"


def _numbers(row: Mapping[str, str]) -> dict[str, str]:
    named = {"measure": "Measure", "all": "All", "train": "Train", "val": "Val", "test": "Test"}
    return {
        label: row[key] if key == "measure" else Cell(row[key], "number")
        for key, label in named.items()
    }
