import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.training.checkpoints import read_checkpoint
from drapeline.models.training.module import BEST
from toys.histories import column
from toys.smplicit_trainings import train_toy


@pytest.fixture(scope="module")
def trained(tmp_path_factory, fields, toy_body):
    return train_toy(tmp_path_factory.mktemp("trained"), fields, toy_body)


def test_a_killed_training_is_resumed_to_the_bit(tmp_path, fields, toy_body, trained):
    with pytest.raises((KeyboardInterrupt, SystemExit)):
        train_toy(tmp_path, fields, toy_body, stop=6)
    assert not (tmp_path / "model").exists()
    resumed = train_toy(tmp_path, fields, toy_body)
    one, other = (read_checkpoint(path / BEST).weights for path in (trained, resumed))
    for name, value in one.items():
        assert torch.equal(value, other[name]), name
    assert column(trained, "val_distance_mm") == column(resumed, "val_distance_mm")


def test_a_training_on_other_splits_is_not_resumed(tmp_path, fields, toy_body, trained):
    with pytest.raises((KeyboardInterrupt, SystemExit)):
        train_toy(tmp_path, fields, toy_body, stop=6)
    for path in fields.folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    rows = dict(np.load(tmp_path / "rows.npz"))
    rows["split"] = rows["split"][::-1].copy()
    np.savez(tmp_path / "rows.npz", **rows)
    swapped = FieldData(tmp_path)
    continued, afresh = (
        read_checkpoint(train_toy(folder, swapped, toy_body) / BEST).weights
        for folder in (tmp_path, tmp_path / "afresh")
    )
    for name, value in afresh.items():
        assert torch.equal(value, continued[name]), name


def test_each_garment_is_visited_as_often_as_asked(tmp_path, fields, toy_body):
    steps = 3 * 4  # epochs; four garments, twice each, two at a time
    with pytest.raises((KeyboardInterrupt, SystemExit)):
        train_toy(tmp_path, fields, toy_body, stop=steps - 1)
    finished = train_toy(tmp_path, fields, toy_body, stop=steps)
    assert column(finished, "epoch") == [0, 1, 2]


def test_data_that_are_not_finite_are_named(tmp_path, fields, toy_body):
    for path in fields.folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    distances = np.load(tmp_path / "near_distance.npy")
    distances[2, 3] = np.nan
    np.save(tmp_path / "near_distance.npy", distances)
    with pytest.raises(InputError, match="samples s2/Skirt: distances hold NaN"):
        train_toy(tmp_path, FieldData(tmp_path), toy_body)


SEVERAL = """
import os
import sys
from pathlib import Path

from toys.smplicit import toy_fields
from toys.smplicit_trainings import train_toy
from toys.bodies import toy_body

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    data = folder / ("data" + os.environ.get("LOCAL_RANK", "0"))
    data.mkdir()
    train_toy(folder, toy_fields(data, toy_body), toy_body(), devices=2, batch=2)
"""


def test_two_processes_train_as_one_with_as_many_rows_in_a_step(tmp_path, fields, toy_body):
    """Codes of garments that a process has not seen in a step are trained all the same."""
    (tmp_path / "two").mkdir()
    script = tmp_path / "several.py"
    script.write_text(SEVERAL)
    tests = Path(__file__).parents[3]
    path = os.pathsep.join(map(str, (tests, tests.parent / "src")))
    subprocess.run(
        [sys.executable, script, tmp_path / "two"],
        check=True,
        timeout=600,
        env={**os.environ, "PYTHONPATH": path},
    )
    one = train_toy(tmp_path / "one", fields, toy_body, batch=4)
    distances = []
    for folder in (one, tmp_path / "two/model"):
        with open(folder / "history.tsv") as stream:
            rows = csv.DictReader(stream, delimiter="\t")
            distances.append([float(row["val_distance_mm"]) for row in rows])
    assert distances[0] == pytest.approx(distances[1], rel=0.02)
