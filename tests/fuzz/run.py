"""Read damaged files for a time, and print what is neither read nor refused in one sentence.

PYTHONPATH=src:tests .venv/bin/python -m fuzz.run --minutes 60
PYTHONPATH=src:tests .venv/bin/python -m fuzz.run --seed 1 --loader bvh --case 17   (again)
"""

import argparse
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import count
from pathlib import Path

# Set before NumPy is imported: threads of a child would count as its memory.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MALLOC_ARENA_MAX="1")

from fuzz.loaders import LOADERS, make_files, open_files
from fuzz.runs import Loader, Outcome, run_case, warm_up


def main() -> int:
    """Return 1 if a file was met badly."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--cases", type=int, help="at most so many of each loader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--loader", nargs="+", help="these alone, by their names in loaders.py")
    parser.add_argument("--case", type=int, help="this case alone, to see it again")
    parser.add_argument("--files", type=Path, help="keep the honest files here for the next run")
    given = parser.parse_args()
    loaders = [LOADERS[name] for name in given.loader or LOADERS]
    numbers = count() if given.cases is None else range(given.cases)
    with tempfile.TemporaryDirectory() as folder:
        files = given.files or Path(folder) / "files"
        make_apart(files, loaders)
        for loader in loaders:
            warm_up(loader, files, Path(folder))
        deadline = time.monotonic() + 60 * given.minutes
        found = list(
            _outcomes(
                loaders,
                numbers if given.case is None else [given.case],
                given.seed,
                files,
                Path(folder),
                deadline,
            )
        )
    return _report(found, given.seed)


def make_apart(files: Path, loaders: list[Loader]) -> None:
    """Make the honest files in a child, so that no threads of it are there to be forked."""
    files.mkdir(parents=True, exist_ok=True)
    child = os.fork()
    if child == 0:
        status = 1
        try:
            make_files(files, loaders)
            status = 0
        except BaseException:
            sys.excepthook(*sys.exc_info())
        finally:
            os._exit(status)
    if os.waitpid(child, 0)[1]:
        raise SystemExit("the honest files could not be made")
    open_files(files)


def _outcomes(
    loaders: list[Loader],
    numbers: Iterable[int],
    seed: int,
    files: Path,
    folder: Path,
    deadline: float,
) -> Iterator[Outcome]:
    for number in numbers:
        for loader in loaders:
            if time.monotonic() > deadline:
                return
            outcome = run_case(loader, number, seed, files, folder)
            if not outcome.fine:
                again = f"--seed {seed} --loader {loader.name} --case {number}"
                print(f"{outcome.kind}: {again}\n{outcome.told}\n", flush=True)
            yield outcome


def _report(found: list[Outcome], seed: int) -> int:
    kinds = Counter(outcome.kind for outcome in found)
    print(
        f"{len(found)} cases with seed {seed}: " + ", ".join(f"{n} {k}" for k, n in kinds.items())
    )
    return int(any(not outcome.fine for outcome in found))


if __name__ == "__main__":
    sys.exit(main())
