"""Install drapeline with pip into empty environments and use it there: `make test-install`.

The reader on every Python of `READER` that this machine has; on the Python that runs this script
each extra as well, and on that of the newer Blender the unit tests of all that needs no torch, one
after the other in the same environment. Two environments at a time. Takes packages from where pip
is set up to take them.
"""

import os
import re
import subprocess
import sys
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from install.first_use import DRESS, PIPELINE, READ, ROOT, TORCH, copy_library, write_files

READER = ("3.10", "3.11", "3.12", "3.13")
NEWER_BLENDER = "3.13"
NEED_TORCH = {"torch", "anny", "pytorch-lightning", "smplx", "torch-geometric"}
# pyenv keeps each version in a folder, where it is found even if it is not the chosen one.
FOLDERS = [*os.get_exec_path(), *map(str, Path.home().glob(".pyenv/versions/*/bin"))]


class Step(NamedTuple):
    """Something to install and to use.

    Attributes:
        what: as it is reported.
        extra: of the library, such as "[torch]", or "".
        packages: to install with it.
        arguments: of Python then.
    """

    what: str
    extra: str
    packages: list[str]
    arguments: list[str | Path]


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


def use(python: str, steps: list[Step]) -> bool:
    """Install into an empty environment and use it, step by step; returns whether it went well."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    with TemporaryDirectory() as folder, TemporaryDirectory() as copied:
        library = copy_library(Path(copied))  # of its own, since pip builds in it
        subprocess.run([python, "-m", "venv", folder], check=True)
        inside = f"{folder}/bin/python"
        # What nobody imports need not be compiled.
        install = [inside, "-m", "pip", "install", "--quiet", "--no-compile"]
        for step in steps:
            started = time.perf_counter()
            for command in (
                [*install, f"{library}{step.extra}", *step.packages],
                [inside, *map(str, step.arguments)],
            ):
                done = subprocess.run(command, cwd=ROOT, env=kept, capture_output=True, text=True)
                if done.returncode:
                    print(f"{step.what}: failed\n{done.stdout}\n{done.stderr}", flush=True)
                    return False
            print(f"{step.what}: fine ({time.perf_counter() - started:.0f} s)", flush=True)
    return True


def without_torch() -> list[str]:
    """Requirements of the pipeline and of its tests, but for those that need torch."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    asked = [*extras["dress"], *extras["torch"], *extras["pipeline"], *extras["dev"]]
    return [one for one in asked if re.match(r"[\w-]+", one)[0] not in {*NEED_TORCH, "drapeline"}]


def locked_torch() -> str:
    """The locked version, of which there is a build without CUDA where the project is tested."""
    lock = (ROOT / "requirements.lock").read_text()
    return re.search(r"^torch==.*$", lock, re.MULTILINE)[0]


def steps_on(version: str, files: dict[str, Path]) -> list[Step]:
    """What is installed and used on a Python."""
    read = ["-I", "-c", READ, files["samples"], files["body"]]
    steps = [Step(f"pip install . on Python {version}", "", [], read)]
    dress = [*DRESS, "-o", files["body"].with_name(f"dressed{version}.glb")]
    steps.append(Step(f"drapeline dress on Python {version}", "[dress]", [], dress))
    if version == "{}.{}".format(*sys.version_info):
        torch = ["-I", "-c", TORCH, files["samples"], files["model"]]
        steps.append(Step("pip install .[torch]", "[torch]", [locked_torch()], torch))
        pipeline = ["-I", "-c", PIPELINE]
        steps.append(Step("pip install .[pipeline]", "[pipeline]", [locked_torch()], pipeline))
    if version == NEWER_BLENDER:
        rooms = sorted(path for path in (ROOT / "tests/unit").iterdir() if path.is_dir())
        pytest = ["-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider"]
        pytest += [room for room in rooms if room.name != "models"]
        what = f"unit tests without torch on Python {version}"
        steps.append(Step(what, "", without_torch(), pytest))
    return steps


def main() -> int:
    """Returns 1 if anything cannot be installed or used."""
    with TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
        files = write_files(Path(folder))
        tried = []
        # The longest first.
        for version in sorted(READER, key=lambda version: len(steps_on(version, files)))[::-1]:
            python = find_python(version)
            if python is None:
                print(f"Python {version}: not on this machine", flush=True)
            else:
                tried.append(pool.submit(use, python, steps_on(version, files)))
        return int(not all([one.result() for one in tried]))


if __name__ == "__main__":
    sys.exit(main())
