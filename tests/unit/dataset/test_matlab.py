"""MATLAB files against SciPy's reader, and files that would lead that one astray."""

import struct
import zlib
from contextlib import suppress

import numpy as np
import pytest
import scipy.io
import scipy.sparse

from drapeline.dataset.matlab import read_matlab
from drapeline.errors import InputError
from drapeline.seeding import rng_for


def made_up(rng, depth=0):
    """Anything that these files may hold."""
    kind = rng.integers(8 if depth < 3 else 6)
    if kind == 0:
        return rng.normal(size=tuple(rng.integers(1, 5, size=2)))
    if kind == 1:
        return float(rng.normal())
    if kind == 2:
        return int(rng.integers(-5, 70_000))
    if kind == 3:
        return ("cotton", " a b ", "é", "x" * 40)[rng.integers(4)]
    if kind == 4:
        return rng.integers(0, 200, size=(3, 2)).astype(("u1", "i2", "u4", "f4", "i8")[depth])
    if kind == 5:
        return np.zeros((0, 3))
    if kind == 6:
        cells = np.empty(int(rng.integers(1, 4)), object)
        for index in range(len(cells)):
            cells[index] = made_up(rng, depth + 1)
        return cells
    return {f"f{index}": made_up(rng, depth + 1) for index in range(rng.integers(1, 5))}


def as_python(value):
    """SciPy's values in our form."""
    if isinstance(value, scipy.io.matlab.mat_struct):
        return {name: as_python(getattr(value, name)) for name in value._fieldnames}
    if isinstance(value, np.ndarray):
        if value.dtype == object:
            return [as_python(item) for item in value.ravel()]
        return value.item() if value.ndim == 0 else value
    return value


@pytest.mark.parametrize("packed", [False, True])
def test_values_are_scipys(tmp_path, packed):
    path, rng = tmp_path / "a.mat", rng_for(0, "matlab", packed)
    for _ in range(40):
        scipy.io.savemat(path, {f"v{k}": made_up(rng) for k in range(4)}, do_compression=packed)
        loaded = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
        expected = {k: as_python(v) for k, v in loaded.items() if not k.startswith("__")}
        found = read_matlab(path)
        assert list(found) == list(expected)
        np.testing.assert_equal(found, expected)
        dtypes = [x.dtype for x in found.values() if isinstance(x, np.ndarray)]
        assert dtypes == [x.dtype for x in expected.values() if isinstance(x, np.ndarray)]


@pytest.mark.parametrize("packed", [False, True])
def test_chosen_variables_are_those_of_the_whole_file(tmp_path, packed):
    path, rng = tmp_path / "a.mat", rng_for(0, "chosen", packed)
    for size in (1, 3000):  # the second reaches far behind what is read at first
        values = {f"v{k}": made_up(rng) for k in range(6)}
        values["v2"] = rng.normal(size=(size, 3))
        scipy.io.savemat(path, values, do_compression=packed)
        whole = read_matlab(path)
        for names in ((), ("v2",), ("v1", "v5", "none"), tuple(values)):
            expected = {name: value for name, value in whole.items() if name in names}
            np.testing.assert_equal(read_matlab(path, names), expected)


def test_outlines_are_names_of_fields(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"outfit": {"Top": {"fabric": "silk"}, "Skirt": 3.0}, "x": 2.0})
    found = read_matlab(path, ("outfit", "x"), outlines=("outfit",))
    assert found == {"outfit": {"Top": None, "Skirt": None}, "x": 2.0}


def test_a_file_that_is_cut_off_is_noticed_in_variables_that_are_not_read(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"a": 1.0, "b": np.ones((5000, 3))})
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(InputError, match="an element of .* bytes, .* are left"):
        read_matlab(path, ("a",))


@pytest.mark.parametrize("byte", range(0, 8))
@pytest.mark.parametrize("value", [0, 9, 14, 255])
def test_no_tag_leads_outside_of_the_file(tmp_path, byte, value):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"outfit": {"Top": {"fabric": "silk", "colour": np.ones(3)}}})
    data = path.read_bytes()
    for start in range(128, len(data) - 8, 8):
        damaged = bytearray(data)
        damaged[start + byte] = value
        path.write_bytes(damaged)
        with suppress(InputError):  # any other exception, or a crash, is a failure
            read_matlab(path)
        with suppress(InputError):
            read_matlab(path, ("outfit",), outlines=("outfit",))


def test_packed_elements_may_not_be_much_larger_than_their_file(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"x": 1.0}, do_compression=True)
    bomb = zlib.compress(bytes(200 << 20))
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<II", 15, len(bomb)) + bomb)
    with pytest.raises(InputError, match="a.mat: a packed element is cut off or too large"):
        read_matlab(path)


def test_what_no_sample_holds_is_refused(tmp_path):
    path = tmp_path / "a.mat"
    for value in (1j * np.ones(3), scipy.sparse.csc_matrix(np.eye(3)), np.array(["ab", "cd"])):
        scipy.io.savemat(path, {"x": value})
        with pytest.raises(InputError, match="not readable as a MATLAB v5 file"):
            read_matlab(path)
    path.write_bytes(b"\x89HDF" + bytes(300))
    with pytest.raises(InputError, match="no header of version 5"):
        read_matlab(path)


def test_numbers_do_not_reach_into_the_next_variable(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"a": 1.5, "b": 2.5})
    one = struct.pack("<iid", 9, 8, 1.5)  # type, size and value
    data = path.read_bytes().replace(one, struct.pack("<iid", 9, 16, 1.5), 1)
    shape = struct.pack("<ii", 1, 1)
    path.write_bytes(data.replace(shape, struct.pack("<ii", 1, 2), 1))
    with pytest.raises(InputError, match="an element of 16 bytes, 8 are left"):
        read_matlab(path)
