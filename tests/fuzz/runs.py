"""One damaged file after the other, each read in a child with limits on memory and time."""

import faulthandler
import json
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drapeline.errors import InputError
from drapeline.seeding import rng_for
from fuzz.mutations import CANARY, mutate

_ALLOWANCE = 200 << 20  # bytes a loader may ask for, besides three times the file
SECONDS = 10
_LONGEST = 1100  # characters of a message, besides the file's name


@dataclass(frozen=True)
class Loader:
    """Something that reads files.

    Attributes:
        name: of the loader, and of the folder of its files.
        make: writes honest files into a folder.
        load: reads them, given the folder.
        damaged: patterns of the files to damage, in the folder, separated by spaces.
    """

    name: str
    make: Callable[[Path], Any]
    load: Callable[[Path], Any]
    damaged: str = "*"


@dataclass(frozen=True)
class Outcome:
    """What became of a case.

    Attributes:
        loader, number: the case.
        kind: "read", "refused", or what went wrong: "traceback", "message", "memory", "crash",
            "hang", "payload".
        told: the message, or the end of the traceback.
    """

    loader: str
    number: int
    kind: str
    told: str = ""

    @property
    def fine(self) -> bool:
        """Whether the file was read or refused as it should be."""
        return self.kind in ("read", "refused")


def warm_up(loader: Loader, files: Path, scratch: Path) -> None:
    """Read the honest files in this process: what is loaded once is not a child's memory."""
    folder = scratch / f"{loader.name}_honest"
    shutil.copytree(files / loader.name, folder)
    loader.load(folder)
    shutil.rmtree(folder)


def run_case(loader: Loader, number: int, seed: int, files: Path, scratch: Path) -> Outcome:
    """Damage a file of a loader and read it in a child process.

    Args:
        loader: of `LOADERS`.
        number: of the case, which with the seed decides about the damage.
        seed: of the run.
        files: where `make_files` wrote the honest files.
        scratch: an empty folder, which is left empty.
    """
    folder = scratch / f"{loader.name}_{number}"
    shutil.copytree(files / loader.name, folder, copy_function=os.link)
    try:
        rng = rng_for(seed, "fuzz", loader.name, number)
        choice = sorted(
            p for pattern in loader.damaged.split() for p in folder.glob(pattern) if p.is_file()
        )
        damaged = choice[rng.integers(len(choice))]
        largest = max(p.stat().st_size for p in choice)
        if number:  # the first case is the honest file
            mutate(damaged, rng)
        size = max(damaged.stat().st_size, largest)
        kind, told = _in_child(loader, folder, damaged, size, honest=not number)
        if (folder / CANARY).exists():
            kind, told = "payload", "a payload was run"
        return Outcome(loader.name, number, kind, told)
    finally:
        shutil.rmtree(folder)


def _in_child(
    loader: Loader, folder: Path, damaged: Path, size: int, *, honest: bool
) -> tuple[str, str]:
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            faulthandler.disable()  # a crash is told by its signal
            _limit(size)
            os.chdir(folder)
            sys.stdout = sys.stderr = open(os.devnull, "w")  # noqa: SIM115
            found = _read(loader, folder, damaged, honest)
            os.write(writing, json.dumps(found).encode()[:60_000])
        finally:
            os._exit(0)
    os.close(writing)
    # A child that sleeps uses no processor time, so the clock counts as well.
    return _answer(child, reading, time.monotonic() + 3 * SECONDS)


def _limit(size: int) -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    most = used + 3 * size + _ALLOWANCE
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _read(loader: Loader, folder: Path, damaged: Path, honest: bool) -> tuple[str, str]:
    try:
        loader.load(folder)
    except InputError as error:
        told = str(error)
        if _ran_out(error):
            return "memory", told
        if honest:
            return "traceback", f"the honest file is refused: {told}"
        plain = told.replace(str(damaged), "").replace(str(folder), "")
        if len(plain) > _LONGEST or len(told.splitlines()) != 1 or not told.isprintable():
            return "message", told[:2000]
        # Files that have to agree may each be named, but the folder they are in is not enough.
        named = any(path.name in told for path in folder.rglob("*") if path.is_file())
        return ("refused" if str(folder) in told and named else "message"), told
    except MemoryError:
        return "memory", traceback.format_exc()[-3000:]
    except BaseException:
        return "traceback", traceback.format_exc()[-3000:]
    return "read", ""


def _ran_out(error: BaseException) -> bool:
    """Whether it comes of too little memory, which torch tells by another exception."""
    chain: list[BaseException] = []
    while error is not None and error not in chain:
        chain.append(error)
        error = error.__cause__ or error.__context__
    return any(isinstance(e, MemoryError) or "allocate memory" in str(e) for e in chain)


def _answer(child: int, reading: int, deadline: float) -> tuple[str, str]:
    data = b""
    os.set_blocking(reading, False)
    status = None
    while status is None:
        ended, code = os.waitpid(child, os.WNOHANG)
        with suppress(BlockingIOError):
            data += os.read(reading, 1 << 16)
        if ended:
            status = code
        elif time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            os.close(reading)
            return "hang", f"no end after {3 * SECONDS} s"
        else:
            time.sleep(0.001)
    while more := os.read(reading, 1 << 16):
        data += more
    os.close(reading)
    if data:
        kind, told = json.loads(data)
        return kind, told
    ending = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    if ending in (signal.SIGXCPU, signal.SIGKILL):
        return "hang", f"more than {SECONDS} s of the processor"
    return "crash", f"ended by signal {ending}, status {status}"
