"""Time and health of the two cloth solvers, on the same samples.

OMP_NUM_THREADS=1 .venv/bin/python bench/cloth_solvers.py results 00002 00003
OMP_NUM_THREADS=1 .venv/bin/python bench/cloth_solvers.py --gpu results 00002 00003

The folder is that of an experiment that has made its outfits. Each sample is simulated by both
solvers, one after the other, each in a process of its own on one core, with the default settings of
`simulation` and a single attempt. Times are of that process, from its start to its end: imports,
the transition, the measures of every frame and the files included. In the end each solver simulates
all samples in one process, as the jobs of the learning group do. With --gpu it is the fast solver
on a core and on a GPU, twice each: runs of the same digest end in the same bytes.
"""

import hashlib
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

SOLVERS = {
    "blender": ("drapeline.blender.solver", "cpu"),
    "xpbd": ("drapeline.xpbd.solver", "cpu"),
    "xpbd on a GPU": ("drapeline.xpbd.solver", "gpu"),
}
SETTINGS = {
    "steps_min": 14,
    "steps_max": 14,
    "shape_frames": 4,
    "pose_frames": 8,
    "settle_frames": 8,
    "gap_m": 0.004,
    "collider_share": 0.6,
    "attempts": 1,
}
MEASURES = (
    *("inside_open_mean", "stretch_low", "stretch_high", "slip_m", "layer_share_mean"),
    *("self_share_mean", "acceleration_m_s2"),
)
WIDE = {"inside_open_mean": 1, "inside_open_max": 1, "depth_m": 1, "slip_m": 2}


def simulate(solver: str, results: str, folder: str, *samples: str) -> None:
    """Simulate samples by one solver; bounds that nothing breaks let each run to its end."""
    from drapeline.bodies.model import load_body
    from drapeline.bodies.sequence import load_body_sequence
    from drapeline.outfits.outfit import load_outfit
    from drapeline.simulation.settings import HealthBounds, SimulationSettings
    from drapeline.simulation.simulate import DressedBody, simulate_outfit

    module, accelerator = SOLVERS[solver]
    cloth = import_module(module).cloth_solver(1, accelerator)
    for sample in samples:
        (arrays,) = Path(results).glob(f"outfits/*/*/{sample}.npz")
        outfit = load_outfit(arrays, arrays.with_suffix(".json"))
        body = Path(results).parent / f"resources/body/{outfit.gender}.npz"
        (record,) = Path(results).glob(f"bodies/*/*/{sample}.npz")
        motion = load_body_sequence(record)
        simulate_outfit(
            f"{folder}/{sample}",
            DressedBody(load_body(body), motion, outfit),
            cloth,
            settings=SimulationSettings(**SETTINGS),
            bounds=HealthBounds(
                **WIDE, stretch_low=0, stretch_high=10, layer_share_mean=1, self_share_mean=1
            ),
        )


def run(solver: str, results: str, *samples: str) -> dict[str, Any]:
    """Seconds of a process that simulates samples and of its CPU, the last's health, a digest."""
    with TemporaryDirectory() as folder:
        before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(
            [sys.executable, __file__, "--one", solver, results, folder, *samples],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        after, ended = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        status = json.loads(Path(folder, samples[-1], "status.json").read_text())
        files = sorted(Path(folder).glob("*/*.f32"))
        digest = hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()
    return {
        "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "wall_s": ended - begun,
        "measures": status["attempts"][-1]["measures"],
        "digest": digest[:8],
    }


def main(solvers: Sequence[str], results: str, samples: Sequence[str], runs: int = 1) -> None:
    """Print a row per sample, solver and run, then one per solver of all, and ratios of times."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print("sample\tsolver\tcpu_s\twall_s\tdigest\t" + "\t".join(MEASURES))
    totals = {solver: {"cpu_s": 0.0, "wall_s": 0.0} for solver in solvers}
    first, last = solvers[0], solvers[-1]
    for solver in solvers:
        run(solver, results, samples[0])  # compiles the kernels, once on each machine
    for sample, solver in product(samples, solvers):
        for _ in range(runs):
            done = run(solver, results, sample)
            for name in totals[solver]:
                totals[solver][name] += done[name]
            numbers = "\t".join(f"{done['measures'][name]:.4f}" for name in MEASURES)
            times = f"{done['cpu_s']:.1f}\t{done['wall_s']:.1f}"
            print(f"{sample}\t{solver}\t{times}\t{done['digest']}\t{numbers}", flush=True)
    together = {solver: run(solver, results, *samples) for solver in solvers}
    for solver, done in together.items():
        print(f"all\t{solver}\t{done['cpu_s']:.1f}\t{done['wall_s']:.1f}\t{done['digest']}")
    for what, times in (("each by itself", totals), ("all in one process", together)):
        for name in ("cpu_s", "wall_s"):
            print(f"{what}, {name}, {first} / {last}: {times[first][name] / times[last][name]:.1f}")


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        simulate(*sys.argv[2:])
    elif sys.argv[1] == "--gpu":
        main(["xpbd", "xpbd on a GPU"], sys.argv[2], sys.argv[3:], runs=2)
    else:
        main(["blender", "xpbd"], sys.argv[1], sys.argv[2:])
