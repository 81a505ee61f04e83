"""Statistics of a dataset: tables 1 and 2 of the CLOTH3D paper, and the garments."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from drapeline.dataset.record import SPLITS, SampleRecord

NO_ACTION = "Others"


def overview_table(records: Sequence[SampleRecord]) -> list[dict[str, Any]]:
    """Counts, sizes and resolution of the whole dataset and of each split (table 1).

    Args:
        records: the accepted samples.

    Returns:
        Rows with the columns "measure", "all" and one per split.
    """
    columns = {"all": list(records)}
    for split in SPLITS:
        columns[split] = [record for record in records if record.meta["split"] == split]
    measured = {name: _measures(part) for name, part in columns.items()}
    return [
        {"measure": measure, **{name: values[measure] for name, values in measured.items()}}
        for measure in measured["all"]
    ]


def _measures(records: Sequence[SampleRecord]) -> dict[str, str]:
    metas = [record.meta for record in records]
    garments = [garment for meta in metas for garment in meta["outfit"]["garments"]]
    sizes = [size for meta in metas for size in meta["garments"].values()]
    frames = [meta["motion"]["frames"] for meta in metas]
    genders = Counter(meta["body"]["gender"] for meta in metas)
    outfit_sizes = [sum(g["vertices"] for g in meta["garments"].values()) for meta in metas]
    return {
        "sequences": str(len(metas)),
        "frames": str(sum(frames)),
        "frames per sequence": _mean_range(frames, "{:.0f}"),
        "subjects (bodies)": str(len(metas)),
        "female": str(genders["female"]),
        "male": str(genders["male"]),
        "motion clips": str(len({meta["motion"]["source"] for meta in metas})),
        "motion subjects": str(len({meta["motion"]["subject"] for meta in metas})),
        "actions": str(len({meta["motion"]["action"] for meta in metas})),
        "garments": str(len(garments)),
        "garment types": str(len({garment["name"] for garment in garments})),
        "fabrics": str(len({garment["fabric"] for garment in garments})),
        "layered outfits": str(sum(len(meta["garments"]) > 1 for meta in metas)),
        "vertices per garment": _mean_range([size["vertices"] for size in sizes], "{:.0f}"),
        "vertices per outfit": _mean_range(outfit_sizes, "{:.0f}"),
        "edge length (mm)": _mean_range([1000 * size["edge_m"] for size in sizes], "{:.1f}"),
        "megabytes per sequence": _mean_range([r.cloth3d_bytes / 1e6 for r in records], "{:.2f}"),
        "megabytes, extras included": f"{sum(r.total_bytes for r in records) / 1e6:.1f}",
    }


def _mean_range(values: Sequence[float], template: str) -> str:
    """Format the mean and, if the values differ, their range; "-" if there are none."""
    if not values:
        return "-"
    mean, low, high = (
        template.format(value) for value in (np.mean(values), min(values), max(values))
    )
    return mean if low == high else f"{mean} ({low} to {high})"


def action_table(records: Sequence[SampleRecord]) -> list[dict[str, Any]]:
    """Share of the frames by action label, largest first (table 2)."""
    frames: Counter[str] = Counter()
    sequences: Counter[str] = Counter()
    for record in records:
        action = record.meta["motion"]["action"] or NO_ACTION
        frames[action] += record.meta["motion"]["frames"]
        sequences[action] += 1
    total = sum(frames.values())
    return [
        {
            "action": action,
            "sequences": sequences[action],
            "frames": count,
            "percent": f"{100 * count / total:.2f}",
        }
        for action, count in sorted(frames.items(), key=lambda item: (-item[1], item[0]))
    ]


def garment_table(records: Sequence[SampleRecord]) -> list[dict[str, Any]]:
    """Number of garments of each type, by fabric and by gender, and their vertex counts."""
    garments = [
        (garment["name"], garment["fabric"], record.meta)
        for record in records
        for garment in record.meta["outfit"]["garments"]
    ]
    fabrics = sorted({fabric for _, fabric, _ in garments})
    rows = []
    for name in sorted({name for name, _, _ in garments}):
        of_type = [(fabric, meta) for other, fabric, meta in garments if other == name]
        vertices = [meta["garments"][name]["vertices"] for _, meta in of_type]
        rows.append(
            {
                "garment": name,
                "count": len(of_type),
                **{f: sum(fabric == f for fabric, _ in of_type) for f in fabrics},
                "female": sum(meta["body"]["gender"] == "female" for _, meta in of_type),
                "male": sum(meta["body"]["gender"] == "male" for _, meta in of_type),
                "vertices": _mean_range(vertices, "{:.0f}"),
            }
        )
    return rows
