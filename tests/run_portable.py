"""Run the portable tests as several processors would: `make test-portable`.

Ends with the comparisons that pass by the narrowest margins. Arguments go to pytest.
"""

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from margins import FILE, margins

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
# The tiny experiment takes as long as all else, so only the oldest processor makes it once more.
END_TO_END, WHOLE = "tests/workflow/test_end_to_end.py", "default"
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
CHOSEN = {*TORCH["avx2"], *THREADS, "OPENBLAS_CORETYPE"}

# Instructions of torch, threads, and kernels of OpenBLAS, which NumPy and SciPy call. All values,
# each with two of every other kind where there are two, in place of all combinations. What the
# machine does by itself in one thread is `make test`.
PROCESSORS = [
    ("own", 2, "own"),
    ("avx2", 2, "Haswell"),
    ("avx2", 1, "own"),
    ("default", 1, "Prescott"),
]


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
        "PYTHONPATH": str(Path(__file__).parent),
    }


def main(arguments: list[str]) -> int:
    """Run pytest once for each processor; returns 1 if a test fails on any."""
    failed = 0
    with TemporaryDirectory() as folder:
        recorded = Path(folder) / "comparisons"
        recorded.touch()
        command = [sys.executable, "-m", "pytest", "-q", "-m", "portable", "-n", "2"]
        command += ["--dist", "loadfile", "--no-loadscope-reorder"]
        command += ["-p", "margins", "-o", "enable_assertion_pass_hook=true", *arguments]
        for torch, threads, openblas in PROCESSORS:
            print(f"torch {torch}, OpenBLAS {openblas}, threads {threads}: ", end="", flush=True)
            started = time.perf_counter()
            done = subprocess.run(
                command if torch == WHOLE else [*command, "--ignore", END_TO_END],
                env={**environment(torch, threads, openblas), FILE: str(recorded)},
                stdout=subprocess.PIPE,
                text=True,
            )
            *lines, last = done.stdout.strip().splitlines()
            print(last, f"({time.perf_counter() - started:.0f} s)")
            if done.returncode:
                print(*lines, sep="\n")
                failed = 1
        found = margins(recorded.read_text().splitlines())
    print(f"{len(found)} comparisons. Distance to the limit over the spread seen, the least first:")
    for margin in found[:SHOWN]:
        print(f"{margin.ratio:9.3g} = {margin.distance:.3g} / {margin.spread:.3g}  {margin.where}")
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
