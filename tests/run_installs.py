"""Install drapeline with pip into empty environments and use it there: `make test-install`.

The reader on every Python of `READER` that this machine has, and each extra on the Python that runs
this script. Takes packages from where pip is set up to take them.
"""

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from toys.installed import PIPELINE, READ, TORCH, copy_library, write_files

READER = ("3.10", "3.11", "3.12", "3.13")
# pyenv keeps each version in a folder, where it is found even if it is not the chosen one.
FOLDERS = [*os.get_exec_path(), *map(str, Path.home().glob(".pyenv/versions/*/bin"))]


def find_python(version: str) -> str | None:
    """A Python of a version that starts and can make environments."""
    for folder in FOLDERS:
        python = Path(folder) / f"python{version}"
        # Wrappers of pyenv are there for versions that are not chosen, and fail.
        if not python.is_file():
            continue
        if not subprocess.run([python, "-c", "import venv"], capture_output=True).returncode:
            return str(python)
    return None


def use(python: str, library: str, program: str, *arguments: Path) -> bool:
    """Install the library, or `library[extra]`, into an empty environment and use it."""
    started = time.perf_counter()
    with TemporaryDirectory() as folder:
        subprocess.run([python, "-m", "venv", folder], check=True)
        inside = f"{folder}/bin/python"
        kept = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        for command in (
            [inside, "-m", "pip", "install", "--quiet", library],
            [inside, "-c", program, *map(str, arguments)],
        ):
            done = subprocess.run(command, cwd=folder, env=kept, capture_output=True, text=True)
            if done.returncode:
                print(done.stdout, done.stderr, sep="\n")
                return False
    print(f"fine ({time.perf_counter() - started:.0f} s)")
    return True


def main() -> int:
    """Returns 1 if anything cannot be installed or used."""
    failed = False
    with TemporaryDirectory() as folder, TemporaryDirectory() as copied:
        files = write_files(Path(folder))
        library = str(copy_library(Path(copied)))
        for version in READER:
            print(f"pip install . on Python {version}: ", end="", flush=True)
            python = find_python(version)
            if python is None:
                print("not on this machine")
                continue
            failed |= not use(python, library, READ, files["samples"], files["body"])
        for what, *use_it in (
            ("[torch]", TORCH, files["samples"], files["model"]),
            ("[pipeline]", PIPELINE),
        ):
            print(f"pip install .{what}: ", end="", flush=True)
            failed |= not use(sys.executable, f"{library}{what}", *use_it)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
