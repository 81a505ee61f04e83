"""The exception raised for unusable input, and what turns a parser's own exceptions into it."""

import errno
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_LONGEST = 1000  # characters of a message
# Failures of the machine, which say nothing about a file.
_MACHINE_ERRORS = {
    errno.EACCES,
    errno.EIO,
    errno.EMFILE,
    errno.ENFILE,
    errno.ENOMEM,
    errno.EPERM,
    errno.ESTALE,
    errno.ETIMEDOUT,
}


class InputError(ValueError):
    """A file or value supplied by the user is unusable.

    The message is a single sentence naming the file, the offending value and what was expected;
    rules print it on the terminal without a traceback. What it quotes from a file may be anything:
    line breaks and control characters are escaped, and long messages lose their middle.
    """

    def __init__(self, message: object) -> None:
        super().__init__(_one_line(str(message)))


class DamagedFile(InputError):
    """A file is missing, cut off, overwritten, or not of its format."""

    def __init__(self, path: str | Path, problem: str) -> None:
        super().__init__(f"{path}: {problem}")
        self.path = Path(path)


def _one_line(text: str) -> str:
    if len(text) > _LONGEST:
        text = f"{text[: _LONGEST - 300]} ... {text[-300:]}"
    if text.isprintable():
        return text
    shown = (c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return "".join(shown)


def _refuse_irregular(path: Path, expected: str) -> None:
    """Refuse pipes and devices, which have no end, or none that comes by itself."""
    mode = path.stat().st_mode if path.exists() else stat.S_IFREG
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise InputError(f"{path}: a pipe, socket or device, expected {expected} in a file")


@contextmanager
def refuse_damage(path: str | Path, expected: str) -> Iterator[None]:
    """Turn whatever the block raises into a DamagedFile: it can fail in any way.

    Only what parses a file belongs in the block. Exhausted memory is not the file's fault, since
    sizes are checked before memory is asked for, and passes. Where the machine fails, as by a lack
    of permission or of handles, it is an InputError that calls no file damaged.

    Args:
        expected: what it should be, such as "YAML".

    Raises:
        InputError: see above; or the path leads to a pipe or a device, which is not waited for.
    """
    try:
        _refuse_irregular(Path(path), expected)
        yield
    except (InputError, MemoryError):
        raise
    except FileNotFoundError as error:
        raise DamagedFile(path, f"no such file, expected {expected}") from error
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _MACHINE_ERRORS:
            raise InputError(
                f"{path}: cannot be read ({error.strerror}), expected the system to let it be read;"
                " the file itself may be intact"
            ) from error
        lines = (getattr(error, "strerror", None) or str(error)).strip().splitlines()
        reason = lines[0][:200] if lines else type(error).__name__
        raise DamagedFile(path, f"not readable as {expected} ({reason})") from error
