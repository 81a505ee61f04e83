"""How far test garments are from themselves when they are simulated once more, in M2 and M3."""

from drapeline.bodies.model import load_bodies
from drapeline.dataset.shards import samples_named
from drapeline.generation.again import simulate_samples_again
from drapeline.job import Job
from drapeline.learning_data.sequences import SIMULATED, SequenceData
from drapeline.metrics import sequence as metrics
from drapeline.metrics.garment4d import MODEL
from drapeline.metrics.metric import Measured
from drapeline.metrics.table import join, summarise, without_all, write_evaluation
from drapeline.registration.to_template.remesh import load_tables, remesh


def evaluate_floor(job: Job) -> None:
    """The true garments at rest, worn by the same people in the same clips, simulated again."""
    given, params = job.input, job.params
    data = {garment: SequenceData(given[garment]) for garment in params.garments}
    tables = {garment: load_tables(given[f"fits_{garment}"]) for garment in params.garments}
    # Sample -> its garments and their sequences.
    tested: dict[str, list[tuple[str, int]]] = {}
    for garment, one in data.items():
        for sequence in one.of_split(params.split, (SIMULATED,)).tolist():
            tested.setdefault(str(one.name[sequence]), []).append((garment, sequence))
    folders = samples_named(given.samples, [name for name in params.samples if name in tested])
    measured: dict[str, list[Measured]] = {}
    for again in simulate_samples_again(job, folders, load_bodies(given)):
        for garment, sequence in tested[again.sample]:
            one = data[garment]
            found = remesh(again.cloths[garment], tables[garment][again.sample])
            true = one.garment[one.rows(sequence)]
            measures = metrics.sequence_measures(found, true, faces=one.space.faces)
            clip, source = str(one.clip[sequence]), str(one.source[sequence])
            measured.setdefault(again.way, []).append(Measured(clip, garment, measures, source))
    tables_of = (
        summarise(every, model=MODEL, variant=way, split=params.split, seed=params.seed)
        for way, every in measured.items()
    )
    write_evaluation(job.output[0], without_all(join(tables_of)))
