"""Run the portable tests as another processor would: `make test-portable`.

By default as the oldest one, since it differs most from the machine's own, which `make test` shows.
With `--all` as several, the tiny experiment included; it ends with the comparisons that pass by the
narrowest margins between them. Other arguments go to pytest.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from portable.margins import FILE, margins

SHOWN = 10
# MKL and oneDNN, which torch calls, choose their instructions by themselves.
TORCH = {
    "own": {},
    "avx2": {
        "ATEN_CPU_CAPABILITY": "avx2",
        "MKL_ENABLE_INSTRUCTIONS": "AVX2",
        "ONEDNN_MAX_CPU_ISA": "AVX2",
    },
    "default": {
        "ATEN_CPU_CAPABILITY": "default",
        "MKL_ENABLE_INSTRUCTIONS": "SSE4_2",
        "ONEDNN_MAX_CPU_ISA": "SSE41",
    },
}
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
CHOSEN = {*TORCH["avx2"], *THREADS, "OPENBLAS_CORETYPE"}

# Instructions of torch, threads, and kernels of OpenBLAS, which NumPy and SciPy call. All values,
# each with two of every other kind where there are two, in place of all combinations. What the
# machine does by itself in one thread is `make test`.
OLDEST = ("default", 1, "Prescott")
PROCESSORS = [OLDEST, ("own", 2, "own"), ("avx2", 2, "Haswell"), ("avx2", 1, "own")]
# The tiny experiment takes as long as all else.
END_TO_END = "tests/workflow/test_end_to_end.py"
RECORD = ["-p", "portable.margins", "-o", "enable_assertion_pass_hook=true"]


def environment(torch: str, threads: int, openblas: str) -> dict[str, str]:
    """Variables that make the libraries work as on another processor."""
    kept = {name: value for name, value in os.environ.items() if name not in CHOSEN}
    kernels = {} if openblas == "own" else {"OPENBLAS_CORETYPE": openblas}
    # Threads that wait for work must not keep other tests' threads from the few cores there are.
    return {
        **kept,
        **TORCH[torch],
        **dict.fromkeys(THREADS, str(threads)),
        **kernels,
        "OMP_WAIT_POLICY": "passive",
        "PYTHONPATH": str(Path(__file__).parents[1]),
    }


def run_as(processor: tuple[str, int, str], options: list[str], **more: str) -> int:
    """Run the portable tests as a processor would; returns pytest's exit code."""
    torch, threads, openblas = processor
    print(f"torch {torch}, OpenBLAS {openblas}, threads {threads}: ", end="", flush=True)
    started = time.perf_counter()
    command = [sys.executable, "-m", "pytest", "-q", "-m", "portable", "-n", "2"]
    done = subprocess.run(
        [*command, "--dist", "loadfile", "--no-loadscope-reorder", *options],
        env=environment(*processor) | more,
        stdout=subprocess.PIPE,
        text=True,
    )
    *lines, last = done.stdout.strip().splitlines()
    print(last, f"({time.perf_counter() - started:.0f} s)")
    if done.returncode:
        print(*lines, sep="\n")
    return done.returncode


def run_as_all(options: list[str]) -> int:
    """Run as each processor, print the narrowest margins between them; returns 1 if any fails."""
    failed = 0
    with TemporaryDirectory() as folder:
        recorded = Path(folder) / "comparisons"
        recorded.touch()
        for processor in PROCESSORS:
            others = [] if processor == OLDEST else ["--ignore", END_TO_END]
            failed |= bool(run_as(processor, [*RECORD, *others, *options], **{FILE: str(recorded)}))
        found = margins(recorded.read_text().splitlines())
    print(f"{len(found)} comparisons. Distance to the limit over the spread seen, the least first:")
    for margin in found[:SHOWN]:
        print(f"{margin.ratio:9.3g} = {margin.distance:.3g} / {margin.spread:.3g}  {margin.where}")
    return failed


def main() -> int:
    """Returns 1 if a test fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--all", action="store_true", help="as several processors")
    asked, options = parser.parse_known_args()
    if asked.all:
        return run_as_all(options)
    return int(bool(run_as(OLDEST, ["--ignore", END_TO_END, *options])))


if __name__ == "__main__":
    sys.exit(main())
