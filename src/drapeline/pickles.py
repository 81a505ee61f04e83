"""A look at a pickle's instructions before they are carried out: none may ask for too much.

Python's own reader takes memory as a pickle says, before it looks at what follows: ten bytes are
enough to ask for gigabytes.
"""

import pickletools
from collections.abc import Iterator
from typing import NamedTuple

# Instructions that no file of arrays has: objects by number, by class (protocol 0), out of band.
_UNKNOWN = {"PERSID", "INST", "OBJ", "EXT1", "EXT2", "EXT4", "NEXT_BUFFER", "READONLY_BUFFER"}
_MEMO = {"PUT": None, "BINPUT": 1, "LONG_BINPUT": 4}
_LENGTH_BYTES = {
    pickletools.TAKEN_FROM_ARGUMENT1: 1,
    pickletools.TAKEN_FROM_ARGUMENT4: 4,
    pickletools.TAKEN_FROM_ARGUMENT4U: 4,
    pickletools.TAKEN_FROM_ARGUMENT8U: 8,
}
_TWO_LINES = {"GLOBAL"}


class _Instruction(NamedTuple):
    name: str
    size: int  # of its argument: bytes, or pickletools' number for a kind of size


_INSTRUCTIONS = {
    ord(one.code): _Instruction(one.name, 0 if one.arg is None else one.arg.n)
    for one in pickletools.opcodes
    if one.name not in _UNKNOWN
}


def pickle_end(data: bytes, start: int = 0) -> int:
    """Where the pickle that starts there ends.

    Raises:
        ValueError: an instruction is unknown or cut off, asks for more bytes than there are, or
            counts objects that it has not made.
    """
    for count, (name, begin, end) in enumerate(_instructions(data, start)):
        if name in _MEMO:
            argument = data[begin:end]
            binary = _MEMO[name] is not None
            index = int.from_bytes(argument, "little") if binary else int(argument[:20])
            if not 0 <= index <= count:
                raise ValueError(f"object {index} is kept, after {count} instructions")
        elif name == "FRAME":
            size = int.from_bytes(data[begin:end], "little")
            if size > len(data) - end:
                raise ValueError(f"a frame of {size} bytes, {len(data) - end} are left")
        elif name == "STOP":
            return end
    raise ValueError("it is cut off")


def _instructions(data: bytes, place: int) -> Iterator[tuple[str, int, int]]:
    """Names of instructions, and where their arguments start and end."""
    while place < len(data):
        instruction = _INSTRUCTIONS.get(data[place])
        if instruction is None:
            raise ValueError(f"byte {place} is no instruction of a file of arrays")
        name, size = instruction
        place += 1
        if size == pickletools.UP_TO_NEWLINE:
            end = data.index(b"\n", place) + 1
            if name in _TWO_LINES:
                end = data.index(b"\n", end) + 1
        elif size < 0:
            width = _LENGTH_BYTES[size]
            end = place + width + int.from_bytes(data[place : place + width], "little")
        else:
            end = place + size
        if end > len(data):
            raise ValueError(
                f"{name} at byte {place - 1} asks for {end - len(data)} bytes too many"
            )
        yield name, place, end
        place = end
