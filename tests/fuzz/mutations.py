"""Damage to files: bytes at random, and lies that fit a file's format.

A mutation takes the bytes of an honest file and a generator, and returns other bytes. The hostile
ones carry a payload that leaves a file behind if anything runs it.
"""

import io
import json
import pickle
import re
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Rng = np.random.Generator
Mutation = Callable[[bytes, Rng], bytes]
# An executed payload touches this file in the working folder of the case.
CANARY = "payload_was_run"
_NUMBERS = (0, 1, -1, 2, 127, 255, 256, 32767, 65535, 2**31 - 1, -(2**31), 2**32 - 1, 2**63 - 1)
_WORDS = (
    *map(str, _NUMBERS),
    *("nan", "-inf", "1e400", "1e-400", "1e38", "10000000000", "3.0", "0x10", "1_000", "٣"),
    *("", '"', "'", "{", "}", "[" * 300, "é", "\x00", "../../evil", "a b", "x" * 3000, "#", ":"),
    *("9" * 5000, "None", "true", "*", "+", "&a", "*a", "!!python/object/apply:os.system [true]"),
)


class Payload:
    """Pickles to a call that leaves the canary."""

    def __reduce__(self) -> tuple:
        return (open, (CANARY, "w"))


def mutate(path: Path, rng: Rng) -> None:
    """Replace a file by a damaged one; the kind of damage is drawn from those of its format."""
    mutations = _BYTES + _OF_FORMAT.get(path.suffix, ())
    own = len(mutations) - len(_BYTES)
    # Half of all damage knows the format.
    pick = rng.integers(len(_BYTES)) if not own or rng.random() < 0.5 else -1 - rng.integers(own)
    data = mutations[pick](path.read_bytes(), rng)
    path.unlink()
    path.write_bytes(data)


# ---- bytes ----------------------------------------------------------------------------------


def _place(data: bytes, rng: Rng, size: int = 1) -> int:
    """A position; headers stand at the ends, so these are met more often."""
    last = max(len(data) - size, 0)
    kind = rng.integers(4)
    if kind == 0:
        return int(rng.integers(min(last, 128) + 1))
    if kind == 1:
        return last - int(rng.integers(min(last, 512) + 1))
    return int(rng.integers(last + 1))


def _flip(data: bytes, rng: Rng) -> bytes:
    out = bytearray(data)
    for _ in range(rng.integers(1, 8) if data else 0):
        out[_place(data, rng)] ^= 1 << rng.integers(8)
    return bytes(out)


def _set(data: bytes, rng: Rng) -> bytes:
    at = _place(data, rng)
    return data[:at] + bytes([rng.choice([0, 1, 127, 128, 255])]) + data[at + 1 :]


def _number(data: bytes, rng: Rng) -> bytes:
    form = str(rng.choice(["<i", ">i", "<q", "<h", "<f", "<d"]))
    size = struct.calcsize(form)
    value = _NUMBERS[rng.integers(len(_NUMBERS))]
    if form[1] in "fd":
        made = struct.pack(form, rng.choice([np.nan, np.inf, -1e38, 1e30, 0.0]))
    else:
        made = (value % (1 << 8 * size)).to_bytes(size, "little" if form[0] == "<" else "big")
    at = _place(data, rng, size)
    return data[:at] + made + data[at + size :]


def _truncate(data: bytes, rng: Rng) -> bytes:
    return data[: rng.integers(len(data) + 1)]


def _empty(data: bytes, rng: Rng) -> bytes:
    return b""


def _insert(data: bytes, rng: Rng) -> bytes:
    at = _place(data, rng)
    return data[:at] + rng.bytes(int(rng.integers(1, 32))) + data[at:]


def _delete(data: bytes, rng: Rng) -> bytes:
    at = _place(data, rng)
    return data[:at] + data[at + int(rng.integers(1, 64)) :]


def _repeat(data: bytes, rng: Rng) -> bytes:
    at, size = _place(data, rng), int(rng.integers(1, 256))
    return data[:at] + data[at : at + size] * int(rng.integers(2, 5)) + data[at + size :]


def _zeros(data: bytes, rng: Rng) -> bytes:
    at, size = _place(data, rng), int(rng.integers(1, 64))
    return data[:at] + b"\0" * size + data[at + size :]


def _noise(data: bytes, rng: Rng) -> bytes:
    return rng.bytes(int(rng.integers(1, 300)))


_BYTES: tuple[Mutation, ...] = (
    *(_flip, _flip, _flip, _set, _set, _number, _number, _number),
    *(_truncate, _truncate, _empty, _insert, _delete, _repeat, _zeros, _noise),
)

# ---- text -----------------------------------------------------------------------------------


def _word(data: bytes, rng: Rng) -> bytes:
    """Another word in place of one."""
    words = list(re.finditer(rb"[^\s,]+", data))
    if not words:
        return data
    found = words[min(int(rng.exponential(len(words) / 4)), len(words) - 1)]
    word = _WORDS[rng.integers(len(_WORDS))].encode("utf-8")
    return data[: found.start()] + word + data[found.end() :]


def _words(data: bytes, rng: Rng) -> bytes:
    for _ in range(rng.integers(2, 6)):
        data = _word(data, rng)
    return data


def _lines(data: bytes, rng: Rng) -> bytes:
    """A line left out, repeated, moved or cut short."""
    lines = data.split(b"\n")
    at, other = rng.integers(len(lines), size=2)
    kind = rng.integers(4)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(other, lines[at])
    elif kind == 2:
        lines[at], lines[other] = lines[other], lines[at]
    else:
        lines[at] = lines[at][: rng.integers(len(lines[at]) + 1)]
    return b"\n".join(lines)


def _encoding(data: bytes, rng: Rng) -> bytes:
    """The same text in another encoding, or with bytes that are no text."""
    kind = rng.integers(5)
    if kind == 0:
        return b"\xef\xbb\xbf" + data
    if kind == 1:
        return data.decode("latin-1").encode("utf-16")
    if kind == 2:
        return data.replace(b"\n", b"\r\n")
    if kind == 3:
        return data.replace(b"e", b"\xe9", 3)
    return data.replace(b"\n", b"\n\0", 1)


_TEXT: tuple[Mutation, ...] = (_word, _word, _word, _words, _lines, _lines, _encoding)

# ---- JSON and YAML --------------------------------------------------------------------------

_VALUES = (
    None,
    True,
    -1,
    0,
    1.5,
    10**10,
    10**400,
    "",
    "x",
    "../evil",
    [],
    {},
    [[]],
    {"a": 1},
    1e308,
)


def _json_value(data: bytes, rng: Rng) -> bytes:
    """An entry left out, renamed or of another type."""
    value = json.loads(data)
    holder, key = None, None
    place = value
    while isinstance(place, dict | list) and place:
        if holder is not None and rng.random() < 0.3:
            break
        keys = list(place) if isinstance(place, dict) else range(len(place))
        holder, key = place, keys[rng.integers(len(keys))]
        place = place[key]
    other = _VALUES[rng.integers(len(_VALUES))]
    if holder is None:
        return json.dumps(other).encode()
    kind = rng.integers(4)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder, dict):
        holder[f"{key}x"] = holder.pop(key)
    else:
        holder[key] = other
    return json.dumps(value).encode()


def _json_deep(data: bytes, rng: Rng) -> bytes:
    return b"[" * int(rng.choice([900, 100_000])) + data


def _json_nan(data: bytes, rng: Rng) -> bytes:
    numbers = list(re.finditer(rb"-?\d+(\.\d+)?", data))
    if not numbers:
        return data
    found = numbers[rng.integers(len(numbers))]
    word = rng.choice([b"NaN", b"Infinity", b"1e999", b"9" * 5000, b"-0", b"00"])
    return data[: found.start()] + bytes(word) + data[found.end() :]


def _yaml_laughs(data: bytes, rng: Rng) -> bytes:
    """Aliases that a printer would write out by the billion."""
    lines = ["a0: &a0 [ha, ha]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    key = rng.choice(["seed", "joints", "twist_deg", "up", "motions"])
    return data + "\n".join(["", *lines, f"{key}: *a11", ""]).encode()


def _yaml_value(data: bytes, rng: Rng) -> bytes:
    """A value in a line replaced."""
    lines = data.split(b"\n")
    at = int(rng.integers(len(lines)))
    word = _WORDS[rng.integers(len(_WORDS))]
    extra = rng.choice(
        [".nan", ".inf", "3.0", "~", "[]", "{}", "2020-01-01", "!!binary aGk=", "? a"]
    )
    name = lines[at].partition(b":")[0]
    lines[at] = name + b": " + (word if rng.random() < 0.5 else str(extra)).encode()
    return b"\n".join(lines)


def _yaml_key(data: bytes, rng: Rng) -> bytes:
    key = rng.choice(["1", "true", "null", "[a]", "2020-01-01", "é", "1.5", "x" * 2000])
    return data + f"\n{key}: 1\n".encode() + (b"zzz: 2\n" if rng.random() < 0.5 else b"")


# ---- npz and npy ----------------------------------------------------------------------------

_DTYPES = ("|O", "<f2", "<f4", "<f8", "<f16", "<c16", "<M8[s]", "|V8", "|S4", "<U4", "|b1", ">i4")


def _npy_header(header: str, body: bytes = b"") -> bytes:
    text = header.encode("latin-1", "replace")
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + body


def _split_npy(data: bytes) -> tuple[str, bytes]:
    size = 10 + struct.unpack("<H", data[8:10])[0]
    return data[10:size].decode("latin-1"), data[size:]


def _lie(data: bytes, rng: Rng) -> bytes:
    """An array whose header does not say what follows."""
    header, body = _split_npy(data)
    kind = rng.integers(9)
    if kind == 0:
        shape = [(2**40,), (2**31, 2**31, 4), (-1,), (0,), (10**30,), (300_000_000,)]
        lie = re.sub(r"\([^)]*\)", repr(shape[rng.integers(len(shape))]), header)
    elif kind == 1:
        lie = re.sub(r"'descr': '[^']*'", f"'descr': '{rng.choice(_DTYPES)}'", header)
    elif kind == 2:
        lie = re.sub(r"'descr': '[^']*'", "'descr': [('a', '<f4'), ('b', '|O')]", header)
    elif kind == 3:
        lie, body = re.sub(r"'descr': '[^']*'", "'descr': '|O'", header), pickle.dumps(Payload())
    elif kind == 4:
        lie = "(" * int(rng.choice([100, 20_000])) + header
    elif kind == 5:
        lie = re.sub(r"'fortran_order': False", "'fortran_order': True", header)
    elif kind == 6:
        lie = header.replace(
            "{", str(rng.choice(["{'x': 1, ", "[", "__import__('os')", "{{", "'"]))
        )
    elif kind == 7:
        lie = re.sub(r"\d", lambda m: str(rng.integers(10)) if rng.random() < 0.5 else m[0], header)
    else:
        lie = header[: rng.integers(len(header) + 1)]
    return _npy_header(lie.rstrip()[:60_000], body)


def _other_array(array: np.ndarray, rng: Rng) -> np.ndarray:
    """Another array in place of one: values, shape or type."""
    kind = rng.integers(8)
    if kind <= 2 and array.dtype.kind in "fiu" and array.size:
        out = array.copy()
        wild = (
            [np.nan, np.inf, -1e30, 1e30] if out.dtype.kind == "f" else [-1, 10**9, 2**31 - 1, 127]
        )
        with np.errstate(all="ignore"):
            out.reshape(-1)[rng.integers(out.size)] = np.array(wild[rng.integers(4)]).astype(
                out.dtype
            )
        return out
    if kind == 3:
        return array[None]
    if kind == 4 and array.ndim:
        return array[: rng.integers(len(array) + 1)]
    if kind == 5 and array.ndim > 1:
        return np.swapaxes(array, 0, -1)
    if kind == 6:
        with np.errstate(all="ignore"):
            return np.asarray(array, dtype=str) if array.dtype.kind in "fiu" else np.zeros(3)
    others = [np.zeros(0), np.zeros((0, 3)), np.array("x"), np.array(-1), np.array(1e300)]
    others += [np.array(["../../evil"]), np.zeros((2, 2), dtype=[("a", "f4"), ("b", "i4")])]
    others += [np.array([Payload()], dtype=object), np.zeros(30_000_000, np.uint8)]
    return others[rng.integers(len(others))]


def _npy_bytes(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array, allow_pickle=True)
    return stream.getvalue()


def _zip(members: dict[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content, compression)
    return stream.getvalue()


def _members(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def _npz_entry(data: bytes, rng: Rng) -> bytes:
    """One member that is not what it was, in a zip that is sound."""
    members = _members(data)
    name = list(members)[rng.integers(len(members))]
    kind = rng.integers(6)
    if kind <= 1:
        members[name] = _lie(members[name], rng)
    elif kind <= 3:
        array = np.lib.format.read_array(io.BytesIO(members[name]))
        members[name] = _npy_bytes(_other_array(array, rng))
    elif kind == 4:
        del members[name]
    else:
        members[name] = _BYTES[rng.integers(len(_BYTES))](members[name], rng)
    types = [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]
    return _zip(members, types[rng.integers(4)])


def _zip_directory(data: bytes, rng: Rng) -> bytes:
    """Numbers of the directory at the end: sizes, methods, flags."""
    entries = [found.start() for found in re.finditer(b"PK\x01\x02", data)]
    if not entries:
        return data
    out, at = bytearray(data), entries[rng.integers(len(entries))]
    place, form = [
        (6, "<H"),
        (8, "<H"),
        (10, "<H"),
        (20, "<I"),
        (24, "<I"),
        (28, "<H"),
        (42, "<I"),
    ][rng.integers(7)]
    values = [0, 1, 9, 12, 14, 99, 2**16 - 1, 2**31, 2**32 - 1]
    number = int(values[rng.integers(len(values))]) & ((1 << 8 * struct.calcsize(form)) - 1)
    struct.pack_into(form, out, at + place, number)
    return bytes(out)


def _zip_bomb(data: bytes, rng: Rng) -> bytes:
    """A sound array of a gigabyte of zeros, packed a thousandfold."""
    members = _members(data)
    name = list(members)[rng.integers(len(members))]
    stream = io.BytesIO()
    header = _npy_header(f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({1 << 27}, 3), }}")
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for other, content in members.items():
            if other != name:
                archive.writestr(zipfile.ZipInfo(other), content, zipfile.ZIP_DEFLATED)
        with archive.open(zipfile.ZipInfo(name), "w") as member:
            member.write(header)
            for _ in range(12):  # not all of what the header says
                member.write(bytes(1 << 20))
    return stream.getvalue()


def _npy(data: bytes, rng: Rng) -> bytes:
    if rng.random() < 0.6:
        return _lie(data, rng)
    return _npy_bytes(_other_array(np.lib.format.read_array(io.BytesIO(data)), rng))


# ---- safetensors ----------------------------------------------------------------------------


def _safetensors_header(data: bytes, rng: Rng) -> bytes:
    """Another value somewhere in the header, or another text for it."""
    size = int.from_bytes(data[:8], "little")
    kinds = (_json_value, _json_value, _json_value, _json_nan, _json_deep, _number)
    return _with_header(kinds[rng.integers(len(kinds))](data[8 : 8 + size], rng), data[8 + size :])


def _safetensors_metadata(data: bytes, rng: Rng) -> bytes:
    """Another value in what a network is built from, which is JSON within the header's."""
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + size])
    kinds = (_json_value, _json_value, _json_value, _json_nan, _json_deep)
    text = header["__metadata__"]["drapeline"].encode()
    text = kinds[rng.integers(len(kinds))](text, rng)
    header["__metadata__"]["drapeline"] = text.decode(errors="replace")
    return _with_header(json.dumps(header).encode(), data[8 + size :])


def _safetensors_tensor(data: bytes, rng: Rng) -> bytes:
    """Another tensor in place of one, in a sound file."""
    import safetensors.torch
    import torch

    size = int.from_bytes(data[:8], "little")
    metadata = json.loads(data[8 : 8 + size])["__metadata__"]
    tensors = safetensors.torch.load(data)
    _change_entry(tensors, rng)
    kept = {
        name: x.clone(memory_format=torch.contiguous_format)
        for name, x in tensors.items()
        if isinstance(x, torch.Tensor)
    }
    return safetensors.torch.save(kept, metadata)


def _with_header(header: bytes, rest: bytes) -> bytes:
    return len(header).to_bytes(8, "little") + header + rest


# ---- pickles and checkpoints ----------------------------------------------------------------


def _hostile_pickle(data: bytes, rng: Rng) -> bytes:
    """Opcodes that run, build or ask for what no honest file does."""
    made = [
        pickle.dumps({"v_template": Payload()}, protocol=2),
        pickle.dumps(Payload(), protocol=4),
        b"\x80\x02X\x00\x00\x00\x00r\xff\xff\xff\x0f.",  # memo entry 268 million
        b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x0fx.",  # bytes of an exabyte
        b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\x0f}.",  # such a frame
        b"\x80\x02" + b"(" * 100_000 + b".",
        b"\x80\x02" + b"]" * 100_000 + b"a" * 99_999 + b".",
        b"\x80\x02cnumpy\nndarray\n(J\xff\xff\xff\x7f\x85cnumpy\ndtype\nU\x02f8\x85Rt\x81.",
        b"\x80\x02cnumpy.core.multiarray\nscalar\ncnumpy\ndtype\nU\x01O\x85RU\x08\x01\x02\x03\x04\x05"
        b"\x06\x07\x08\x86R.",
        b"\x80\x02cnumpy\ndtype\nU\x02V8\x85R(K\x03U\x01|U\x00U\x01aNK\x08K\x01K\x10tb.",
        b"\x80\x02}U\x01acnumpy\ndtype\nU\x0220000000f8\x85Rs.",
        b"\x80\x02c__builtin__\nset\n(J\xff\xff\xff\x7ft\x81.",
        b"\x80\x02cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nJ\xff\xff\xff\x3f\x85U\x01b"
        b"\x87R.",
        b"cos\nsystem\n(S'touch " + CANARY.encode() + b"'\ntR.",
    ]
    return made[rng.integers(len(made))]


def _spliced_pickle(data: bytes, rng: Rng) -> bytes:
    """A call in the midst of an honest pickle."""
    at = _place(data, rng)
    return data[:at] + b"cbuiltins\nopen\nX\x0f\0\0\0payload_was_runX\x01\0\0\0w\x86R" + data[at:]


def _swapped_type(data: bytes, rng: Rng) -> bytes:
    """Another type of number where one is named."""
    names = list(re.finditer(rb"[fiu][1248]", data))
    if not names:
        return data
    found = names[rng.integers(len(names))]
    word = bytes(rng.choice([b"O8", b"V8", b"M8", b"S2", b"U2", b"c8", b"f2", b"O4"]))
    return data[: found.start()] + word + data[found.end() :]


def _checkpoint(data: bytes, rng: Rng) -> bytes:
    """A sound checkpoint without an entry, or with other values in one."""
    import torch

    try:
        content = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except Exception:  # an honest file of another kind
        return _flip(data, rng)
    _change_entry(content, rng)
    stream = io.BytesIO()
    torch.save(content, stream)
    return stream.getvalue()


def _change_entry(content: Any, rng: Rng) -> None:
    import torch

    holder, key, place = None, None, content
    while isinstance(place, dict | list) and place:
        if holder is not None and rng.random() < 0.2:
            break
        keys = list(place) if isinstance(place, dict) else range(len(place))
        holder, key = place, keys[rng.integers(len(keys))]
        place = place[key]
    if holder is None:
        return
    kind = rng.integers(6)
    if isinstance(place, torch.Tensor) and kind <= 3 and place.numel():
        other = place.clone(memory_format=torch.contiguous_format)
        if kind == 0:
            holder[key] = other[None]
        elif kind == 1 and other.is_floating_point():
            other.view(-1)[rng.integers(other.numel())] = float(rng.choice([np.nan, np.inf, 1e38]))
            holder[key] = other
        elif kind == 2:
            holder[key] = other.reshape(-1)[:1]
        else:
            holder[key] = other.to(torch.int64)
    elif kind == 4:
        del holder[key]
    else:
        holder[key] = _VALUES[rng.integers(len(_VALUES))]


def _hostile_checkpoint(data: bytes, rng: Rng) -> bytes:
    """A payload as a checkpoint of either of torch's formats."""
    import torch

    stream = io.BytesIO()
    torch.save({"drapeline": Payload()}, stream, _use_new_zipfile_serialization=rng.random() < 0.5)
    return stream.getvalue()


def _checkpoint_member(data: bytes, rng: Rng) -> bytes:
    """Damage inside a sound zip, which torch does not pack."""
    try:
        members = _members(data)
    except zipfile.BadZipFile:
        return _flip(data, rng)
    names = [name for name in members if members[name]]
    pickled = [name for name in names if name.endswith("data.pkl")]
    name = pickled[0] if pickled and rng.random() < 0.6 else names[rng.integers(len(names))]
    kinds = (*_BYTES, _hostile_pickle, _spliced_pickle)
    members[name] = kinds[rng.integers(len(kinds))](members[name], rng)
    if rng.random() < 0.1:
        del members[name]
    return _zip(members, zipfile.ZIP_STORED)


# ---- other binary formats -------------------------------------------------------------------


def _header_number(data: bytes, rng: Rng) -> bytes:
    """A number in the first 64 bytes."""
    return _number(data[:64], rng) + data[64:]


def _mat_tag(data: bytes, rng: Rng) -> bytes:
    """The tag of an element: type or size."""
    places = [
        k for k in range(128, len(data) - 8, 8) if 0 < data[k] < 20 and not any(data[k + 1 : k + 2])
    ]
    if not places:
        return _header_number(data, rng)
    at = places[rng.integers(len(places))]
    out = bytearray(data)
    if rng.random() < 0.5:
        out[at] = rng.integers(30)
    else:
        number = _NUMBERS[rng.integers(len(_NUMBERS))] % (1 << 32)
        out[at + 4 : at + 8] = struct.pack("<I", number)
    return bytes(out)


def _mat_inside(data: bytes, rng: Rng) -> bytes:
    """Damage to what an element has packed."""
    import zlib

    at = 128
    elements = []
    while at + 8 <= len(data):
        kind, size = struct.unpack("<II", data[at : at + 8])
        elements.append((at, kind, size))
        at += 8 + size
    packed = [(a, s) for a, k, s in elements if k == 15]
    if not packed:
        return _mat_tag(data, rng)
    at, size = packed[rng.integers(len(packed))]
    inner = zlib.decompress(data[at + 8 : at + 8 + size])
    inner = (_mat_tag if rng.random() < 0.5 else _number)(bytes(128) + inner, rng)[128:]
    again = zlib.compress(inner)
    return data[:at] + struct.pack("<II", 15, len(again)) + again + data[at + 8 + size :]


def _huge_image(data: bytes, rng: Rng) -> bytes:
    """A PNG that says it is 50,000 pixels wide and high."""
    import zlib

    side = int(rng.choice([0, 9_000, 50_000, 2**31 - 1]))
    head = b"IHDR" + struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return data[:12] + head + struct.pack(">I", zlib.crc32(head)) + data[33:]


def _ply_count(data: bytes, rng: Rng) -> bytes:
    """A count of elements that is not the file's."""
    number = str(_NUMBERS[rng.integers(len(_NUMBERS))]).encode()
    found = list(re.finditer(rb"element \w+ (\d+)", data))
    if not found:
        return data
    one = found[rng.integers(len(found))]
    return data[: one.start(1)] + number + data[one.end(1) :]


_NPZ = (_npz_entry, _npz_entry, _npz_entry, _npz_entry, _zip_directory, _zip_bomb)
_CHECKPOINT = (_checkpoint, _checkpoint, _checkpoint_member, _hostile_checkpoint, _zip_directory)
_PICKLE = (_hostile_pickle, _hostile_pickle, _spliced_pickle, _swapped_type)
_CACHE = (_header_number,)
_OF_FORMAT: dict[str, tuple[Mutation, ...]] = {
    **dict.fromkeys((".bvh", ".asf", ".amc", ".obj", ".tsv", ".txt"), _TEXT),
    ".json": (_json_value, _json_value, _json_value, _json_deep, _json_nan, *_TEXT),
    ".yaml": (_yaml_laughs, _yaml_value, _yaml_value, _yaml_value, _yaml_key, *_TEXT),
    ".npz": _NPZ,
    ".npy": (_npy,),
    ".pkl": _PICKLE,
    ".safetensors": (_safetensors_header, _safetensors_metadata, _safetensors_tensor),
    ".pth": _CHECKPOINT,
    **dict.fromkeys((".pc2", ".pc16", ".mdd", ".f32"), _CACHE),
    ".mat": (_mat_tag, _mat_tag, _mat_inside),
    ".png": (_huge_image, _header_number),
    ".ply": (_ply_count, *_TEXT),
}
