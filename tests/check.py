"""Run the tests that what changed since a commit can reach, the nearest first: `make check`.

Tests that would begin later than some time after the first are skipped; pytest says how many.
"""

import argparse
import subprocess
import sys

from toys.reach import ROOT, TESTS, changed_files, tests_near

# Makes an experiment first.
TOO_LONG = [TESTS / "workflow/test_end_to_end.py"]
MOST_FILES = 40  # imported in the time; of what everything uses, the nearest tests will do


def main() -> int:
    """Returns pytest's exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--changed", default="HEAD", help="commit that the files are compared with")
    parser.add_argument("--seconds", type=float, default=40, help="in which tests begin")
    asked = parser.parse_args()
    files = [test for test in tests_near(changed_files(asked.changed)) if test not in TOO_LONG]
    if not files:
        print(f"No test can be reached from what has changed since {asked.changed}.")
        return 0
    print(f"{len(files)} files of tests are within reach, the nearest {MOST_FILES} are run.")
    command = [sys.executable, "-m", "pytest", "-q", "--seconds", str(asked.seconds)]
    command += ["-n", "2", "--dist", "loadfile", "--no-loadscope-reorder"]
    command += map(str, files[:MOST_FILES])
    return subprocess.run(command, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
