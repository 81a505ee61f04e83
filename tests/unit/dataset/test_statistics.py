from pathlib import Path

from drapeline.dataset.record import SampleRecord
from drapeline.dataset.statistics import action_table, garment_table, overview_table


def record(split="train", gender="female", action="walk", frames=10, **vertices):
    """A record whose garments are given as name=(fabric, vertices)."""
    meta = {
        "split": split,
        "body": {"gender": gender},
        "motion": {"source": f"{action}.bvh", "subject": "01", "action": action, "frames": frames},
        "outfit": {"garments": [{"name": n, "fabric": f} for n, (f, _) in vertices.items()]},
        "garments": {n: {"vertices": v, "edge_m": 0.02} for n, (_, v) in vertices.items()},
    }
    return SampleRecord(Path(), meta, cloth3d_bytes=2_000_000, total_bytes=3_000_000)


RECORDS = [
    record(action="run", frames=30, Tshirt=("cotton", 400), Skirt=("denim", 600)),
    record(gender="male", Tshirt=("silk", 500)),
    record(split="test", action="", frames=20, Dress=("cotton", 900)),
]


def test_the_overview_has_a_column_for_all_and_for_each_split():
    rows = {row.pop("measure"): row for row in overview_table(RECORDS)}
    assert rows["sequences"] == {"all": "3", "train": "2", "val": "0", "test": "1"}
    assert rows["frames"] == {"all": "60", "train": "40", "val": "0", "test": "20"}
    assert rows["frames per sequence"]["train"] == "20 (10 to 30)"
    assert rows["female"] == {"all": "2", "train": "1", "val": "0", "test": "1"}
    assert rows["motion clips"]["all"] == "3"
    assert rows["garments"]["all"] == "4"
    assert rows["garment types"]["train"] == "2"
    assert rows["layered outfits"]["all"] == "1"
    assert rows["vertices per outfit"] == {
        "all": "800 (500 to 1000)", "train": "750 (500 to 1000)", "val": "-", "test": "900"
    }  # fmt: skip
    assert rows["edge length (mm)"]["train"] == "20.0"
    assert rows["megabytes per sequence"]["all"] == "2.00"
    assert rows["megabytes, extras included"]["train"] == "6.0"


def test_actions_are_sorted_by_their_share_of_the_frames():
    assert action_table(RECORDS) == [
        {"action": "run", "sequences": 1, "frames": 30, "percent": "50.00"},
        {"action": "Others", "sequences": 1, "frames": 20, "percent": "33.33"},
        {"action": "walk", "sequences": 1, "frames": 10, "percent": "16.67"},
    ]


def test_garments_are_counted_by_fabric_and_gender():
    rows = {row["garment"]: row for row in garment_table(RECORDS)}
    assert list(rows) == ["Dress", "Skirt", "Tshirt"]
    assert rows["Tshirt"] == {
        "garment": "Tshirt", "count": 2, "cotton": 1, "denim": 0, "silk": 1,
        "female": 1, "male": 1, "vertices": "450 (400 to 500)",
    }  # fmt: skip


def test_an_empty_dataset_has_an_overview_and_no_rows():
    rows = {row.pop("measure"): row for row in overview_table([])}
    assert rows["sequences"]["all"] == "0"
    assert rows["vertices per garment"]["all"] == "-"
    assert action_table([]) == garment_table([]) == []
