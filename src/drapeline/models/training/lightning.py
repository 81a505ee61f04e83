"""Trainings that can be killed and resumed: Lightning's trainer, checkpoints and history."""

import ctypes
import hashlib
import json
import logging
import math
import shutil
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import torch
from pytorch_lightning import Callback, LightningModule, Trainer
from pytorch_lightning.callbacks import ModelCheckpoint, TQDMProgressBar
from pytorch_lightning.loggers import TensorBoardLogger
from pytorch_lightning.plugins import TorchCheckpointIO
from pytorch_lightning.plugins.environments import LightningEnvironment
from torch.utils.data import DataLoader

from drapeline.errors import DamagedFile
from drapeline.job import Job
from drapeline.manifest import write_manifest
from drapeline.models.training.batches import Batch, TrainingBatches
from drapeline.models.training.checkpoints import (
    read_torch_file,
    write_checkpoint,
    write_torch_file,
)
from drapeline.models.training.module import (
    BEST,
    RATE_SHARE,
    SETTINGS,
    Logged,
    Progress,
    TrainableModule,
)
from drapeline.rule_log import LOGGER
from drapeline.storage import (
    atomic_file,
    atomic_folder,
    copy_folder,
    report_disk_errors,
    write_json,
)

# Messages of Lightning (devices, tips, that it is done) belong in the rule's log, with ours.
for _name in ("pytorch_lightning", "lightning_fabric"):
    _chatter = logging.getLogger(_name)
    _chatter.handlers.clear()
    _chatter.parent, _chatter.propagate = LOGGER, True

HISTORY = "history.tsv"
# Of a training under way, in Lightning's form.
LAST_STATE, BEST_STATE = "last.ckpt", "best.ckpt"
CURVES = "tensorboard"


class History(Callback):
    """A row per epoch, kept in the checkpoint so that a resumed training has the earlier ones."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[dict[str, float]] = []
        self._started = time.perf_counter()

    def on_train_epoch_start(self, *_: Any) -> None:
        """Start the clock."""
        self._started = time.perf_counter()

    def on_train_epoch_end(self, trainer: Trainer, loop: Any) -> None:
        """Write the epoch's row, and a line of it to the log."""
        loop.log_epoch("train")
        values = {key: float(value) for key, value in sorted(trainer.callback_metrics.items())}
        seconds = time.perf_counter() - self._started
        self.rows.append({"epoch": trainer.current_epoch, "seconds": round(seconds, 3), **values})
        if not trainer.is_global_zero:
            return
        self._write()
        LOGGER.info(
            "epoch %d of %d, %.1f s: %s",
            trainer.current_epoch + 1,
            trainer.max_epochs,
            seconds,
            ", ".join(f"{key} {value:.4g}" for key, value in values.items()),
        )

    def _write(self) -> None:
        with atomic_file(self.path) as scratch:
            lines = ["\t".join(self.rows[0])]
            lines += ["\t".join(f"{value:.7g}" for value in row.values()) for row in self.rows]
            scratch.write_text("\n".join(lines) + "\n")

    def state_dict(self) -> dict[str, Any]:
        """For the checkpoint."""
        return {"rows": self.rows}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """From the checkpoint."""
        self.rows = list(state["rows"])


class _Means:
    """Means of what the steps of an epoch log, weighted by their rows."""

    def __init__(self) -> None:
        self._sums: dict[str, torch.Tensor] = {}
        self._counts: dict[str, int] = {}

    def add(self, values: Mapping[str, torch.Tensor], count: int) -> None:
        """Add the values of a batch of `count` rows."""
        for name, value in values.items():
            self._sums[name] = self._sums.get(name, 0) + value.float() * count
            self._counts[name] = self._counts.get(name, 0) + count

    def take(self, stage: str) -> Iterator[Logged]:
        """Means of the names that begin with a stage's, with their rows; they start anew."""
        for name in [name for name in self._sums if name.startswith(f"{stage}_")]:
            count = self._counts.pop(name)
            yield Logged({name: self._sums.pop(name) / count}, count)


class _AtomicCheckpoints(TorchCheckpointIO):
    """Lightning's own writes to a folder for temporary files, and copies from there piece by piece.

    A process that is killed meanwhile, or a full disk, would leave half a checkpoint.
    """

    def save_checkpoint(
        self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None
    ) -> None:
        """Replace a checkpoint as a whole, or leave it as it is."""
        write_torch_file(path, checkpoint)


class _Loop(LightningModule):
    """A network and its batches as Lightning takes them; checkpoints hold the weights alone."""

    def __init__(self, trained: TrainableModule, data: TrainingBatches) -> None:
        super().__init__()
        self.trained, self.data = trained, data
        self._means = _Means()

    def state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """The network's."""
        return self.trained.state_dict(*args, **kwargs)

    def load_state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """Into the network."""
        return self.trained.load_state_dict(*args, **kwargs)

    def train_dataloader(self) -> DataLoader:
        """This process's share of the training batches."""
        return self._loader("train")

    def val_dataloader(self) -> DataLoader:
        """This process's share of the validation batches."""
        return self._loader("val")

    def _loader(self, split: str) -> DataLoader:
        among = self.trainer
        return self.data.loader(split, processes=among.world_size, rank=among.global_rank)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """The network's own."""
        return self.trained.optimizer()

    def on_train_batch_start(self, *_: Any) -> None:
        """Set the learning rate from the step alone."""
        training = self.trained.settings.training
        rate = learning_rate(training.learning_rate, training.schedule, self._share())
        for optimizer in self.trainer.optimizers:
            for group in optimizer.param_groups:
                group["lr"] = rate * group.get(RATE_SHARE, 1.0)

    def training_step(self, batch: Batch, _: int) -> torch.Tensor:
        """Loss of one batch."""
        return self._step(self.trained.training_step, batch)

    def validation_step(self, batch: Batch, _: int) -> None:
        """Log the results of one batch of the validation rows."""
        self._step(self.trained.validation_step, batch)

    def _step(self, step: Callable[[Batch], Any], batch: Batch) -> Any:
        trained = self.trained
        trained.progress = Progress(
            self.current_epoch, self.global_step, self.global_rank, self._share()
        )
        out = step(batch)
        while trained.logged:
            self._means.add(*trained.logged.pop())
        return out

    def _share(self) -> float:
        """Share of all steps that are done."""
        return self.global_step / self.trainer.estimated_stepping_batches

    def on_validation_epoch_end(self) -> None:
        """Log the validation's results."""
        self.log_epoch("val")

    def log_epoch(self, stage: str) -> None:
        """Log means over the epoch, once: Lightning's own take milliseconds of every step.

        Each process counts its rows, so that those of several devices weigh alike.
        """
        for values, count in self._means.take(stage):
            # As whole numbers, the mean of their counts would be cut off to one.
            rows: Any = float(count)
            self.log_dict(values, on_step=False, on_epoch=True, batch_size=rows, sync_dist=True)


class TrainingRun(NamedTuple):
    """Where a training happens, and with what.

    Attributes:
        folder: gets `best.safetensors`, `history.tsv`, `settings.json`, `tensorboard`, and
            `manifest.tsv` with the sums of all of them.
        progress: folder for a training under way, which is resumed if its settings are the same.
        code: digest of the code; only the same code resumes a training.
        threads: of the processor.
        trainer: options of Lightning's Trainer: accelerator, devices, precision, strategy ...
    """

    folder: str | Path
    progress: str | Path
    code: str
    threads: int
    trainer: Mapping[str, Any]

    @classmethod
    def of(cls, job: Job) -> "TrainingRun":
        """A job's, whose params have the `trainer`'s options."""
        return cls(job.output[0], job.progress, job.code, job.threads, job.params.trainer)


def fit(
    module: TrainableModule,
    data: TrainingBatches,
    run: TrainingRun,
    *,
    monitor: str,
    settings: Mapping[str, Any],
    complete: Callable[[Path], None] | None = None,
) -> None:
    """Train, or resume a training that was stopped, and leave the finished folder.

    Args:
        data: batches to train and validate on.
        monitor: logged value; the epoch where it is least is the best.
        settings: everything but the code that the result depends on, as JSON values.
        complete: adds files to the folder, which has all others by then.

    Of several devices each has a process of its own that calls this; the first process writes.
    """
    keep_freed_memory()
    torch.set_num_threads(run.threads)
    settings = {**settings, "code": run.code}
    # Named after the settings, so that no process reads what another clears away.
    text = json.dumps(settings, sort_keys=True)
    under_way = Path(run.progress) / hashlib.sha256(text.encode()).hexdigest()[:12]
    # As many passes on any number of devices, so that a training can be resumed on another one.
    epochs = module.settings.training.epochs_of(len(data.loader("train")))
    engine = _trainer(under_way, epochs, monitor, run.trainer)
    if engine.is_global_zero:
        begin(under_way, settings)
    resumed = newest_readable(under_way, module)
    if resumed is not None:
        LOGGER.info("resuming from %s", resumed)
    with warnings.catch_warnings():
        # The progress folder is meant to hold files; the other warning is internal to Lightning.
        warnings.filterwarnings("ignore", "Checkpoint directory .* exists and is not empty")
        warnings.filterwarnings("ignore", ".*LeafSpec.* is deprecated")
        loop = _Loop(module, data)
        # Lightning's curves are written by a thread, whose errors name no file.
        with report_disk_errors(under_way):
            engine.fit(loop, ckpt_path=resumed, weights_only=True)
    module.progress = Progress()
    if engine.is_global_zero:
        with atomic_folder(run.folder) as scratch:
            best = read_torch_file(under_way / BEST_STATE)["state_dict"]
            write_checkpoint(scratch / BEST, best, module.checkpoint_metadata())
            for name in (HISTORY, SETTINGS):
                shutil.copyfile(under_way / name, scratch / name)
            copy_folder(under_way / CURVES, scratch / CURVES)
            if complete is not None:
                complete(scratch)
            write_manifest(scratch)
        shutil.rmtree(run.progress)


def newest_readable(under_way: Path, module: TrainableModule) -> Path | None:
    """The checkpoint to resume a training from, the last or else the best; None begins it anew.

    Whichever it is, the training ends with the same weights.
    """
    there = [path for path in (under_way / LAST_STATE, under_way / BEST_STATE) if path.exists()]
    for number, path in enumerate(there, 1):
        try:
            _check_resumable(path, read_torch_file(path), module)
            return path
        except DamagedFile as error:
            instead = f"is resumed from {there[number]}" if there[number:] else "begins anew"
            LOGGER.warning("%s; the training %s", error, instead)
    return None


# Entries that Lightning resumes from.
_ENTRIES = {
    **{"epoch": int, "global_step": int, "pytorch-lightning_version": str},
    **{"state_dict": Mapping, "loops": Mapping, "callbacks": Mapping},
    **{"optimizer_states": list, "lr_schedulers": list},
}


def _check_resumable(path: Path, found: Any, module: TrainableModule) -> None:
    """Refuse what can be read but is not of this training.

    Raises:
        DamagedFile: an entry is missing or of another kind, or weights have other names or shapes.
    """
    given = found if isinstance(found, Mapping) else {}
    for name, kind in _ENTRIES.items():
        if not isinstance(given.get(name), kind):
            raise DamagedFile(path, f"has no '{name}' to resume a training from")
    shapes = [
        {name: tuple(getattr(value, "shape", ())) for name, value in state.items()}
        for state in (given["state_dict"], module.state_dict())
    ]
    if shapes[0] != shapes[1]:
        raise DamagedFile(path, "its weights are not those of the network that is trained")


def begin(under_way: Path, settings: Mapping[str, Any]) -> None:
    """Make the folder of a training, or keep it, and remove those of other settings."""
    for other in under_way.parent.glob("*"):
        if other.name != under_way.name:
            shutil.rmtree(other) if other.is_dir() else other.unlink()
    write_json(under_way / SETTINGS, settings)


def _trainer(under_way: Path, epochs: int, monitor: str, options: Mapping[str, Any]) -> Trainer:
    terminal = sys.stderr.isatty()
    # The last after the best, so that it knows which epoch was best so far when resumed.
    keepers = [
        ModelCheckpoint(
            under_way,
            filename=Path(name).stem,
            monitor=value,
            enable_version_counter=False,
            save_on_train_epoch_end=True,
        )
        for name, value in ((BEST_STATE, monitor), (LAST_STATE, None))
    ]
    return Trainer(
        max_epochs=epochs,
        callbacks=[History(under_way / HISTORY), *keepers, *[TQDMProgressBar()] * terminal],
        # Slurm's job steps have one task each, and Lightning would take that for all processes.
        plugins=[_AtomicCheckpoints(), LightningEnvironment()],
        logger=TensorBoardLogger(under_way, name="", version=CURVES, default_hp_metric=False),
        use_distributed_sampler=False,  # batches are split among devices already
        enable_progress_bar=terminal,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        log_every_n_steps=1,
        **options,
    )


_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD = -1, -2, -3


def keep_freed_memory() -> None:
    """Tell glibc to keep large freed blocks; page faults can be a third of a training step.

    Does nothing if the C library has no `mallopt`.
    """
    if not sys.platform.startswith("linux"):
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        library.mallopt(_MMAP_THRESHOLD, 1 << 30)
        library.mallopt(_TRIM_THRESHOLD, (1 << 31) - 1)
        library.mallopt(_TOP_PAD, 256 << 20)


_WARM_SHARE = 0.1


def learning_rate(peak: float, schedule: str, share: float) -> float:
    """Learning rate after a `share` (0 to 1) of all steps.

    Args:
        peak: the constant, or the largest rate.
        schedule: "constant"; "late_decay": constant for the first half, then down to zero in a
            line; or "one_cycle": a short rise, then half a cosine down to zero.
    """
    if schedule == "constant":
        return peak
    if schedule == "late_decay":
        return peak * min(1.0, 2 * (1 - share))
    if share < _WARM_SHARE:
        return peak * (0.1 + 0.9 * share / _WARM_SHARE)
    fall = (share - _WARM_SHARE) / (1 - _WARM_SHARE)
    return peak * 0.5 * (1 + math.cos(math.pi * fall))
