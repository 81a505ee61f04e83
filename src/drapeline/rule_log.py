"""Log files of rules, and user errors reported as a single sentence."""

import logging
import os
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sized
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from drapeline.errors import DamagedFile, InputError
from drapeline.frames import GENDERS
from drapeline.storage import output_of

Item = TypeVar("Item")
LOGGER = logging.getLogger("drapeline")


class _LogFile(logging.FileHandler):
    """A log that may end early on a full disk, which is not what its job ends with."""

    def __init__(self, path: str) -> None:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        # Lightning runs the script again for each further device; those processes only append.
        if os.environ.get("LOCAL_RANK", "0") == "0":
            Path(path).write_text("")
        super().__init__(path)

    def handleError(self, record: logging.LogRecord) -> None:
        """Nothing where the disk is full or gone."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)

    def close(self) -> None:
        """Let go of the file, with what could not be written."""
        with suppress(OSError):
            super().close()


@contextmanager
def rule_log(path: str) -> Iterator[logging.Logger]:
    """Send the messages and errors of the block to the log file `path`.

    An InputError, or an operating-system error such as a full disk, ends the job with a single
    sentence on the terminal and the traceback in the log; where a file is damaged that a rule made,
    it says what to delete. Any other exception is a bug and is
    re-raised, so its traceback appears in both places.
    """
    try:
        handler = _LogFile(path)
    except OSError as error:
        sys.exit(f"drapeline: {path}: cannot be written ({error.strerror})")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s", "%H:%M:%S"))
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    started = time.perf_counter()
    usual, threading.excepthook = threading.excepthook, _log_thread
    try:
        yield LOGGER
        LOGGER.info("done in %.1f s", time.perf_counter() - started)
    except (InputError, OSError) as error:
        LOGGER.exception("%s", error)
        sys.exit(f"drapeline: {error}{_remedy(error, Path(path))}")
    except BaseException as error:
        LOGGER.exception("%s: %s", type(error).__name__, error)
        raise
    finally:
        threading.excepthook = usual
        LOGGER.removeHandler(handler)
        handler.close()


def _log_thread(failed: threading.ExceptHookArgs) -> None:
    """Log what a thread of a library died of; whoever waits for the thread raises it again."""
    if failed.exc_value is not None:
        LOGGER.error("in another thread: %s", failed.exc_value, exc_info=failed.exc_value)


def _remedy(error: Exception, log: Path) -> str:
    """Advice on a damaged file that is the user's own no more than the log is."""
    if not isinstance(error, DamagedFile):
        return ""
    path = error.path
    results = next((folder.parent for folder in log.parents if folder.name == "logs"), None)
    if results is not None and results in path.parents:
        path = output_of(path, results)
    elif path not in _BAKED:
        return ""
    return f"; delete {path} and give the same command again, which makes it anew"


_BAKED = [Path("resources/body", f"{gender}.npz") for gender in GENDERS]


def progress(items: Iterable[Item], *, total: int | None = None, label: str) -> Iterator[Item]:
    """Iterate with a progress bar on a terminal and a log message every ten seconds."""
    if total is None and isinstance(items, Sized):
        total = len(items)
    if sys.stderr.isatty():
        from tqdm import tqdm  # here, because every job imports this module and few draw a bar

        items = tqdm(items, total=total, desc=label)
    last = started = time.perf_counter()
    for index, item in enumerate(items):
        yield item
        now = time.perf_counter()
        if now - last > 10:
            last = now
            rate = (index + 1) / (now - started)
            LOGGER.info("%s: %d of %s, %.1f per s", label, index + 1, total or "?", rate)
