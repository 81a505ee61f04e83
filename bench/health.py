"""How much of a simulation goes into measuring its health."""

from pathlib import Path

import numpy as np
from side_by_side import cpu_seconds

from drapeline.dataset.reader import Cloth3D, Sample
from drapeline.dataset.record import read_record
from drapeline.dataset.shards import samples_of
from drapeline.geometry.mesh import edges
from drapeline.simulation.health import HealthGarment, HealthMonitor
from drapeline.storage import read_rows

_SAMPLES = 4


def health_seconds(sample: Sample) -> float:
    """Processor time of measuring all frames of a sample."""
    garments = []
    for name in sample.garments:
        mesh = sample.mesh(name)
        ends = mesh.vertices[edges(mesh.faces)]
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        garments.append(HealthGarment(name, mesh.faces, lengths))
    cloths = [sample.vertices(name, frame="root") for name in sample.garments]
    bodies = sample.body_vertices(frame="root")
    monitor = HealthMonitor(garments, sample.body_mesh().faces)

    def measure() -> None:
        for *cloth, body in zip(*cloths, bodies, strict=True):
            monitor.add(cloth, body)

    return cpu_seconds(measure)


def sentence(results: Path) -> str:
    """The shares of either solver: of samples that Blender made at once, and of a learning job."""
    health = jobs = 0.0
    count = 0
    for sample in Cloth3D(results / "dataset"):
        status = read_record(sample.folder).meta["simulation"]
        if status["solver"]["name"] == "blender" and len(status["attempts"]) == 1:
            health += health_seconds(sample)
            job = f"benchmarks/simulate_outfits/dataset_{sample.id}.tsv"
            _, (row,) = read_rows(results / job, "a benchmark")
            jobs += float(row["cpu_time"])
            count += 1
            if count == _SAMPLES:
                break
    blender = (
        f"Measuring the health of all frames takes {health / jobs:.1%} of the processor time of"
        f" {count} jobs that simulate a sample with Blender ({health:.1f} of {jobs:.0f} s), so that"
        f" these take {1 / (1 - health / jobs):.2f} times as long as without."
    )
    shards = sorted((results / "samples/learning").glob("[!.]*"))
    return blender + (_learning(results, shards[0]) if shards else "")


def _learning(results: Path, shard: Path) -> str:
    made = [folder for folder in samples_of([shard]) if read_record(folder).accepted]
    fast = sum(health_seconds(Sample(folder)) for folder in made)
    job = f"benchmarks/simulate_outfits/learning_{shard.name}.tsv"
    _, (row,) = read_rows(results / job, "a benchmark")
    whole = float(row["cpu_time"])
    return (
        f" With the fast solver it takes {fast / whole:.1%} of a job that simulates the learning"
        f" group: {fast:.1f} s for {len(made)} accepted samples, of {whole:.0f} s."
    )
