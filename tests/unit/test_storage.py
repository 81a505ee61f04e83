import ctypes
import json
import os
import resource
import signal
import subprocess
import sys
import threading
import time
import zipfile
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest

from drapeline import storage
from drapeline.errors import InputError
from drapeline.seeding import rng_for
from drapeline.storage import (
    atomic_file,
    atomic_folder,
    copy_file,
    copy_folder,
    create_array,
    link_or_copy,
    load_npz,
    load_record,
    open_arrays,
    output_of,
    read_json,
    read_rows,
    read_text,
    save_npz,
    save_record,
    sweep,
    write_json,
    write_rows,
)


def test_a_file_that_fails_half_way_leaves_the_old_one_and_no_scraps(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(RuntimeError, match="stop"), atomic_file(target) as scratch:
        scratch.write_text("half")
        raise RuntimeError("stop")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_is_replaced_only_when_it_is_whole(tmp_path):
    target = tmp_path / "sample"
    target.mkdir()
    (target / "old").touch()
    with pytest.raises(RuntimeError, match="stop"), atomic_folder(target) as scratch:
        (scratch / "half").touch()
        raise RuntimeError("stop")
    assert [p.name for p in target.iterdir()] == ["old"]
    with atomic_folder(target) as scratch:
        (scratch / "new").touch()
    assert [p.name for p in target.iterdir()] == ["new"]
    assert list(tmp_path.iterdir()) == [target]


@pytest.fixture(params=["exchange", "aside"])
def way(request, monkeypatch):
    """How folders are replaced: at once, or as where two names cannot be exchanged."""
    if request.param == "aside":
        monkeypatch.setattr(storage, "_exchange", lambda one, other: False)
    elif not hasattr(ctypes.CDLL(None), "renameat2"):
        pytest.skip("the system cannot exchange two names")


def write_parts(folder, word):
    """Two files that belong together."""
    with atomic_folder(folder) as scratch:
        for name in ("a", "b"):
            (scratch / name).write_text(word)


@pytest.mark.usefixtures("way")
def test_of_two_writers_each_leaves_a_whole_folder(tmp_path):
    target, failed = tmp_path / "sample", []

    def write(word):
        try:
            for _ in range(100):
                write_parts(target, word)
        except Exception as error:
            failed.append(error)

    writers = [threading.Thread(target=write, args=(word,)) for word in ("one", "two")]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert not failed
    assert (target / "a").read_text() == (target / "b").read_text()
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_is_at_its_place_at_any_moment(tmp_path):
    target, missing, ended = tmp_path / "sample", [], threading.Event()
    write_parts(target, "old")
    if not storage._exchange(target, target):  # a no-op where it is possible
        pytest.skip("the file system cannot exchange two names")

    def watch():
        while not ended.is_set():
            missing.append(not (target / "a").parent.is_dir())

    watcher = threading.Thread(target=watch)
    watcher.start()
    for _ in range(200):
        write_parts(target, "new")
    ended.set()
    watcher.join()
    assert len(missing) > 200
    assert not any(missing)


WRITER = """
import sys
import time
from drapeline.storage import atomic_file, atomic_folder

with atomic_folder(sys.argv[1] + "/sample") as folder, atomic_file(sys.argv[1] + "/a.npz") as file:
    (folder / "half").touch()
    print("writing", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def writer(tmp_path):
    """Another process in the middle of a folder and of a file."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, tmp_path / "results"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(storage.__file__).parents[1])},
    )
    assert process.stdout.readline() == "writing\n"
    yield process
    process.kill()
    process.wait()


def test_what_a_killed_process_wrote_is_swept_and_nothing_else(writer, tmp_path):
    results = tmp_path / "results"
    mine = results / "deep" / ".mine"
    mine.parent.mkdir()
    mine.touch()
    scraps = sorted(path for path in results.iterdir() if path.name != "deep")
    assert len(scraps) == 2
    assert all(path.name.startswith(".") for path in scraps)
    assert sweep(results) == []  # it is still at work
    with atomic_folder(results / "deep" / "own"):
        assert sweep(results) == []  # and so are we
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    assert sorted(sweep(results)) == scraps
    assert sorted(path.name for path in results.rglob("*")) == [".mine", "deep", "own"]


def test_what_another_machine_writes_goes_when_it_is_old(tmp_path):
    scrap = tmp_path / ".writing-sample@elsewhere.abc"
    scrap.mkdir()
    part = scrap / "part"
    part.touch()
    os.utime(scrap, times=(0, 0))
    assert sweep(tmp_path) == []
    day = time.time() - 25 * 3600
    os.utime(part, times=(day, day))
    os.utime(scrap, times=(day, day))
    assert sweep(tmp_path) == [scrap]
    assert not scrap.exists()


def test_where_files_cannot_be_locked_age_decides(tmp_path, monkeypatch):
    def no_locks(*_):
        raise OSError("no locks available")

    monkeypatch.setattr(storage.fcntl, "flock", no_locks)
    with atomic_file(tmp_path / "a") as scratch:
        assert sweep(tmp_path) == []
        os.utime(scratch, times=(0, 0))
        assert sweep(tmp_path) == [scratch]
        scratch.touch()


def test_linked_files_cannot_be_written_by_accident(tmp_path):
    first = tmp_path / "a"
    first.write_text("whole")
    link_or_copy(first, tmp_path / "b")
    assert first.samefile(tmp_path / "b")
    assert first.stat().st_mode & 0o222 == 0
    copy_file(first, tmp_path / "c")
    assert (tmp_path / "c").read_text() == "whole"
    assert (tmp_path / "c").stat().st_mode & 0o200
    assert not first.samefile(tmp_path / "c")


@pytest.mark.parametrize("result", [0, OSError("not supported"), None])
def test_a_file_is_copied_whatever_the_system_can_do(tmp_path, monkeypatch, result):
    def copy_nothing(*_):
        if result is None:
            raise AttributeError
        if result:
            raise result
        return result

    (tmp_path / "a").write_bytes(b"x" * 100_000)
    monkeypatch.setattr(os, "copy_file_range", copy_nothing)
    copy_file(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b").read_bytes() == (tmp_path / "a").read_bytes()


def test_a_folder_is_copied_without_hidden_files(tmp_path):
    (tmp_path / "a" / "deep").mkdir(parents=True)
    (tmp_path / "a" / ".mark").touch()
    (tmp_path / "a" / "deep" / "x").write_text("whole")
    copy_folder(tmp_path / "a", tmp_path / "b" / "c")
    copied = [path for path in (tmp_path / "b" / "c").rglob("*") if path.is_file()]
    assert copied == [tmp_path / "b/c/deep/x"]
    assert copied[0].read_text() == "whole"


def test_a_full_disk_ends_a_copy_with_one_sentence(tmp_path):
    (tmp_path / "a").mkdir()
    for name in ("x", "y"):
        (tmp_path / "a" / name).write_bytes(b"x" * 100_000)
    with (
        pytest.raises(InputError, match=f"^{tmp_path}/b: cannot be written .File too large") as hit,
        small_disk(),
        atomic_folder(tmp_path / "b") as scratch,
    ):
        copy_folder(tmp_path / "a", scratch / "c")
    assert "\n" not in str(hit.value)
    assert list(tmp_path.iterdir()) == [tmp_path / "a"]


def test_a_file_belongs_to_the_outermost_folder_that_a_rule_made(tmp_path):
    made = tmp_path / "results" / "dataset"
    inner = made / "train" / "00001"
    inner.mkdir(parents=True)
    (inner / ".snakemake_timestamp").touch()
    (made / ".snakemake_timestamp").touch()
    (tmp_path / ".snakemake_timestamp").touch()
    assert output_of(inner / "info.mat", tmp_path / "results") == made
    file = tmp_path / "results" / "motions" / "walk.npz"
    assert output_of(file, tmp_path / "results") == file


def test_written_files_have_the_usual_mode(tmp_path):
    plain = tmp_path / "plain"
    plain.touch()
    write_json(tmp_path / "a.json", 1)
    assert (tmp_path / "a.json").stat().st_mode == plain.stat().st_mode


def test_npz_round_trip_keeps_arrays_strings_and_dtypes(tmp_path):
    path = tmp_path / "a.npz"
    save_npz(path, x=np.arange(3, dtype=np.float32), name="walk", count=2)
    arrays = load_npz(path, {"x": "float n", "name": "str", "count": "int"})
    assert arrays["x"].dtype == np.float32
    assert str(arrays["name"]) == "walk"
    assert int(arrays["count"]) == 2


def test_half_precision_is_read_as_single(tmp_path):
    path, x = tmp_path / "a.npz", np.linspace(-2, 2, 7)
    save_npz(path, half=x.astype(np.float16), double=x, count=np.arange(3, dtype=np.int16))
    arrays = load_npz(path, {"half": "float n", "double": "float n", "count": "int *"})
    assert [arrays[name].dtype for name in ("half", "double", "count")] == ["f4", "f8", "i2"]
    np.testing.assert_array_equal(arrays["half"], x.astype(np.float16))


def test_object_arrays_are_never_written(tmp_path):
    with pytest.raises(TypeError, match="'bad' is an object array"):
        save_npz(tmp_path / "a.npz", bad=np.array([{}], dtype=object))
    assert not list(tmp_path.iterdir())


class Bomb:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


def test_a_pickle_inside_an_npz_is_refused_and_not_run(tmp_path):
    path, trace = tmp_path / "a.npz", tmp_path / "trace"
    np.savez(path, bad=np.array([Bomb(trace)], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="a.npz: 'bad' holds Python objects"):
        load_npz(path, {"bad": "any ..."})
    assert not trace.exists()


def test_only_declared_arrays_are_opened(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, x=1, y=2, z=3, bad=np.array([{}], dtype=object))
    assert set(load_npz(path, {"x": "int", "y?": "int", "absent?": "int"})) == {"x", "y"}
    with pytest.raises(InputError, match="lacks w; it holds bad, x, y, z"):
        load_npz(path, {"w": "int"})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file"),
        (b"not a zip", "not readable as an .npz"),
        (b"", "not readable as an .npz"),
    ],
)
def test_unusable_npz_files_are_named(tmp_path, content, message):
    path = tmp_path / "a.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=f"a.npz: {message}"):
        load_npz(path, {"x": "int"})


def test_a_missing_key_is_named_with_those_there(tmp_path):
    save_npz(tmp_path / "a.npz", x=1, y=2)
    with pytest.raises(InputError, match="lacks poses; it holds x, y"):
        load_npz(tmp_path / "a.npz", {"x": "int", "poses": "float n 72"})


def test_json_keeps_small_numbers_and_refuses_nan(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"bending": 6.37e-08})
    assert read_json(path) == {"bending": 6.37e-08}
    with pytest.raises(ValueError, match="JSON"):
        write_json(path, float("nan"))
    assert json.loads(path.read_text()) == {"bending": 6.37e-08}
    path.write_text("{")
    with pytest.raises(InputError, match="a.json: not readable as JSON"):
        read_json(path)
    with pytest.raises(InputError, match="b.json: no such file"):
        read_json(tmp_path / "b.json")


@contextmanager
def small_disk():
    """Files of this process may hold 4 kB; more fails as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        yield
    finally:
        # At once: pytest's own output may go to a file.
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_small_npz_files_have_the_bytes_of_numpys_own(tmp_path):
    arrays = {"x": np.arange(12.0).reshape(3, 4).T, "s": np.array(["a", "bc"]), "n": 3, "m": "é"}
    save_npz(tmp_path / "a.npz", **arrays)
    np.savez_compressed(tmp_path / "b.npz", **arrays)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_large_arrays_are_compressed_if_they_shrink(tmp_path):
    noise = rng_for(1, "noise").normal(size=(90, 200))
    shrinks = {"zeros": np.zeros((90, 200)), "steps": np.arange(70_000) // 10}
    arrays = {"noise": noise, "columns": noise.T, "every_other": noise[:, ::2], **shrinks}
    for name in ("a.npz", "b.npz"):
        save_npz(tmp_path / name, **arrays)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as held:
        kinds = {info.filename.removesuffix(".npy"): info.compress_type for info in held.infolist()}
    assert {name for name, kind in kinds.items() if kind == zipfile.ZIP_DEFLATED} == set(shrinks)
    with np.load(tmp_path / "a.npz") as loaded:
        for name, array in arrays.items():
            np.testing.assert_array_equal(loaded[name], array)


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
def test_a_full_disk_is_named_and_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.npz"
    save_npz(path, x=1)
    noise = np.random.Generator(np.random.PCG64(0)).random(10_000)
    with (
        pytest.raises(InputError, match="a.npz: cannot be written .*free disk space"),
        small_disk(),
    ):
        save_npz(path, x=noise)
    assert load_npz(path, {"x": "int"})["x"] == 1
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_told_by_the_name_that_a_file_would_have(tmp_path):
    with (
        pytest.raises(InputError, match=f"^{tmp_path}/b@c/deep/a.npz: cannot be written"),
        small_disk(),
        atomic_folder(tmp_path / "b@c") as scratch,
        atomic_file(scratch / "deep" / "a.npz") as file,
    ):
        file.write_bytes(bytes(10_000))


def test_a_mapped_array_that_the_disk_has_no_room_for_is_refused_when_it_is_made(tmp_path):
    with (
        pytest.raises(InputError, match="sample: cannot be written .*free disk space"),
        small_disk(),
        atomic_folder(tmp_path / "sample") as scratch,
    ):
        create_array(scratch / "x.npy", np.float32, (1000, 3))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("shape", [(4, 3), (0, 3), (), (np.int64(4), 3)])
def test_a_mapped_array_begins_with_zeros_and_takes_its_room(tmp_path, shape):
    path = tmp_path / "x.npy"
    array = create_array(path, np.float32, shape)
    np.testing.assert_array_equal(array, np.zeros(shape, np.float32))
    array[...] = 1
    array.flush()
    np.save(tmp_path / "y.npy", np.ones(shape, np.float32))
    assert path.read_bytes() == (tmp_path / "y.npy").read_bytes()
    assert path.stat().st_blocks * 512 >= path.stat().st_size - 4096


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "results").write_text("a file is in the way")
    with pytest.raises(InputError, match="a.json: cannot be written .*expected a writable folder"):
        write_json(tmp_path / "results" / "a.json", 1)


def test_a_missing_input_inside_the_block_keeps_its_own_error(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_file(tmp_path / "a") as scratch:
        scratch.write_bytes((tmp_path / "elsewhere" / "b").read_bytes())


def rezipped(path, key, raw, **info):
    """The same .npz with other bytes for an array."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members[f"{key}.npy"] = raw
    with zipfile.ZipFile(path, "w", info.get("compression", zipfile.ZIP_DEFLATED)) as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def npy(text, body=b""):
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + body


HUGE = "{'descr': '<f8', 'fortran_order': False, 'shape': (1099511627776, 3), }"


@pytest.fixture
def two(tmp_path):
    path = tmp_path / "a.npz"
    save_npz(path, x=np.zeros((4, 3), np.float32), f=np.array([[0, 1, 3]]))
    return path


FORMS = {"x": "float n 3", "f": "int<n * 3"}


def test_a_header_that_lies_takes_no_memory(two):
    rezipped(two, "x", npy(HUGE, bytes(48)))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match=r"a\.npz: 'x' has \d+ bytes, expected \d+ as its header"):
        load_npz(two, FORMS)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kB


def test_what_unpacks_to_far_more_than_its_file_is_refused(two):
    header = "{'descr': '|u1', 'fortran_order': False, 'shape': (200000000,), }"
    rezipped(two, "x", npy(header, bytes(200_000_000)))
    with pytest.raises(InputError, match=r"a\.npz: \d+ bytes that unpack to \d+, expected at most"):
        load_npz(two, FORMS)


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_ways_of_packing_are_refused(two, compression):
    with zipfile.ZipFile(two) as archive:
        raw = archive.read("x.npy")
    rezipped(two, "x", raw, compression=compression)
    with pytest.raises(InputError, match=r"a\.npz: '.' is packed in a way"):
        load_npz(two, FORMS)


def test_arrays_that_do_not_fit_together_are_refused(two):
    with pytest.raises(InputError, match=r"a\.npz: 'x' has shape \(4, 3\) .*expected \(5, 3\)"):
        load_npz(two, FORMS, n=5)
    save_npz(two, x=np.zeros((3, 3), np.float32), f=np.array([[0, 1, 3]]))
    with pytest.raises(InputError, match=r"a\.npz: 'f' names number 3, expected 0 to 2"):
        load_npz(two, FORMS)


def test_patterns_stand_for_any_number_of_arrays_in_the_files_order(tmp_path):
    path = tmp_path / "a.npz"
    save_npz(path, **{"s2/faces": np.zeros((1, 3), int), "s1/faces": np.zeros((2, 3), int), "x": 1})
    arrays = load_npz(path, {"*/faces": "int * 3"})
    assert list(arrays) == ["s2/faces", "s1/faces"]
    with pytest.raises(InputError, match=r"a\.npz: lacks s3/faces; it holds s1/faces, s2/faces"):
        _ = arrays["s3/faces"]


def test_shapes_may_be_asked_for_alone(two):
    arrays = load_npz(two, FORMS, unread=["x"])
    assert arrays["x"].shape == (4, 3)
    assert arrays["x"].strides == (0, 0)


def test_every_byte_of_an_npz_may_be_wrong(two):
    data = two.read_bytes()
    for place in range(len(data)):
        damaged = bytearray(data)
        damaged[place] ^= 0xFF
        two.write_bytes(damaged)
        with suppress(InputError):  # any other exception is a failure
            load_npz(two, FORMS)


def test_mapped_arrays_are_declared_too(tmp_path):
    np.save(tmp_path / "x.npy", np.arange(12.0).reshape(4, 3))
    np.save(tmp_path / "y.npy", np.arange(4))
    arrays = open_arrays(tmp_path, {"x": "float n 3", "y": "int n"}, n=4)
    assert isinstance(arrays["x"], np.memmap)
    np.testing.assert_array_equal(arrays["x"], np.arange(12.0).reshape(4, 3))
    with pytest.raises(InputError, match=r"y\.npy: has shape \(4,\) and .*, expected \(4, 2\)"):
        open_arrays(tmp_path, {"x": "float n 3", "y": "int n 2"})
    (tmp_path / "y.npy").write_bytes((tmp_path / "y.npy").read_bytes()[:-1])
    with pytest.raises(InputError, match=r"y\.npy: 159 bytes, expected 160 as its header says"):
        open_arrays(tmp_path, {"y": "int n"})
    with pytest.raises(InputError, match=r"z\.npy: no such file"):
        open_arrays(tmp_path, {"z": "int n"})


FORM = {"a": float, "c?": [{"name": str}], "d?": ("x", "y"), "e?": [float, float]}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "not readable as JSON"),
        ('{"a": NaN}', "NaN is no number of JSON"),
        ('{"a": 1e999}', "1e999 is too large"),
        ('{"a": ' + "9" * 5000 + "}", "not readable as JSON"),
        ('{"a": 9223372036854775808}', "9223372036854775808 is too large"),
        ('{"b": 1}', "the file lacks 'a'"),
        ('{"a": "x"}', "'a' is 'x', expected a number"),
        ('{"a": true}', "'a' is True, expected a number"),
        ('{"a": 1, "c": [{"name": 3}]}', "'name' is 3, expected text"),
        ('{"a": 1, "c": {}}', r"'c' is \{\}, expected a list"),
        ("[]", r"the file is \[\], expected entries by name"),
        ('{"a": 1, "d": "z"}', "'d' is 'z', expected x or y"),
        ('{"a": 1, "d": ["x"]}', r"'d' is \['x'\], expected x or y"),
        ('{"a": 1, "e": [1]}', "'e' has 1 entries, expected 2"),
        ('{"a": 1, "e": [1, "x"]}', "an entry of 'e' is 'x', expected a number"),
    ],
)
def test_json_that_is_not_of_its_form_is_refused(tmp_path, text, message):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"a\.json: .*{message}") as caught:
        read_json(path, FORM)
    assert "\n" not in str(caught.value)


def test_messages_are_one_line_however_a_file_is_called(tmp_path):
    path = tmp_path / "a\nb\x1b[31m.json"
    with pytest.raises(InputError, match=r"a\\nb\\x1b\[31m\.json: no such file") as caught:
        read_json(path)
    assert str(caught.value).isprintable()
    assert len(str(InputError("x" * 10_000))) < 1100


def test_tables_are_read_by_row(tmp_path):
    path = tmp_path / "a.tsv"
    path.write_bytes(b"\xef\xbb\xbfname\tfile\r\na\t1\r\n\r\nb\r\n")
    assert read_rows(path, "a table") == (
        ["name", "file"],
        [{"name": "a", "file": "1"}, {"name": "b", "file": ""}],
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"name\tname\n", "a column is there twice"),
        (b"name\na\tb\n", "line 2 has 2 fields, expected 1"),
        (b"name\n\xff\n", "line 2 is not UTF-8 text"),
        (b"name\na\0\n", "line 2 holds a zero byte"),
        (b'name\n"' + b"x" * 200_000, "field larger than field limit"),
    ],
)
def test_unusable_tables_are_named(tmp_path, content, message):
    path = tmp_path / "a.tsv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"a\.tsv: .*{message}"):
        read_rows(path, "a table")


def test_a_table_keeps_one_line_per_row(tmp_path):
    write_rows(tmp_path / "t.tsv", [{"a": "two\nlines\tand a tab"}, {"a": 1, "b": "x"}])
    assert (tmp_path / "t.tsv").read_text() == "a\tb\ntwo lines and a tab\t\n1\tx\n"
    assert read_rows(tmp_path / "t.tsv", "a table") == (
        ["a", "b"],
        [{"a": "two lines and a tab", "b": ""}, {"a": "1", "b": "x"}],
    )


def test_columns_may_be_named_before_there_are_rows(tmp_path):
    write_rows(tmp_path / "t.tsv", [], ["b", "a"])
    assert (tmp_path / "t.tsv").read_text() == "b\ta\n"


@dataclass(frozen=True)
class Origin:
    place: str = "here"


@dataclass(frozen=True)
class Cloth:
    points: Annotated[np.ndarray, "float n 3"]
    faces: Annotated[np.ndarray, "int<n * 3"]
    names: tuple[str, ...]
    layer: int
    origin: Origin


def test_records_are_read_as_their_annotations_say(tmp_path):
    cloth = Cloth(np.ones((4, 3)), np.zeros((2, 3), int), ("hem", "waist"), 2, Origin("there"))
    save_record(tmp_path / "cloth.npz", cloth)
    again = load_record(tmp_path / "cloth.npz", Cloth)
    np.testing.assert_array_equal(again.points, cloth.points)
    assert (again.names, again.layer, again.origin) == (cloth.names, 2, cloth.origin)
    save_record(tmp_path / "cloth.npz", cloth, faces=np.full((2, 3), 4))
    with pytest.raises(InputError, match=r"cloth.npz: 'faces' names number 4, expected 0 to 3"):
        load_record(tmp_path / "cloth.npz", Cloth)


def test_finished_files_have_the_umask_which_is_never_changed(tmp_path, monkeypatch):
    before = os.umask(0o027)
    try:
        monkeypatch.setattr(os, "umask", None)
        with atomic_file(tmp_path / "a") as scratch:
            scratch.touch()
        assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640
    finally:
        monkeypatch.undo()
        os.umask(before)


def test_a_text_beyond_reason_is_refused(tmp_path):
    (tmp_path / "a.yaml").write_text("x" * 11)
    with pytest.raises(InputError, match="11 bytes, expected YAML of at most 10"):
        read_text(tmp_path / "a.yaml", "YAML", most_bytes=10)


def test_decimal_numbers_of_rows_have_six_digits_and_what_is_none_is_empty(tmp_path):
    path = tmp_path / "rows.tsv"
    write_rows(path, [{"name": "a", "mm": 1 / 3, "n": 7}, {"name": "b", "mm": float("nan")}])
    assert path.read_text() == "name\tmm\tn\na\t0.333333\t7\nb\t\t\n"
