import csv
import errno
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from drapeline.errors import InputError
from drapeline.manifest import damages
from drapeline.models.training import lightning
from drapeline.models.training.checkpoints import read_checkpoint, read_torch_file, write_torch_file
from drapeline.models.training.lightning import TrainingRun, begin, fit, learning_rate
from drapeline.models.training.module import BEST, Progress, TrainableModule
from drapeline.models.training.settings import EpochTraining
from drapeline.storage import read_json
from toys.threads import THREADS


class Line(TrainableModule):
    """One number that goes to zero."""

    def __init__(self):
        super().__init__()
        training = EpochTraining(epochs=1, batch=1, learning_rate=1.0 / 6, schedule="constant")
        self.settings = SimpleNamespace(training=training)
        self.x = torch.nn.Parameter(torch.tensor(3.0))

    def training_step(self, batch):
        return self.x**2

    def validation_step(self, batch):
        # Best in the second epoch, to tell best from last.
        self.log_means("val", {"x": abs(self.x - 1.0)}, 1)

    def optimizer(self):
        return torch.optim.SGD(self.parameters(), lr=0.0)

    def checkpoint_metadata(self):
        return {"checkpoint_type": "line", "start": torch.tensor(3.0)}


class One:
    def loader(self, split, *, processes=1, rank=0):
        return torch.utils.data.DataLoader([0.0])


def run_in(folder):
    return TrainingRun(folder / "out", folder / "progress", "c", THREADS, {"accelerator": "cpu"})


def train_line(line, folder, epochs):
    line.settings.training = line.settings.training.replace(epochs=epochs)
    fit(line, One(), run_in(folder), monitor="val_x", settings={})
    best = read_checkpoint(folder / "out" / BEST)
    assert best.metadata == {"checkpoint_type": "line", "start": torch.tensor(3.0)}
    return [best.weights["x"].item(), line.x.item()]


def test_best_is_the_epoch_of_the_least_monitored_value_and_last_the_last(tmp_path):
    line = Line()
    best, last = train_line(line, tmp_path, 6)
    assert line.progress == Progress()  # no longer in training
    path = [3 * (2 / 3) ** epoch for epoch in range(1, 7)]
    assert abs(best - min(path, key=lambda x: abs(x - 1))) < 1e-5
    assert abs(last - path[-1]) < 1e-5
    rows = (tmp_path / "out" / "history.tsv").read_text().splitlines()
    assert [row.split("\t")[0] for row in rows] == ["epoch", *"012345"]
    # The same curves, for TensorBoard.
    assert list((tmp_path / "out" / "tensorboard").glob("events.out.tfevents.*"))


class Killed(BaseException):
    """Ends a training as a signal would."""


def cut_off(path):
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def without_optimizers(path):
    found = read_torch_file(path)
    del found["optimizer_states"]
    torch.save(found, path)


def of_another_network(path):
    found = read_torch_file(path)
    torch.save({**found, "state_dict": {"x": torch.zeros(7)}}, path)


HARMS = (cut_off, without_optimizers, of_another_network)


@pytest.mark.parametrize(
    ("damage", "harm"), [("none", None), *((d, h) for d in ("last.ckpt", "both") for h in HARMS)]
)
def test_a_damaged_checkpoint_does_not_stop_a_training_from_being_resumed(
    tmp_path, monkeypatch, caplog, damage, harm
):
    whole = train_line(Line(), tmp_path / "whole", 6)
    steps = iter(range(100))

    def killed_in_the_fourth_epoch(self, batch):
        if next(steps) == 4:
            raise Killed
        return self.x**2

    with monkeypatch.context() as patch, pytest.raises(Killed):
        patch.setattr(Line, "training_step", killed_in_the_fourth_epoch)
        train_line(Line(), tmp_path, 6)
    (under_way,) = (tmp_path / "progress").iterdir()
    for name in ("best.ckpt", "last.ckpt"):
        if damage in (name, "both"):
            harm(under_way / name)
    with caplog.at_level("INFO", "drapeline"):
        assert train_line(Line(), tmp_path, 6) == whole
    said = [r.getMessage() for r in caplog.records if r.levelname == "WARNING"]
    instead = {
        "last.ckpt": [f"the training is resumed from {under_way}/best.ckpt"],
        "both": [f"the training is resumed from {under_way}/best.ckpt", "the training begins anew"],
        "none": [],
    }[damage]
    assert [message.rpartition("; ")[2] for message in said] == instead
    assert all(str(under_way) in message for message in said)


def test_a_full_disk_leaves_the_checkpoint_before(tmp_path, monkeypatch):
    def no_room(self, data):
        self.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    saved = 0

    def fills_up(path, values):
        nonlocal saved
        saved += 1
        if saved == 4:  # the last one of the second epoch
            monkeypatch.setattr(Path, "write_bytes", no_room)
        write_torch_file(path, values)

    monkeypatch.setattr(lightning, "write_torch_file", fills_up)
    with pytest.raises(InputError, match=r"last\.ckpt: cannot be written \(No space left"):
        train_line(Line(), tmp_path, 6)
    (under_way,) = (tmp_path / "progress").iterdir()
    assert read_torch_file(under_way / "last.ckpt")["epoch"] == 0
    assert read_torch_file(under_way / "best.ckpt")["epoch"] == 1
    assert not list(under_way.glob(".*"))


def test_a_full_disk_that_names_no_file_is_that_of_the_training(tmp_path, monkeypatch):
    def no_room(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Line, "training_step", no_room)
    with pytest.raises(InputError, match=f"{tmp_path}/progress/.*: cannot be written .No space"):
        train_line(Line(), tmp_path, 6)


class Numbers(Line):
    """Logs what it is given, the rows of a batch at once."""

    def training_step(self, batch):
        self.log_means("train", {"mean": batch.mean(), "half": batch.mean().half()}, len(batch))
        return self.x**2

    def validation_step(self, batch):
        self.log_means("val", {"x": self.x.detach()}, len(batch))


class Batches:
    def loader(self, split, *, processes=1, rank=0):
        rows = torch.arange(5.0) if split == "train" else torch.zeros(1)
        return torch.utils.data.DataLoader(rows, batch_size=2)


def test_history_holds_means_over_the_rows_of_each_epoch(tmp_path):
    numbers = Numbers()
    numbers.settings.training = numbers.settings.training.replace(epochs=2)
    fit(numbers, Batches(), run_in(tmp_path), monitor="val_x", settings={})
    header, *rows = (tmp_path / "out" / "history.tsv").read_text().splitlines()
    for row in rows:
        values = dict(zip(header.split("\t"), row.split("\t"), strict=True))
        # 0, 1 | 2, 3 | 4: the last batch counts half of the others.
        assert float(values["train_mean"]) == float(values["train_half"]) == 2.0
    assert len(rows) == 2


def test_a_training_clears_away_those_of_other_settings_and_keeps_its_own(tmp_path):
    for name in ("old", "same"):
        begin(tmp_path / "progress" / name, {"name": name})
        (tmp_path / "progress" / name / "last.ckpt").write_text(name)
    begin(tmp_path / "progress" / "same", {"name": "same"})
    assert [path.name for path in (tmp_path / "progress").iterdir()] == ["same"]
    assert (tmp_path / "progress" / "same" / "last.ckpt").read_text() == "same"
    assert read_json(tmp_path / "progress" / "same" / "settings.json") == {"name": "same"}


SEVERAL = """
import sys
from pathlib import Path

from drapeline.models.gcvae.settings import ConditioningSettings
from drapeline.models.gcvae.train import ConditioningTraining, ConditionRows
from drapeline.models.training.lightning import TrainingRun, fit
from drapeline.models.gcvae.data import cvar_statistics
from drapeline.models.training.batches import TrainingBatches
from drapeline.rule_log import rule_log
from toys.gcvae import ToyGarments

if __name__ == "__main__":
    folder, garments = Path(sys.argv[1]), ToyGarments(47)
    devices = int(sys.argv[2])
    trainer = {"accelerator": "cpu", "devices": devices, "strategy": "ddp"}
    settings = ConditioningSettings(condition=4, training={"steps": 4 * devices})
    moments = cvar_statistics(garments.cvar(garments.rows("train")))
    with rule_log(str(folder / "log")):
        fit(
            ConditioningTraining(settings, *moments),
            TrainingBatches(ConditionRows(garments), batch=16 // devices, seed=0),
            TrainingRun(folder / "out", folder / "progress", "c", 1, trainer),
            monitor="val_loss",
            settings={},
        )
"""


# What Slurm sets in a step of a job that Snakemake submitted.
STEP = {
    "SLURM_JOB_ID": "7",
    "SLURM_JOB_NAME": "train_svae",
    "SLURM_NTASKS": "1",
    "SLURM_PROCID": "0",
    "SLURM_LOCALID": "0",
    "SLURM_NODEID": "0",
    "SLURM_NODELIST": "localhost",
}


def train_on(folder, devices, **environment):
    """Run the script above; gives its output and the losses of both epochs."""
    folder.mkdir()
    script = folder / "several.py"
    script.write_text(SEVERAL)
    tests = Path(__file__).parents[3]
    path = os.pathsep.join(map(str, (tests, tests.parent / "src")))
    done = subprocess.run(
        [sys.executable, script, folder, str(devices)],
        capture_output=True,
        text=True,
        timeout=1800,
        env={**os.environ, "PYTHONPATH": path, **environment},
    )
    assert done.returncode == 0, done.stderr
    with open(folder / "out" / "history.tsv") as stream:
        losses = [float(row["train_loss"]) for row in csv.DictReader(stream, delimiter="\t")]
    return done.stdout + done.stderr, losses


@pytest.mark.parametrize("environment", [{}, STEP], ids=["at home", "in a job of Slurm"])
def test_two_processes_train_one_network_and_write_one_folder(tmp_path, environment):
    printed, losses = train_on(tmp_path / "two", 2, **environment)
    folder = tmp_path / "two"
    names = {BEST, "history.tsv", "settings.json", "manifest.tsv"}
    assert {path.name for path in (folder / "out").iterdir()} == names | {"tensorboard"}
    assert not list(damages(folder / "out", sums=True))
    assert not (folder / "progress").exists()
    log = (folder / "log").read_text()
    assert log.count("epoch 1 of 2") == log.count("epoch 2 of 2") == 1
    assert "Traceback" not in log
    assert "GPU available" in log  # Lightning's chatter, which is not for the terminal
    assert "GPU available" not in printed
    # One process with as many rows in a step sees the same, in history as in gradients. The rows
    # are odd in number, so that a mean of the processes' counts is no whole number.
    assert train_on(tmp_path / "one", 1, **environment)[1] == pytest.approx(losses, rel=0.01)


def test_one_cycle_rises_and_falls_to_nothing():
    rates = [learning_rate(1.0, "one_cycle", share) for share in (0, 0.1, 0.55, 1)]
    np.testing.assert_allclose(rates, [0.1, 1.0, 0.5, 0.0], atol=1e-12)
    assert learning_rate(1.0, "constant", 0.9) == 1.0
