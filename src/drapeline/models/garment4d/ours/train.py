"""Our model's trainings: of labels for all types, and of the rest for one."""

from functools import partial

import torch

from drapeline.bodies.model import load_bodies
from drapeline.job import Job
from drapeline.learning_data.sequences import CloudData, SequenceData
from drapeline.models.garment4d.data import BodySequences, BodySet
from drapeline.models.garment4d.ours.final_step import fit_final_step
from drapeline.models.garment4d.ours.labels import LabelledClouds, LabelStage
from drapeline.models.garment4d.ours.model import (
    Guesser,
    fit_regression,
    guess_all,
    save_our_model,
)
from drapeline.models.garment4d.settings import LabelStageSettings, SkinningSettings
from drapeline.models.garment4d.stages import keep_bodies, load_stage
from drapeline.models.training.batches import TrainingBatches
from drapeline.models.training.checkpoints import arrays_digest, begin_with
from drapeline.models.training.lightning import TrainingRun, fit
from drapeline.models.training.module import fastest_device
from drapeline.registration.settings import RefineSettings
from drapeline.storage import atomic_folder


def train_labels(job: Job) -> None:
    """Labels of points, from the clouds of all garments."""
    run = TrainingRun.of(job)
    torch.set_num_threads(run.threads)
    data = CloudData(job.input.data)
    stage = LabelStage(LabelStageSettings(**job.params.settings))
    training = stage.settings.training
    clouds = LabelledClouds(
        data, frames=training.frames, stride=training.stride, sources=training.sources
    )
    begin_with(stage, job.params.start)
    stage.prepare(clouds)
    fit(
        stage,
        TrainingBatches(clouds, batch=training.batch, seed=training.seed),
        run,
        monitor="val_total",
        settings={
            **stage.settings.plain(),
            "data": arrays_digest(data.arrays()),
            "start": job.params.start["folder"],
        },
        complete=partial(keep_bodies, bodies=load_bodies(job.input)),
    )


def train_ours(job: Job) -> None:
    """First guesses and the final step of a type, fitted in closed form."""
    given, params = job.input, job.params
    torch.set_num_threads(job.threads)
    data = SequenceData(given.data)
    sequences = BodySequences(data, BodySet(load_bodies(given), params.body_points))
    labels = load_stage(given.labels, LabelStage).to(fastest_device(params.accelerator))
    guesser = Guesser(labels, data.space, data.label)
    clouds = CloudData(given.clouds)
    known = fit_regression(guesser, data, clouds)
    final_step = fit_final_step(
        sequences,
        SkinningSettings(**params.skinning),
        guess_all(guesser, sequences, clouds, known),
        RefineSettings(**params.refine),
        params.proposals,
    )
    with atomic_folder(job.output[0]) as scratch:
        save_our_model(scratch, guesser, final_step, sequences)
