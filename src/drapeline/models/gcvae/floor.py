"""How far test garments in motion are from themselves when they are simulated once more."""

from itertools import groupby

import numpy as np

from drapeline.bodies.model import load_bodies, load_body
from drapeline.frames import GENDERS
from drapeline.generation.again import simulate_samples_again
from drapeline.job import Job
from drapeline.learning_data.moving import moving_files
from drapeline.metrics.metric import Measured
from drapeline.metrics.registered import measure_motion, measured_in_motion
from drapeline.metrics.table import join, summarise, write_evaluation
from drapeline.registration.to_body.topology import load_topology


def evaluate_floor(job: Job) -> None:
    """How far test garments are from themselves when they are simulated again."""
    given, params = job.input, job.params
    topology = load_topology(given.topology)
    refined = {gender: load_body(given[f"super_{gender}"]) for gender in GENDERS}
    files = moving_files(given.samples, given.registrations, [params.split])
    wanted = (one for one in files if one.sample in params.samples)
    worn = {name: list(group) for name, group in groupby(wanted, key=lambda one: one.sample)}
    folders = [garments[0].folder for garments in worn.values()]
    measured: dict[str, list[Measured]] = {}
    for again in simulate_samples_again(job, folders, load_bodies(given)):
        for one in worn[again.sample]:
            moving = one.load()
            frames = np.arange(0, len(moving.poses), params.step)
            points = moving.registered.points(again.cloths[one.name][frames])
            body = refined[moving.gender]
            measures = measure_motion(moving, frames, points, body, topology)
            measured.setdefault(again.way, []).extend(measured_in_motion(moving, measures))
    rows = join(
        summarise(every, model="truth", variant=variant, split=params.split, seed=params.seed)
        for variant, every in measured.items()
    )
    write_evaluation(job.output[0], rows)
