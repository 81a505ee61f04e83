"""Run the tests that what changed since a commit can reach, the nearest first: `make check`.

Tests that have not begun within the time are skipped, and pytest says how many.
"""

import argparse
import subprocess
import sys
import time

from toys.reach import ROOT, TESTS, changed_files, tests_near

# Makes an experiment first.
TOO_LONG = [TESTS / "workflow/test_end_to_end.py"]


def main() -> int:
    """Returns pytest's exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--changed", default="HEAD", help="commit that the files are compared with")
    parser.add_argument("--seconds", type=float, default=60, help="when no further test begins")
    asked = parser.parse_args()
    end = time.time() + asked.seconds
    files = [test for test in tests_near(changed_files(asked.changed)) if test not in TOO_LONG]
    if not files:
        print(f"No test can be reached from what has changed since {asked.changed}.")
        return 0
    command = [sys.executable, "-m", "pytest", "-q", "--begin-before", str(end), "-n", "2"]
    command += ["--dist", "loadfile", "--no-loadscope-reorder", *files]
    return subprocess.run(command, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
