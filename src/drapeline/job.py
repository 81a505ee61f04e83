"""Jobs of models: functions that rules run by their names."""

from importlib import import_module
from typing import Any, NamedTuple

from drapeline.errors import InputError


class Job(NamedTuple):
    """What a function is given that a rule runs.

    Attributes:
        input: files by name, as attributes and by `[]`; one may be a list.
        output: likewise; `output[0]` is the only one where there is one.
        params: what else the function is told, as attributes.
        threads: of the processor.
        code: digest of the code that the function runs.
        progress: folder for work under way, which outlives the job.
    """

    input: Any
    output: Any
    params: Any
    threads: int = 1
    code: str = ""
    progress: str = ""


def resolve(name: str) -> Any:
    """What `package.module:name` names.

    Raises:
        InputError: the module cannot be imported, or has nothing of that name.
    """
    module, _, inner = name.partition(":")
    try:
        found = import_module(module)
    except ImportError as error:
        raise InputError(f"{name}: cannot be imported ({error})") from error
    if not hasattr(found, inner):
        raise InputError(f"{name}: no such name, expected one that the module has")
    return getattr(found, inner)
