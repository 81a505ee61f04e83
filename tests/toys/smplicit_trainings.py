"""Trainings of tiny models of SMPLicit."""

from pathlib import Path

from drapeline.bodies.model import BodyModel
from drapeline.learning_data.garment_fields import FieldData
from drapeline.models.smplicit.model import save_model_files
from drapeline.models.smplicit.network import new_field
from drapeline.models.smplicit.train import train_field
from drapeline.models.training.lightning import TrainingRun
from toys.smplicit import toy_bodies, toy_settings
from toys.threads import THREADS


def train_toy(
    folder: Path, data: FieldData, body: BodyModel, *, stop=None, devices=1, **training
) -> Path:
    """The folder of a training by so many processes; `stop` is a step at which it is killed."""
    bodies = toy_bodies(body)
    settings = toy_settings(**{"epochs": 3, "visits": 2, **training})
    model = new_field("skirt", data, bodies, settings)
    if stop is not None:
        step, whole = [0], model.training_step

        def limited(batch):
            if step[0] == stop:
                raise KeyboardInterrupt
            step[0] += 1
            return whole(batch)

        model.training_step = limited
    trainer = {"accelerator": "cpu", "devices": devices}
    train_field(
        model,
        data,
        TrainingRun(folder / "model", folder / "progress", "x", THREADS, trainer),
        lambda out: save_model_files(out, model, data, bodies),
    )
    return folder / "model"
