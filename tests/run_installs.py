"""Install drapeline with pip into empty environments and use it there: `make test-install`.

The reader on every Python of `READER` that this machine has, each extra on the Python that runs
this script, and on the Python of the newer Blender the unit tests of all that needs no torch. Takes
packages from where pip is set up to take them.
"""

import os
import re
import subprocess
import sys
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from toys.installed import PIPELINE, READ, ROOT, TORCH, copy_library, write_files

READER = ("3.10", "3.11", "3.12", "3.13")
NEWER_BLENDER = "3.13"
NEED_TORCH = {"torch", "anny", "pytorch-lightning", "smplx", "torch-geometric"}
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


def use(python: str, packages: Sequence[str], *arguments: str | Path, cwd: Path) -> bool:
    """Install packages into an empty environment and start its Python there."""
    started = time.perf_counter()
    with TemporaryDirectory() as folder:
        subprocess.run([python, "-m", "venv", folder], check=True)
        inside = f"{folder}/bin/python"
        kept = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        for command in (
            [inside, "-m", "pip", "install", "--quiet", *packages],
            [inside, *map(str, arguments)],
        ):
            done = subprocess.run(command, cwd=cwd, env=kept, capture_output=True, text=True)
            if done.returncode:
                print(done.stdout, done.stderr, sep="\n")
                return False
    print(f"fine ({time.perf_counter() - started:.0f} s)")
    return True


def without_torch() -> list[str]:
    """Requirements of the pipeline and of its tests, but for those that need torch."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    asked = [*extras["torch"], *extras["pipeline"], *extras["dev"]]
    return [one for one in asked if re.match(r"[\w-]+", one)[0] not in {*NEED_TORCH, "drapeline"}]


def locked_torch() -> str:
    """The locked version, of which there is a build without CUDA where the project is tested."""
    lock = (ROOT / "requirements.lock").read_text()
    return re.search(r"^torch==.*$", lock, re.MULTILINE)[0]


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
            read = ("-c", READ, files["samples"], files["body"])
            failed |= not use(python, [library], *read, cwd=Path(folder))
        for what, *use_it in (
            ("[torch]", TORCH, files["samples"], files["model"]),
            ("[pipeline]", PIPELINE),
        ):
            print(f"pip install .{what}: ", end="", flush=True)
            packages = [f"{library}{what}", locked_torch()]
            failed |= not use(sys.executable, packages, "-c", *use_it, cwd=Path(folder))
        print(f"unit tests without torch on Python {NEWER_BLENDER}: ", end="", flush=True)
        python = find_python(NEWER_BLENDER)
        if python is None:
            print("not on this machine")
        else:
            pytest = ("-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider")
            rooms = sorted(path for path in (ROOT / "tests/unit").iterdir() if path.is_dir())
            rooms = [room for room in rooms if room.name != "models"]
            failed |= not use(python, [library, *without_torch()], *pytest, *rooms, cwd=ROOT)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
