import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.motions.importing import import_motion
from drapeline.motions.motion import Cycle, Motion, save_motion
from drapeline.motions.table import MotionTable


@pytest.fixture
def folder(tmp_path):
    """Two clips: one plain, one cyclic."""
    poses = np.repeat(REST_POSE[None], 20, 0)
    trans = np.tile([0.0, 0.0, 0.9], (20, 1))
    for name, cycle in (("plain", None), ("round", Cycle(0.0, np.array([0.0, -0.4])))):
        motion = Motion(poses, trans, 30.0, "stand", "", name, name, cycle=cycle)
        save_motion(tmp_path / f"{name}.npz", motion)
    return tmp_path


def table(folder, *rows, header="name\tfile\taction\tloop"):
    path = folder / "clips.tsv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def entries(path, names=(), folder=None):
    return MotionTable(path, folder).entries(names, loop_frames=50)


ROWS = ("a\tplain.npz\twait\tno", "b\tround.npz\t\tyes")


def test_rows_become_entries_with_the_frames_that_an_import_returns(folder):
    found = entries(table(folder, *ROWS))
    assert {name: e.frames for name, e in found.items()} == {"a": 20, "b": 50}
    for entry in found.values():
        motion = import_motion(entry.files["motion"], **entry.parameters())
        assert len(motion) == entry.frames
    assert found["a"].parameters()["action"] == "wait"
    assert list(found["a"].files) == ["motion"]


def test_names_choose_rows_and_their_order(folder):
    assert list(entries(table(folder, *ROWS), ["b", "a"])) == ["b", "a"]


@pytest.mark.parametrize(
    ("rows", "header", "names", "message"),
    [
        ((), "name\tfile", (), "lists no motion, expected at least one row"),
        (ROWS, "nom\tfile\taction\tloop", (), "columns action, file, loop, nom, expected name and"),
        ((ROWS[0], ROWS[0]), "name\tfile\taction\tloop", (), "'a' is listed twice"),
        (ROWS, "name\tfile\taction\tloop", ("c",), "lists no 'c', expected one of a, b"),
        (("a\tplain.npz\t\tmaybe",), "name\tfile\taction\tloop", (), "has loop 'maybe', expected"),
        (("a\tnone.npz\t\tno",), "name\tfile\taction\tloop", (), "none.npz: no such file"),
        (("a\tplain.npz\tx",), "name\tfile\tamc_fps", (), "has amc_fps 'x', expected a number"),
        (
            ("a\tplain.npz\t-1",),
            "name\tfile\tstart_s",
            (),
            "start_s '-1', expected a number of",
        ),
        (("a\tplain.npz\t9e9",), "name\tfile\tstart_s", (), "start_s is 9e.09, expected 0 to less"),
        (("a\tplain.npz\t0",), "name\tfile\tend_s", (), "has end_s '0', expected a number above 0"),
        (
            ("a\tplain.npz\tyes\t1",),
            "name\tfile\tloop\tend_s",
            (),
            "has loop yes and start_s or end_s, expected a whole round",
        ),
    ],
)
def test_an_unusable_table_is_named(folder, rows, header, names, message):
    with pytest.raises(InputError, match=message):
        entries(table(folder, *rows, header=header), names)


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(InputError, match="none.tsv: no such file, expected a table of motions"):
        entries(tmp_path / "none.tsv")


@pytest.mark.parametrize(
    "name", ["../../evil", "walk (2)", "a+b", "a[b", "", ".hidden", "é", "a b"]
)
def test_a_name_that_is_no_part_of_a_path_is_refused(folder, name):
    path = table(folder, f"{name}\tplain.npz\t\tno")
    with pytest.raises(InputError, match=r"clips\.tsv: the name of motion 1 is '.*', expected up"):
        entries(path)


def test_a_file_may_be_called_anything(folder):
    (folder / "walk (2) [é].npz").write_bytes((folder / "plain.npz").read_bytes())
    assert entries(table(folder, "a\twalk (2) [é].npz"))["a"].frames == 20


def test_fields_may_be_left_out_at_the_end_of_a_row_but_not_added(folder):
    assert entries(table(folder, "a\tplain.npz"))["a"].action == ""
    with pytest.raises(InputError, match=r"clips\.tsv: line 2 has 5 fields, expected 4 as in the"):
        entries(table(folder, "a\tplain.npz\twait\tno\tyes"))


def test_text_in_another_encoding_is_refused_with_its_line(folder):
    path = table(folder, *ROWS)
    path.write_bytes(path.read_bytes().replace(b"wait", b"caf\xe9"))
    with pytest.raises(InputError, match=r"clips\.tsv: line 2 is not UTF-8 text \(byte 0xe9\)"):
        entries(path)


@pytest.mark.parametrize("rate", ["0", "-1", "nan", "inf", "x"])
def test_a_rate_must_be_above_zero(folder, rate):
    path = table(folder, f"a\ta.amc\t{rate}", header="name\tfile\tamc_fps")
    with pytest.raises(InputError, match=rf"'a' has amc_fps '{rate}', expected a number above 0"):
        entries(path)


OPTIONAL = ("a\tplain.npz\tno", "b\ttake.npz\tyes")


def optional_table(folder):
    return table(folder, *OPTIONAL, header="name\tfile\toptional")


def test_an_optional_clip_that_is_not_there_is_left_out(folder):
    path = optional_table(folder)
    assert MotionTable(path).left_out == ["b"]
    assert list(entries(path)) == ["a"]
    assert list(entries(path, ["b", "a"])) == ["a"]
    with pytest.raises(InputError, match=r"none of the clips is there, expected motions\.folder"):
        entries(path, ["b"])


def test_clips_may_lie_in_a_folder_of_their_own(folder, tmp_path):
    recordings = tmp_path / "recordings"
    recordings.mkdir()
    (recordings / "take.npz").write_bytes((folder / "plain.npz").read_bytes())
    path = optional_table(folder)
    found = entries(path, folder=recordings)
    assert [entry.path for entry in found.values()] == [
        str(folder / "plain.npz"),
        str(recordings / "take.npz"),
    ]


def test_with_a_folder_no_clip_may_be_missing(folder, tmp_path):
    with pytest.raises(InputError, match=r"'b': .*take\.npz: no such file"):
        entries(optional_table(folder), folder=tmp_path / "elsewhere")


@pytest.mark.parametrize(
    ("row", "header", "message"),
    [
        ("a\tplain.npz\t12ab", "name\tfile\tsha256", "has sha256 '12ab', expected 64 hexadecimal"),
        ("a\tplain.npz\t" + "0" * 64, "name\tfile\tasf_sha256", "has asf_sha256 and no asf"),
        ("a\tplain.npz\tmaybe", "name\tfile\toptional", "has optional 'maybe', expected yes or"),
    ],
)
def test_sums_and_options_are_checked(folder, row, header, message):
    with pytest.raises(InputError, match=message):
        entries(table(folder, row, header=header))
