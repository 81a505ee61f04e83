"""Schemas of the tables of a collected dataset."""

from drapeline.dataset.record import SPLITS
from drapeline.schema import Column, Schema

_COUNT = Column(int, low=0)
_SPLIT = Column(allowed=SPLITS)
STATUS = Schema(
    "a table of all samples",
    {
        "sample": Column(),
        "status": Column(),
        "reason": Column(),
        "attempts": _COUNT,
        "split": _SPLIT,
        "sequence": Column(),
        "garments": Column(),
        "self_collision": Column(),
        "thinned": _COUNT,
        "redrawn": _COUNT,
        "removed_segments": Column(),
    },
    key=("sample",),
)
# The mean and the worst value of each measure of health follow.
SAMPLES = Schema(
    "a table of accepted samples",
    {
        "sample": Column(),
        "split": _SPLIT,
        "gender": Column(allowed=("female", "male")),
        "garments": Column(),
        "fabrics": Column(),
        "action": Column(),
        "sequence": Column(),
        "subject": Column(),
        "source": Column(),
        "frames": _COUNT,
        "vertices": _COUNT,
        "floor_penetration_m": Column(float, text=".4f"),
        "contact_sliding_m_s": Column(float, text=".4f"),
        "longest_hover_s": Column(float, text=".3f"),
        "possible_flight_s": Column(float, text=".3f"),
        "body_overlap_share": Column(float, text=".5f"),
        "body_overlap_depth_m": Column(float, text=".4f"),
        "megabytes": Column(float, text=".2f"),
        "megabytes_with_extras": Column(float, text=".2f"),
    },
    key=("sample",),
    more=True,
)
OVERVIEW = Schema(
    "an overview of a dataset",
    {"measure": Column(), "all": Column(), **{split: Column() for split in SPLITS}},
    key=("measure",),
)
ACTIONS = Schema(
    "a table of actions",
    {
        "action": Column(),
        "sequences": _COUNT,
        "frames": _COUNT,
        "percent": Column(float, text=".2f"),
    },
    key=("action",),
)
# Counts by fabric stand beside these.
GARMENTS_WORN = Schema(
    "a table of garments",
    {"garment": Column(), "count": _COUNT, "female": _COUNT, "male": _COUNT, "vertices": Column()},
    key=("garment",),
    more=True,
)
