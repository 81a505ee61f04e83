"""Trainings of tiny displacements."""

from pathlib import Path

from drapeline.bodies.model import BodyModel
from drapeline.learning_data.pose_displacements import DisplacementData
from drapeline.models.smplicit.displacement_network import DisplacementField
from drapeline.models.smplicit.load_displacement import new_displacement
from drapeline.models.smplicit.train_displacement import train_displacement
from toys.displacement import CLUSTERS, toy_displacement_settings
from toys.smplicit import toy_bodies
from toys.threads import THREADS


def toy_displacement(data: DisplacementData, body: BodyModel, **training) -> DisplacementField:
    """An untrained network."""
    settings = toy_displacement_settings(**training)
    return new_displacement("skirt", data, toy_bodies(body), CLUSTERS, settings)


def train_toy_displacement(
    folder: Path, data: DisplacementData, body: BodyModel, *, stop: int | None = None
) -> Path:
    """The folder of a training; `stop` is a step at which it is killed."""
    model = toy_displacement(data, body, epochs=3)
    if stop is not None:
        step, whole = [0], model.training_step

        def limited(batch):
            if step[0] == stop:
                raise KeyboardInterrupt
            step[0] += 1
            return whole(batch)

        model.training_step = limited
    train_displacement(
        folder / "model",
        model,
        data,
        code="x",
        progress=folder / "progress",
        trainer={"accelerator": "cpu"},
        threads=THREADS,
    )
    return folder / "model"
