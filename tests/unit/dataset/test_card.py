import re

import pandas as pd
import pytest
import yaml

from drapeline.dataset.card import dataset_card, markdown_table
from drapeline.dataset.collect import collect_dataset
from drapeline.dataset.record import read_record
from toys.tiny_sample import write_tiny_sample

NO_TABLES = {"statistics_overview": [], "statistics_actions": [], "statistics_garments": []}


@pytest.fixture(scope="module")
def folders(tmp_path_factory, toy_body):
    stages = tmp_path_factory.mktemp("stages")
    plan = (("1", "train", "accepted"), ("2", "val", "rejected"), ("3", "test", "accepted"))
    return [
        write_tiny_sample(
            stages, toy_body, name, split, status=status, seed=int(name), source=f"c{name}.bvh"
        ).folder
        for name, split, status in plan
    ]


def test_the_card_is_written_from_the_data(folders, tmp_path):
    collect_dataset(folders, tmp_path / "dataset")
    card = (tmp_path / "dataset" / "README.md").read_text()
    assert "2 sequences, 12 frames at 30 frames per second, of bodies wearing Skirt, Tshirt" in card
    assert "Of 3 samples: 2 accepted, 1 rejected" in card
    assert "| 2 | rejected | 1.20 % of the vertices inside the body |" in card
    assert "- Body models: toy-1" in card
    assert "- Cloth solvers: blender (2 samples)" in card
    assert "bpy 4.5.15" in card
    assert "Clips used: c1.bvh, c3.bvh." in card
    assert "| `inside_share` | 0.005 | 0 | 0.01 |" in card
    header = yaml.safe_load(card.split("---\n")[1])
    (index,) = header["configs"]
    read = pd.read_csv(tmp_path / "dataset" / index["data_files"], sep=index["sep"], dtype=str)
    assert list(read["sample"]) == ["1", "3"]
    assert header["size_categories"] == ["n<1K"]
    for table in re.findall(r"(?:^\|.*\|\n)+", card, flags=re.MULTILINE):
        assert len({line.count("|") for line in table.splitlines()}) == 1


def test_the_card_names_clips_that_several_splits_share(folders, tmp_path, toy_body):
    separate = dataset_card([read_record(folder) for folder in folders], NO_TABLES)
    assert "No motion clip and no body is in more than one split." in separate
    shared = [
        write_tiny_sample(tmp_path, toy_body, name, split, seed=seed, source="same.bvh").folder
        for seed, (name, split) in enumerate((("4", "train"), ("5", "test")))
    ]
    card = dataset_card([read_record(folder) for folder in shared], NO_TABLES)
    assert "Note that some splits share data: clip same.bvh." in card


def test_the_card_names_bodies_that_several_splits_share(tmp_path, toy_body):
    records = [
        read_record(write_tiny_sample(tmp_path, toy_body, name, source=f"c{name}").folder)
        for name in ("6", "7")
    ]
    records[1].meta["split"] = "val"
    records[1].meta["outfit"]["shape"] = records[0].meta["outfit"]["shape"]
    assert "share data: female body of shape [" in dataset_card(records, NO_TABLES)


def test_markdown_tables_keep_columns_apart():
    rows = [{"a": 1, "b": "x|y"}, {"c": 2}]
    assert markdown_table(rows).splitlines() == [
        "| a | b | c |",
        "| --- | --- | --- |",
        "| 1 | x\\|y |  |",
        "|  |  | 2 |",
    ]
    assert markdown_table([]) == "(none)"


def test_the_card_says_whether_cloth_lay_on_a_floor(tmp_path, toy_body):
    record = read_record(write_tiny_sample(tmp_path, toy_body, "8", source="c8").folder)
    (attempt,) = record.meta["simulation"]["attempts"]
    for floor, what in ((False, "the body, with itself"), (True, "the body, with the floor, with")):
        attempt["floor"] = floor
        assert what in dataset_card([record], NO_TABLES).replace("\n", " ")


def test_values_of_tables_are_text():
    rows = [{"action": "<b onclick='x()'>walk\n\n| <script>"}]
    assert markdown_table(rows).splitlines()[2:] == ["| &lt;b onclick='x()'>walk \\| &lt;script> |"]
