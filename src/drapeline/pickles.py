"""A look at a pickle's instructions before they are carried out: none may ask for too much.

Python's own reader takes memory as a pickle says, before it looks at what follows: ten bytes are
enough to ask for gigabytes.
"""

import pickletools
from collections.abc import Iterator
from typing import NamedTuple

# Instructions that no file of arrays has: objects by number, by class (protocol 0), out of band.
_UNKNOWN = {"PERSID", "INST", "OBJ", "EXT1", "EXT2", "EXT4", "NEXT_BUFFER", "READONLY_BUFFER"}
_KEEPS = {"PUT", "BINPUT", "LONG_BINPUT"}
_GETS = {"GET", "BINGET", "LONG_BINGET"}
_NUMBERED = _KEEPS | _GETS
_IN_TEXT = {"PUT", "GET"}
_ADDS = {"APPEND", "APPENDS", "SETITEM", "SETITEMS", "ADDITEMS", "BUILD"}
_LENGTH_BYTES = {
    pickletools.TAKEN_FROM_ARGUMENT1: 1,
    pickletools.TAKEN_FROM_ARGUMENT4: 4,
    pickletools.TAKEN_FROM_ARGUMENT4U: 4,
    pickletools.TAKEN_FROM_ARGUMENT8U: 8,
}
_TWO_LINES = {"GLOBAL"}
# Objects that may be walked through in all, and as many more for each byte of the pickle.
_MOST_WALKED, _MOST_PER_BYTE = 1 << 24, 16


class _Instruction(NamedTuple):
    name: str
    size: int  # of its argument: bytes, or pickletools' number for a kind of size
    takes: int  # objects from the stack, beside those above a mark
    to_mark: bool
    gives: bool


def _instruction(one: pickletools.OpcodeInfo) -> _Instruction:
    before = [kind.name for kind in one.stack_before]
    marked = "mark" in before
    takes = len(before) - (2 if marked else 0)
    return _Instruction(
        one.name, 0 if one.arg is None else one.arg.n, takes, marked, bool(one.stack_after)
    )


_INSTRUCTIONS = {
    ord(one.code): _instruction(one) for one in pickletools.opcodes if one.name not in _UNKNOWN
}


class _Made:
    """An object: how many objects are met in a walk through it."""

    __slots__ = ("size",)

    def __init__(self, size: int) -> None:
        self.size = size


class _Stack:
    """The stack of Python's reader, with sizes in place of objects.

    A tuple that holds a tuple twice, which holds another twice, and so on, takes few bytes, but
    with each of them twice as long to walk through, as Python does to find it among keys.
    """

    def __init__(self, most: int) -> None:
        self._left = most
        self._objects: list[_Made | None] = []  # None is a mark
        self._kept: dict[int, _Made | None] = {}

    def carry_out(self, one: _Instruction, index: int, size: int) -> None:
        """Carry out an instruction that names the kept object `index` or has `size` bytes."""
        objects, name = self._objects, one.name
        if name == "MARK":
            objects.append(None)
        elif name == "DUP":
            objects.append(objects[-1])
        elif name == "POP":
            objects.pop()
        elif name == "MEMOIZE":
            self._kept[len(self._kept)] = objects[-1]
        elif name in _KEEPS:
            self._kept[index] = objects[-1]
        elif name in _GETS:
            objects.append(self._kept[index])
        else:
            self._make(one, size)

    def _make(self, one: _Instruction, size: int) -> None:
        objects, walked = self._objects, 0
        if one.to_mark:
            while (above := objects.pop()) is not None:
                walked += above.size
        for _ in range(one.takes - (one.name in _ADDS)):
            walked += objects.pop().size
        self._left -= walked
        if self._left < 0:
            raise ValueError("its objects hold one another too often")
        if one.name in _ADDS:
            objects[-1].size += walked
        elif one.gives:
            objects.append(_Made(1 + size // 8 + walked))


def pickle_end(data: bytes, start: int = 0) -> int:
    """Where the pickle that starts there ends.

    Raises:
        ValueError: an instruction is unknown or cut off, asks for more bytes than there are, for
            an object that is not there, or counts objects that it has not made; or objects hold
            one another so often that a walk through them would not end.
    """
    stack = _Stack(_MOST_WALKED + _MOST_PER_BYTE * (len(data) - start))
    for count, (one, begin, end) in enumerate(_instructions(data, start)):
        index = 0
        if one.name in _NUMBERED:
            argument = data[begin:end]
            text = one.name in _IN_TEXT
            index = int(argument[:20]) if text else int.from_bytes(argument, "little")
            if not 0 <= index <= count:
                raise ValueError(f"object {index} is kept, after {count} instructions")
        elif one.name == "FRAME":
            size = int.from_bytes(data[begin:end], "little")
            if size > len(data) - end:
                raise ValueError(f"a frame of {size} bytes, {len(data) - end} are left")
        elif one.name == "STOP":
            return end
        try:
            stack.carry_out(one, index, end - begin)
        except (AttributeError, IndexError, KeyError):
            raise ValueError(
                f"{one.name} at byte {begin - 1} asks for an object that is not there"
            ) from None
    raise ValueError("it is cut off")


def _instructions(data: bytes, place: int) -> Iterator[tuple[_Instruction, int, int]]:
    """Instructions, and where their arguments start and end."""
    while place < len(data):
        instruction = _INSTRUCTIONS.get(data[place])
        if instruction is None:
            raise ValueError(f"byte {place} is no instruction of a file of arrays")
        name, size = instruction.name, instruction.size
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
        yield instruction, place, end
        place = end
