"""Log files of rules, and user errors reported as a single sentence."""

import logging
import os
import sys
import time
from collections.abc import Iterable, Iterator, Sized
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from drapeline.errors import InputError

Item = TypeVar("Item")
LOGGER = logging.getLogger("drapeline")


@contextmanager
def rule_log(path: str) -> Iterator[logging.Logger]:
    """Send the messages and errors of the block to the log file `path`.

    An InputError, or an operating-system error such as a full disk, ends the job with a single
    sentence on the terminal and the traceback in the log. Any other exception is a bug and is
    re-raised, so its traceback appears in both places.
    """
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    # Lightning runs the script again for each further device; those processes only append.
    if os.environ.get("LOCAL_RANK", "0") == "0":
        Path(path).write_text("")
    handler = logging.FileHandler(path)
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s", "%H:%M:%S"))
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    started = time.perf_counter()
    try:
        yield LOGGER
        LOGGER.info("done in %.1f s", time.perf_counter() - started)
    except (InputError, OSError) as error:
        LOGGER.exception("%s", error)
        sys.exit(f"drapeline: {error}")
    except BaseException as error:
        LOGGER.exception("%s: %s", type(error).__name__, error)
        raise
    finally:
        LOGGER.removeHandler(handler)
        handler.close()


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
