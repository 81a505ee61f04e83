"""Body files as SMPL ships them, made here in all their variants."""

import os
import pickle
import struct
import sys
from collections import OrderedDict
from types import ModuleType
from typing import ClassVar

import numpy as np
import pytest
from scipy.sparse import csc_matrix

from drapeline.bodies.model import load_body, posed_vertices
from drapeline.bodies.smpl_files import convert_to_pickle, pickle_end, read_body_arrays
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES, PARENTS

VALUES = {"x": np.arange(300.0), "a": [1, 2.5, "é" * 300, b"\0" * 70_000, None, True, (1, {2})]}


@pytest.mark.parametrize("protocol", range(6))
def test_honest_pickles_end_where_they_end(protocol):
    data = pickle.dumps([VALUES, VALUES["a"], OrderedDict(VALUES), 10**40], protocol)
    assert pickle_end(data) == len(data)
    assert pickle_end(data + data, len(data)) == 2 * len(data)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\x80\x02X\x00\x00\x00\x00r\xff\xff\xff\x0f.", "object 268435455 is kept, after 2"),
        (b"\x80\x02Np99999999\n.", "object 99999999 is kept"),
        (b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x0f.", "BINBYTES8 .* asks for"),
        (b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\x0f}.", "a frame of"),
        (b"\x80\x02T\xff\xff\xff\x7fabc.", "BINSTRING .* asks for"),
        (b"\x80\x02\x82\x01.", "byte 2 is no instruction"),
        (b"ios\nsystem\n.", "byte 0 is no instruction"),
        (b"\x80\x02}", "cut off"),
        (b"\x80\x02cos\nsystem", "not found"),
        (b"", "cut off"),
        (b"\x80\x02h\x00.", "BINGET at byte 2 asks for an object that is not there"),
        (b"\x80\x02)\x86.", "TUPLE2 at byte 3 asks for an object that is not there"),
        (b"\x80\x02(\x85.", "TUPLE1 at byte 3 asks for an object that is not there"),
        # A dict whose key is a tuple of tuples of tuples, each of the next one twice.
        (b"\x80\x02})" + 40 * b"2\x86" + b"Ns.", "hold one another too often"),
        (b"\x80\x02})" + 40 * b"q\x01h\x01\x86" + b"Ns.", "hold one another too often"),
        (b"\x80\x04}(" + 40 * b"\x94h\x00\x86" + b"Ns.", "asks for an object"),
        (b"\x80\x02}(" + b")" + 22 * b"2\x86" + b"q\x00N" + 9 * b"h\x00N" + b"u.", "too often"),
    ],
)
def test_those_that_ask_for_too_much_are_refused(data, message):
    with pytest.raises(ValueError, match=message):
        pickle_end(data)


VERTICES = 6890


@pytest.fixture(scope="module")
def smpl_arrays():
    """A cloud of SMPL's size that is skinned and blended at random."""
    rng = np.random.default_rng(0)
    template = rng.uniform([-0.8, -1.1, -0.2], [0.8, 0.6, 0.2], (VERTICES, 3))
    regressor = np.zeros((24, VERTICES))
    for row in regressor:
        row[rng.choice(VERTICES, 30, replace=False)] = 1 / 30
    for name, side in (("left_hip", [0.1, -0.3]), ("right_hip", [-0.1, -0.3]), ("head", [0, 0.4])):
        near = np.linalg.norm(template[:, :2] - side, axis=1).argsort()[:30]
        regressor[JOINT_NAMES.index(name)] = np.isin(np.arange(VERTICES), near) / 30
    weights = rng.random((VERTICES, 24)) ** 8
    parents = PARENTS.astype(np.uint32)
    return {
        "v_template": template,
        "shapedirs": rng.normal(size=(VERTICES, 3, 10)) / 50,
        "posedirs": rng.normal(size=(VERTICES, 3, 207)) / 500,
        "J_regressor": regressor,
        "weights": weights / weights.sum(axis=1, keepdims=True),
        "kintree_table": np.stack([parents, np.arange(24, dtype=np.uint32)]),
        "f": rng.integers(0, VERTICES, (13776, 3)).astype(np.uint32),
    }


class _Python2Pickler(pickle._Pickler):
    """Writes bytes and text the way Python 2 did: as its one kind of string."""

    dispatch: ClassVar = dict(pickle._Pickler.dispatch)

    def _save_old_string(self, value):
        raw = value if isinstance(value, bytes) else value.encode("latin1")
        self.write(pickle.BINSTRING + struct.pack("<i", len(raw)) + raw)
        self.memoize(value)

    dispatch[bytes] = dispatch[str] = _save_old_string


def write_pickle(path, value, *, python2=False):
    with open(path, "wb") as stream:
        kind = _Python2Pickler if python2 else pickle.Pickler
        kind(stream, protocol=2).dump(value)


@pytest.fixture
def chumpy(monkeypatch):
    """Classes that pickle under chumpy's names while the test writes its file."""
    kinds = {}
    for module, name in (
        ("chumpy.ch", "Ch"),
        ("chumpy.reordering", "Select"),
        ("chumpy.ch", "add"),
    ):
        kind = type(name, (), {"__module__": module})
        kinds[name] = kind
        holder = sys.modules.get(module) or ModuleType(module)
        monkeypatch.setitem(sys.modules, module, holder)
        setattr(holder, name, kind)
    monkeypatch.setitem(sys.modules, "chumpy", ModuleType("chumpy"))

    def make(kind, **state):
        thing = kinds[kind]()
        thing.__dict__.update(state)
        return thing

    return make


def test_plain_pickle_with_sparse_regressor(tmp_path, smpl_arrays):
    path = tmp_path / "SMPL_FEMALE.pkl"
    write_pickle(path, {**smpl_arrays, "J_regressor": csc_matrix(smpl_arrays["J_regressor"])})
    body = load_body(path)
    assert body.name == "SMPL_FEMALE"
    assert body.vt is None
    assert body.ft is None
    np.testing.assert_allclose(body.J_regressor, smpl_arrays["J_regressor"], atol=1e-7)
    np.testing.assert_array_equal(body.segmentation, smpl_arrays["weights"].argmax(axis=1))
    np.testing.assert_array_equal(body.faces, smpl_arrays["f"])


def test_python_2_pickle_with_chumpy_inside(tmp_path, smpl_arrays, chumpy, monkeypatch):
    path = tmp_path / "basicModel_f.pkl"
    spread = np.random.default_rng(1).permutation(VERTICES * 3 * 10)
    scrambled = np.zeros(spread.size)
    scrambled[spread] = smpl_arrays["shapedirs"].ravel()
    inside = {
        **smpl_arrays,
        "bs_style": "lbs",
        "v_template": chumpy("Ch", x=smpl_arrays["v_template"], _dirty_vars=set()),
        "posedirs": chumpy("Ch", x=chumpy("Ch", x=smpl_arrays["posedirs"])),
        "shapedirs": chumpy(
            "Select",
            a=chumpy("Ch", x=scrambled),
            idxs=spread,
            preferred_shape=smpl_arrays["shapedirs"].shape,
        ),
    }
    write_pickle(path, inside, python2=True)
    for module in [m for m in sys.modules if m.startswith("chumpy")]:
        monkeypatch.delitem(sys.modules, module)
    body = load_body(path)
    for key in ("v_template", "shapedirs", "posedirs"):
        np.testing.assert_allclose(getattr(body, key), smpl_arrays[key], atol=1e-6)


def test_npz_with_300_shapes_and_a_pickled_extra(tmp_path, smpl_arrays):
    path = tmp_path / "SMPL_MALE.npz"
    more = np.concatenate([smpl_arrays["shapedirs"], np.ones((VERTICES, 3, 290))], axis=-1)
    table = np.array({"part": 1}, dtype=object)
    np.savez(path, **{**smpl_arrays, "shapedirs": more.astype(np.float32), "part2num": table})
    body = load_body(path)
    np.testing.assert_allclose(body.shapedirs, smpl_arrays["shapedirs"], atol=1e-6)


def test_pose_blend_shapes_move_the_body(tmp_path, smpl_arrays):
    path = tmp_path / "a.npz"
    np.savez(path, **smpl_arrays)
    still = tmp_path / "b.npz"
    np.savez(still, **{**smpl_arrays, "posedirs": np.zeros((VERTICES, 3, 207))})
    pose = np.zeros((1, 72))
    pose[0, 3 * 18] = 1.0
    with_shapes, _ = posed_vertices(load_body(path), np.zeros(10), pose)
    without, _ = posed_vertices(load_body(still), np.zeros(10), pose)
    assert np.abs(with_shapes - without).max() > 1e-3


def test_pickle_converted_for_other_tools_is_the_same_body(tmp_path, smpl_arrays):
    np.savez(tmp_path / "a.npz", **smpl_arrays)
    convert_to_pickle(tmp_path / "a.npz", tmp_path / "a.pkl")
    one, other = (read_body_arrays(tmp_path / name) for name in ("a.npz", "a.pkl"))
    for key in one:
        np.testing.assert_array_equal(one[key], other[key])


class _Evil:
    def __init__(self, call, *arguments):
        self.call, self.arguments = call, arguments

    def __reduce__(self):
        return self.call, self.arguments


@pytest.mark.parametrize("python2", [False, True])
def test_pickle_that_would_run_a_command_is_refused_by_name(tmp_path, smpl_arrays, python2):
    path, mark = tmp_path / "SMPL_FEMALE.pkl", tmp_path / "ran"
    trap = _Evil(os.system, f"touch {mark}")
    write_pickle(path, {**smpl_arrays, "v_template": trap}, python2=python2)
    with pytest.raises(InputError, match=r"SMPL_FEMALE\.pkl: .*'posix\.system'"):
        load_body(path)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("call", "arguments"),
    [(eval, ("1+1",)), (getattr, ("a", "upper")), (np.load, ("x",)), (print, ())],
)
def test_any_other_call_is_refused(tmp_path, call, arguments):
    path = tmp_path / "a.pkl"
    write_pickle(path, {"v_template": _Evil(call, *arguments)})
    with pytest.raises(InputError, match="asks Python to run or build"):
        load_body(path)


def test_unknown_chumpy_expression_is_named(tmp_path, smpl_arrays, chumpy):
    path = tmp_path / "a.pkl"
    write_pickle(path, {**smpl_arrays, "weights": chumpy("add", a=1, b=2)})
    with pytest.raises(InputError, match=r"'weights' is a chumpy\.ch\.add, expected an array"):
        load_body(path)


def test_damaged_sparse_matrix_is_refused(tmp_path, smpl_arrays):
    regressor = csc_matrix(smpl_arrays["J_regressor"])
    regressor.indices = regressor.indices + 100
    path = tmp_path / "a.pkl"
    write_pickle(path, {**smpl_arrays, "J_regressor": regressor})
    with pytest.raises(InputError, match="'J_regressor' is a damaged"):
        load_body(path)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("v_template", np.zeros((VERTICES, 2)), r"'v_template' has shape \(6890, 2\), expected"),
        ("shapedirs", np.zeros((VERTICES, 3, 8)), r"'shapedirs' has shape .* \(6890, 3, 10\)"),
        ("J_regressor", np.zeros((52, VERTICES)), r"\(52, 6890\), expected \(24, 6890\)"),
        ("weights", np.zeros((VERTICES, 24)), r"'weights' of vertex 0 sum to 0\.000"),
        ("posedirs", np.full((VERTICES, 3, 207), np.nan), "'posedirs' holds values that are not"),
        ("f", np.full((9, 3), VERTICES), "'f' names vertex 6890, expected 0 to 6889"),
        ("kintree_table", np.zeros((2, 24), dtype=int), "not SMPL's tree"),
    ],
)
def test_wrong_arrays_are_named(tmp_path, smpl_arrays, key, value, message):
    path = tmp_path / "wrong.npz"
    np.savez(path, **{**smpl_arrays, key: value})
    with pytest.raises(InputError, match=message) as error:
        load_body(path)
    assert "wrong.npz" in str(error.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: {"v_template": 100 * a["v_template"]}, "is 170 tall along Y, expected a person"),
        (lambda a: {"v_template": 0.001 * a["v_template"]}, "is 0.0017 tall along Y"),
        (lambda a: {"v_template": a["v_template"] * [-1, 1, 1]}, "is it mirrored"),
        (lambda a: {"v_template": a["v_template"] * [1, -1, 1]}, "the head is below the hips"),
        (lambda a: {"weights": 5 * a["weights"] - 4 / 24}, "'weights' are from -0.167 to"),
    ],
)
def test_what_is_no_person_is_refused(tmp_path, smpl_arrays, change, message):
    path = tmp_path / "wrong.npz"
    np.savez(path, **{**smpl_arrays, **change(smpl_arrays)})
    with pytest.raises(InputError, match=message):
        load_body(path)


def test_other_unusable_files(tmp_path, smpl_arrays):
    with pytest.raises(InputError, match="no such file"):
        load_body(tmp_path / "none.npz")
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(InputError, match=r"'\.txt' file"):
        load_body(tmp_path / "a.txt")
    for name in ("a.npz", "a.pkl"):
        (tmp_path / name).write_bytes(b"\x80\x02 nonsense")
        with pytest.raises(InputError, match="not readable as"):
            load_body(tmp_path / name)
    write_pickle(tmp_path / "list.pkl", [1])
    with pytest.raises(InputError, match="holds a list"):
        load_body(tmp_path / "list.pkl")
    some = {k: v for k, v in smpl_arrays.items() if k != "weights"}
    np.savez(tmp_path / "less.npz", **some)
    with pytest.raises(InputError, match="lacks weights"):
        load_body(tmp_path / "less.npz")


@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_honest_pickles_may_hold_empty_arrays_and_single_numbers(tmp_path, smpl_arrays, protocol):
    extra = {"empty": np.zeros((0, 3)), "one": np.float64(2.5), "names": np.array(["a", "bc"])}
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({**smpl_arrays, **extra}, protocol))
    body = load_body(path)
    np.testing.assert_array_equal(body.faces, smpl_arrays["f"])
    assert body.v_template.flags.writeable


def _pickled(code):
    """The instructions that make one entry of a table of arrays."""
    return b"\x80\x02}U\x01v" + code + b"s."


_RAW = b"U\x08\x01\x02\x03\x04\x05\x06\x07\x08"


@pytest.mark.parametrize(
    "code",
    [
        # An object array over raw bytes, which are addresses to whoever reads it.
        b"cnumpy.core.multiarray\nscalar\ncnumpy\ndtype\nU\x02O8\x85R" + _RAW + b"\x86R",
        b"cnumpy.core.multiarray\n_frombuffer\n("
        + _RAW
        + b"cnumpy\ndtype\nU\x02O8\x85R(K\x01tU\x01CtR",
        # A type of numbers with fields and flags of the file's own.
        b"cnumpy\ndtype\nU\x02V8\x85R(K\x03U\x01|NNNK\x08K\x01K?tb",
        # An array of more numbers than there are bytes.
        b"cnumpy\nndarray\n(J\xff\xff\xff\x7fcnumpy\ndtype\nU\x02f8\x85RtR",
    ],
)
def test_pickles_that_reach_for_memory_are_refused(tmp_path, code):
    path = tmp_path / "a.pkl"
    path.write_bytes(_pickled(code))
    with pytest.raises(InputError, match=r"a\.pkl: (lacks v_template|not readable|asks)"):
        load_body(path)


def test_an_array_with_too_few_bytes_is_refused(tmp_path, smpl_arrays):
    path = tmp_path / "a.pkl"
    data = pickle.dumps({**smpl_arrays, "v_template": np.zeros((5, 3))}, protocol=2)
    assert data.count(b"K\x05K\x03\x86") == 1
    path.write_bytes(data.replace(b"K\x05K\x03\x86", b"K\x07K\x03\x86"))
    with pytest.raises(InputError, match=r"a\.pkl: 'v_template' is a damaged array"):
        load_body(path)


def test_lists_are_no_arrays(tmp_path, smpl_arrays):
    path = tmp_path / "a.pkl"
    write_pickle(path, {**smpl_arrays, "v_template": [[1.0], [2.0]]})
    with pytest.raises(InputError, match="'v_template' is a list, expected an array"):
        load_body(path)


def test_lists_that_hold_one_another_without_end_are_refused(tmp_path, smpl_arrays):
    twice = [1.0]
    for _ in range(40):
        twice = [twice, twice]
    path = tmp_path / "a.pkl"
    write_pickle(path, {**smpl_arrays, "v_template": twice})
    with pytest.raises(InputError, match="hold one another too often"):
        load_body(path)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("ft", np.array([[0, 1, 3]]), "'ft' names vertex 3, expected 0 to 2"),
        ("ft", np.array([[0, 1, 2**32]]), "'ft' names vertex 4294967296, expected 0 to 2"),
        ("ft", np.array([[0, 1, 2]] * 2), "'ft' has 2 faces, expected 1 like 'f'"),
        ("vt", np.zeros((3, 3)), r"'vt' has shape \(3, 3\), expected \(points, 2\)"),
        ("vt", np.full((3, 2), np.nan), "'vt' holds values that are not finite"),
        ("segmentation", np.full(VERTICES, 24), "'segmentation' is not the joint"),
        ("segmentation", np.zeros(5, int), "'segmentation' is not the joint"),
    ],
)
def test_texture_and_segmentation_are_checked(tmp_path, smpl_arrays, key, value, message):
    whole = {"f": np.array([[0, 1, 2]]), "vt": np.zeros((3, 2)), "ft": np.array([[0, 1, 2]])}
    np.savez(tmp_path / "a.npz", **{**smpl_arrays, **whole, key: value})
    with pytest.raises(InputError, match=message):
        load_body(tmp_path / "a.npz")
