import json
import resource
from contextlib import contextmanager

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.storage import atomic_file, atomic_folder, load_npz, read_json, save_npz, write_json


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


# NumPy's half-written archive complains once more when it is collected.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
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


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "results").write_text("a file is in the way")
    with pytest.raises(InputError, match="a.json: cannot be written .*expected a writable folder"):
        write_json(tmp_path / "results" / "a.json", 1)


def test_a_missing_input_inside_the_block_keeps_its_own_error(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_file(tmp_path / "a") as scratch:
        scratch.write_bytes((tmp_path / "elsewhere" / "b").read_bytes())
