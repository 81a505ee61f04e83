"""Headers of arrays: NumPy's own are read as NumPy reads them, all others are refused."""

import io

import numpy as np
import pytest

from drapeline.npy import Declared, Header, HeaderError, check_arrays, read_array, read_header


def written(array, *, version=None):
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array, version=version, allow_pickle=True)
    stream.seek(0)
    return stream


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
@pytest.mark.parametrize(
    "array",
    [
        np.arange(12, dtype=np.float32).reshape(3, 4),
        np.asfortranarray(np.arange(24, dtype=">i4").reshape(2, 3, 4)),
        np.array(1.5),
        np.array("walk"),
        np.array(["a", "été"]),
        np.array([True, False]),
        np.zeros((0, 3), np.uint8),
        np.zeros(3, np.float16),
    ],
)
def test_arrays_are_those_that_numpy_reads(array, version):
    stream = written(array, version=version)
    header = read_header(stream)
    assert (header.dtype, header.shape, header.nbytes) == (array.dtype, array.shape, array.nbytes)
    assert header.size == stream.tell()
    found = read_array(stream, header)
    np.testing.assert_array_equal(found, array)
    assert found.dtype == array.dtype
    assert found.flags.writeable
    assert found.flags.f_contiguous == array.flags.f_contiguous


def header_of(text):
    raw = text.encode("latin-1")
    return io.BytesIO(b"\x93NUMPY\x01\x00" + len(raw).to_bytes(2, "little") + raw)


def test_long_integers_of_python_2_and_other_orders_are_read():
    header = read_header(header_of("{'shape': (2L, 3L), 'descr': '<f8', 'fortran_order': True}"))
    assert (header.shape, header.fortran) == ((2, 3), True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", "Python objects"),
        ("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (1,), }", "array of fields"),
        ("{'descr': '<M8', 'fortran_order': False, 'shape': (1,), }", "expected numbers or text"),
        ("{'descr': '|V8', 'fortran_order': False, 'shape': (1,), }", "expected numbers or text"),
        ("{'descr': '<f16', 'fortran_order': False, 'shape': (1,), }", "expected numbers or text"),
        ("{'descr': '<q9', 'fortran_order': False, 'shape': (1,), }", "unknown type"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (-1,), }", "unreadable header"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (1" + "0" * 30 + ",), }", "unreadable"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (1, " + "1, " * 9 + "), }", "dimens"),
        ("{'descr': '<f4', 'fortran_order': False}", "unreadable header"),
        ("{'descr': __import__('os'), 'fortran_order': False, 'shape': ()}", "unreadable header"),
        ("(" * 4000, "unreadable header"),
        (" " * 5000, "cut off or too long"),
    ],
)
def test_other_headers_are_refused(text, message):
    with pytest.raises(HeaderError, match=message):
        read_header(header_of(text))


def test_an_array_that_is_cut_off_is_refused():
    stream = io.BytesIO(written(np.arange(100.0)).getvalue()[:-8])
    with pytest.raises(HeaderError, match="ends after 792 of 800 bytes"):
        read_array(stream, read_header(stream))


def header(array):
    array = np.asarray(array)
    return Header(array.dtype, array.shape, False, 0)


@pytest.mark.parametrize(
    ("form", "array", "fits"),
    [
        ("float n 3", np.zeros((5, 3)), True),
        ("float n 3", np.zeros((5, 4)), False),
        ("float n 3", np.zeros(3), False),
        ("float n 3", np.zeros((5, 3), int), False),
        ("number n 3", np.zeros((5, 3), int), True),
        ("float", np.zeros(()), True),
        ("float ...", np.zeros((1, 2, 3)), True),
        ("float 1 ...", np.zeros((1, 2, 3)), True),
        ("float 2 ...", np.zeros((1, 2, 3)), False),
        ("int * 2", np.zeros((7, 2), np.uint8), True),
        ("int * 2", np.zeros((0, 2)), True),  # an empty list is float64
        ("str k", np.array(["a"]), True),
        ("bool k", np.array([1]), False),
    ],
)
def test_headers_are_compared_with_their_declaration(form, array, fits):
    declared = Declared({})
    if fits:
        declared.check_header(form, header(array))
    else:
        with pytest.raises(HeaderError, match=r"has shape \(.*\) and type .*, expected \("):
            declared.check_header(form, header(array))


def test_a_name_stands_for_the_same_size_in_all_arrays():
    declared = Declared({"v": 4})
    declared.check_header("float n v", header(np.zeros((2, 4))))
    with pytest.raises(HeaderError, match=r"has shape \(3,\) .*, expected \(2,\) whole numbers"):
        declared.check_header("int n", header(np.zeros(3, int)))


@pytest.mark.parametrize(
    ("form", "array", "message"),
    [
        ("float n", np.array([1, np.nan]), "NaN or infinity"),
        ("float n", np.array([1, -1e19]), "holds 1e.19, expected numbers up to 1e.18"),
        ("float n", np.array([1, -np.inf], np.float16), "NaN or infinity"),
        ("int<5 n", np.array([0, 5]), "names number 5, expected 0 to 4"),
        ("int<n n", np.array([0, -1]), "names number -1, expected 0 to 1"),
        ("bool n", np.array([0, 7], np.uint8).view(bool), "neither 0 nor 1"),
        ("str n", np.array([0x110000], np.uint32).view("<U1"), "impossible character"),
        ("str n", np.array([0xD800], np.uint32).view("<U1"), "impossible character"),
    ],
)
def test_values_that_are_none_are_refused(form, array, message):
    declared = Declared({})
    declared.check_header(form, header(array))
    with pytest.raises(HeaderError, match=message):
        declared.check_values(form, array)


def test_values_may_be_nan_where_declared():
    Declared({}).check_values("float|nan n", np.array([np.nan, np.inf]))


MESH = {"points": "float v 3", "faces": "int<v * 3"}
TRIANGLE = {"points": np.zeros((3, 3), np.float32), "faces": np.array([[0, 1, 2]])}


def test_arrays_in_memory_that_fit_their_table_pass():
    check_arrays(TRIANGLE, MESH)
    check_arrays(TRIANGLE, MESH, v=3)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"faces": np.array([[0, 1, 3]])}, "'faces' names number 3, expected 0 to 2"),
        ({"faces": np.array([[0.0, 1.0, 2.0]])}, "'faces' has shape .* expected .* whole numbers"),
        ({"points": np.full((3, 3), np.nan)}, "'points' holds NaN"),
        ({"points": np.zeros((3, 2))}, "'points' has shape .* expected \\(3, 3\\)"),
        ({"normals": np.zeros((3, 3))}, "'normals' is unknown"),
    ],
)
def test_arrays_in_memory_that_do_not_fit_are_named(changed, message):
    with pytest.raises(HeaderError, match=message):
        check_arrays(TRIANGLE | changed, MESH)


def test_an_array_that_is_not_there_is_named():
    with pytest.raises(HeaderError, match="'faces' is missing"):
        check_arrays({"points": TRIANGLE["points"]}, MESH)


def test_sizes_that_are_known_count():
    with pytest.raises(HeaderError, match=r"'points' has shape .* expected \(4, 3\)"):
        check_arrays(TRIANGLE, MESH, v=4)
