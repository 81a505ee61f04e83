"""OBJ files: their exact text, and what is read from files of others."""

import numpy as np
import pytest

from drapeline.errors import DamagedFile
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import load_obj, save_obj


def test_obj_round_trip_and_its_exact_text(tmp_path):
    mesh = Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.123456]], dtype=np.float32),
        np.array([[0, 1, 2, 3]], dtype=np.int32),
        np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32),
        np.array([[0, 1, 2, 3]], dtype=np.int32),
    )
    path = tmp_path / "Skirt.obj"
    save_obj(path, mesh)
    text = path.read_text()
    assert text.splitlines()[0] == "v 0.000000 0.000000 0.000000"
    assert text.splitlines()[-1] == "f 1/1 2/2 3/3 4/4"
    assert "  " not in text
    assert all(line == line.strip() for line in text.splitlines())
    again = load_obj(path)
    for name in ("vertices", "faces", "uv", "uv_faces"):
        np.testing.assert_allclose(getattr(again, name), getattr(mesh, name), atol=1e-6)


@pytest.mark.parametrize("corners", [3, 4])
@pytest.mark.parametrize("textured", [False, True])
def test_a_tidy_obj_is_read_as_any_other_one_is(tmp_path, corners, textured):
    rng = np.random.default_rng(corners)
    faces = rng.integers(0, 50, (40, corners), dtype=np.int32)
    uv = (rng.random((30, 2), dtype=np.float32), rng.integers(0, 30, (40, corners), dtype=np.int32))
    mesh = Mesh(rng.normal(size=(50, 3)).astype(np.float32), faces, *(uv if textured else ()))
    tidy, other = tmp_path / "tidy.obj", tmp_path / "other.obj"
    save_obj(tidy, mesh)
    other.write_text("# a comment\n" + tidy.read_text())
    quick, slow = load_obj(tidy), load_obj(other)
    np.testing.assert_array_equal(quick.faces, faces)
    for name in ("vertices", "faces", "uv", "uv_faces"):
        a, b = getattr(quick, name), getattr(slow, name)
        assert type(a) is type(b)
        np.testing.assert_array_equal(a, b)
        assert a is None or (a.dtype == b.dtype and a.flags.c_contiguous)


def test_obj_of_mixed_faces_becomes_triangles_and_negative_indices_count_back(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 2 0\nf 1 2 3 4\nf -3 -2 -1\n")
    assert load_obj(path).faces.tolist() == [[0, 1, 2], [0, 2, 3], [2, 3, 4]]


def test_digits_of_other_scripts_are_numbers_too(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0.0 0.0 0.\u0665\nf 1 1 1\n")
    assert load_obj(path).vertices.tolist() == [[0, 0, 0.5]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "0 vertices and 0 faces, expected at least one"),
        ("v 0 0 x\n", "line 1 is not OBJ: 'v 0 0 x'"),
        ("v 0 0\nf 1 1 1\n", "fewer than three coordinates"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "a face names vertex 9, expected 1 to 3"),
        ("v 0.0 0.0 0.0\nf 1 1 2\n", "a face names vertex 2, expected 1 to 1"),
        ("v 0.0 0.0 0.0\nf 1 1 4294967297\n", "vertex 4294967297, expected 1 to 1"),
        ("v 0 0 0\nv 1 0 0\nf 1 2\n", "a face has 2 corners, expected at least three"),
    ],
)
def test_unusable_obj_files_are_named(tmp_path, text, message):
    path = tmp_path / "bad.obj"
    path.write_text(text)
    with pytest.raises(DamagedFile, match=message):
        load_obj(path)


def test_a_missing_obj_is_named(tmp_path):
    with pytest.raises(DamagedFile, match="none.obj: no such file"):
        load_obj(tmp_path / "none.obj")


CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
TIDY = CORNERS.replace(" 0", " 0.0").replace(" 1", " 1.0")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        # Numbers that 32 or 64 bits would turn into honest ones.
        (CORNERS + "f 1 2 4294967299\n", "a face names vertex 4294967299, expected 1 to 3"),
        (TIDY + "f 1 2 18446744073709551619\n", "names vertex 18446744073709551619, expected"),
        (CORNERS + "vt 0 0\nf 1/1 2/1 3/4294967297\n", "texture coordinate 4294967297, expected 1"),
        (CORNERS + "vt 0 0\nf 1/1 2/1 3/2\n", "texture coordinate 2, expected 1 to 1"),
        (CORNERS + "vt 0 0\nf 1/1 2/1 3/-2\n", "a face names texture coordinate"),
        (CORNERS + "vt 0\nf 1/1 2/1 3/1\n", "a texture coordinate has fewer than two numbers"),
        (CORNERS + "vt nan 0\nf 1/1 2/1 3/1\n", "a texture coordinate is not finite"),
    ],
)
def test_indices_are_checked_before_they_are_narrowed(tmp_path, text, message):
    path = tmp_path / "a.obj"
    path.write_text(text)
    with pytest.raises(DamagedFile, match=rf"a\.obj: .*{message}"):
        load_obj(path)


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.mark.parametrize(
    "data",
    [
        b"\xef\xbb\xbf" + TRIANGLE.encode(),
        TRIANGLE.replace("2 3", "\\\n2 \\\n3").encode(),
        TRIANGLE.replace("2 3", "\\\r\n2 3").encode(),
        TRIANGLE.rstrip().encode(),
    ],
)
def test_a_byte_order_mark_and_continued_lines_are_read(tmp_path, data):
    (tmp_path / "a.obj").write_bytes(data)
    mesh = load_obj(tmp_path / "a.obj")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (TRIANGLE.encode("utf-16"), "zero bytes, expected a Wavefront OBJ in UTF-8"),
        (TRIANGLE.replace("v 1", "v nan").encode(), "vertex 2 is not finite"),
        (TRIANGLE.replace("v 1", "v 1e39").encode(), "vertex 2 is not finite"),
        (2 * TRIANGLE.encode() + b"f 1 2", "ends within line 9"),
    ],
)
def test_what_single_precision_or_text_cannot_hold_is_refused(tmp_path, data, message):
    (tmp_path / "a.obj").write_bytes(data)
    with pytest.raises(DamagedFile, match=message):
        load_obj(tmp_path / "a.obj")
