"""How far test garments in motion are from themselves when they are simulated once more."""

from collections.abc import Mapping
from itertools import groupby
from time import process_time

import numpy as np

from drapeline.bodies.model import load_bodies, load_body
from drapeline.dataset.shards import samples_of
from drapeline.frames import GENDERS
from drapeline.generation.again import simulate_samples_again
from drapeline.geometry.mesh import Mesh
from drapeline.job import Job
from drapeline.learning_data.moving import moving_files
from drapeline.metrics.metric import Measured
from drapeline.metrics.registered import measure_motion, measured_in_motion
from drapeline.metrics.shared import MOVED
from drapeline.metrics.table import join, summarise, write_evaluation
from drapeline.models.compare import KnownScan, answer_frames, known_scans
from drapeline.models.contract import Stopwatch
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


def move_garments_again(job: Job) -> None:
    """Frames of scanned test samples, simulated again."""
    given, bodies = job.input, load_bodies(job.input)
    folders = samples_of(given.samples)
    scans = known_scans(given.scans, folders, bodies)
    scanned = {known.person.sample for known in scans}
    watch, found = Stopwatch(), {}
    start = process_time()
    for again in simulate_samples_again(
        job, [folder for folder in folders if folder.name in scanned], bodies
    ):
        frames = len(next(iter(again.cloths.values())))
        found[again.sample] = again.way, again.cloths, (process_time() - start) / frames
        start = process_time()

    def answer(known: KnownScan) -> Mapping[str, Mapping[str, Mesh]]:
        if known.person.sample not in found:
            return {}
        way, cloths, watch.seconds[way] = found[known.person.sample]
        return {
            way: {
                name: Mesh(cloths[name][known.scan.frame], rest.faces)
                for name, rest in known.person.rest.items()
            }
        }

    answer_frames(job, scans, answer, watch, MOVED)
