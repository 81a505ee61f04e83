"""CPU time and health of the two cloth solvers, on the same samples.

OMP_NUM_THREADS=1 .venv/bin/python bench/cloth_solvers.py results 00002 00003

The folder is that of an experiment that has made its outfits. Each sample is simulated by both
solvers, one after the other, each in a process of its own on one core, with the default settings of
`simulation` and a single attempt. Times are of that process's processor, from its start to its end:
imports, the transition, the measures of every frame and the files included.
"""

import json
import os
import resource
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

SOLVERS = {"blender": "drapeline.blender.solver", "xpbd": "drapeline.xpbd.solver"}
SETTINGS = {
    "steps_min": 14,
    "steps_max": 14,
    "shape_frames": 4,
    "pose_frames": 8,
    "gap_m": 0.004,
    "collider_share": 0.6,
    "attempts": 1,
}
MEASURES = (
    *("inside_share_mean", "stretch_low", "stretch_high", "slip_m", "layer_share_mean"),
    *("self_share_mean", "acceleration_m_s2"),
)
WIDE = dict.fromkeys(("inside_share_mean", "inside_share_max", "depth_m", "slip_m"), 9.0)


def simulate(solver: str, results: str, sample: str, folder: str) -> None:
    """Simulate one sample by one solver; bounds that nothing breaks let it run to its end."""
    from drapeline.bodies.model import load_body
    from drapeline.bodies.sequence import load_body_sequence
    from drapeline.outfits.outfit import load_outfit
    from drapeline.simulation.attempts import SimulationSettings
    from drapeline.simulation.health import HealthBounds
    from drapeline.simulation.simulate import DressedBody, simulate_outfit

    cloth = import_module(SOLVERS[solver]).cloth_solver(1)
    outfits = Path(results) / "outfits"
    outfit = load_outfit(outfits / f"{sample}.npz", outfits / f"{sample}.json")
    body = Path(results).parent / f"resources/body/{outfit.gender}.npz"
    motion = load_body_sequence(Path(results) / f"bodies/{sample}.npz")
    simulate_outfit(
        folder,
        DressedBody(load_body(body), motion, outfit),
        cloth,
        settings=SimulationSettings(**SETTINGS),
        bounds=HealthBounds(
            **WIDE, stretch_low=0, stretch_high=99, layer_share_mean=1, self_share_mean=1
        ),
    )


def run(solver: str, results: str, sample: str) -> tuple[float, dict[str, float]]:
    """CPU seconds of a process that simulates one sample, and the measures of its health."""
    with TemporaryDirectory() as name:
        folder = f"{name}/{sample}"
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, __file__, "--one", solver, results, sample, folder],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        status = json.loads(Path(folder, "status.json").read_text())
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, status["attempts"][-1]["measures"]


def main(results: str, samples: list[str]) -> None:
    """Print a row per sample and solver, and the ratio of all times."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print("sample\tsolver\tcpu_s\t" + "\t".join(MEASURES))
    totals = dict.fromkeys(SOLVERS, 0.0)
    run("xpbd", results, samples[0])  # compiles the kernels, once on each machine
    for sample in samples:
        for solver in SOLVERS:
            seconds, measures = run(solver, results, sample)
            totals[solver] += seconds
            numbers = "\t".join(f"{measures[name]:.4f}" for name in MEASURES)
            print(f"{sample}\t{solver}\t{seconds:.1f}\t{numbers}", flush=True)
    print(f"blender / xpbd: {totals['blender'] / totals['xpbd']:.1f}")


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        simulate(*sys.argv[2:])
    else:
        main(sys.argv[1], sys.argv[2:])
