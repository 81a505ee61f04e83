import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.motions.importing import import_motion
from drapeline.motions.motion import Cycle, Motion, save_motion
from drapeline.motions.table import motion_table


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


ROWS = ("a\tplain.npz\twait\tno", "b\tround.npz\t\tyes")


def test_rows_become_entries_with_the_frames_that_an_import_returns(folder):
    entries = motion_table(table(folder, *ROWS), loop_frames=50)
    assert {name: e.frames for name, e in entries.items()} == {"a": 20, "b": 50}
    for entry in entries.values():
        motion = import_motion(entry.files["motion"], **entry.parameters())
        assert len(motion) == entry.frames
    assert entries["a"].parameters()["action"] == "wait"
    assert list(entries["a"].files) == ["motion"]


def test_names_choose_rows_and_their_order(folder):
    assert list(motion_table(table(folder, *ROWS), ["b", "a"], loop_frames=50)) == ["b", "a"]


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
        motion_table(table(folder, *rows, header=header), names, loop_frames=50)


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(InputError, match="none.tsv: no such file, expected a table of motions"):
        motion_table(tmp_path / "none.tsv", loop_frames=50)


@pytest.mark.parametrize(
    "name", ["../../evil", "walk (2)", "a+b", "a[b", "", ".hidden", "é", "a b"]
)
def test_a_name_that_is_no_part_of_a_path_is_refused(folder, name):
    path = table(folder, f"{name}\tplain.npz\t\tno")
    with pytest.raises(InputError, match=r"clips\.tsv: the name of motion 1 is '.*', expected up"):
        motion_table(path, loop_frames=50)


def test_a_file_may_be_called_anything(folder):
    (folder / "walk (2) [é].npz").write_bytes((folder / "plain.npz").read_bytes())
    assert motion_table(table(folder, "a\twalk (2) [é].npz"), loop_frames=50)["a"].frames == 20


def test_fields_may_be_left_out_at_the_end_of_a_row_but_not_added(folder):
    assert motion_table(table(folder, "a\tplain.npz"), loop_frames=50)["a"].action == ""
    with pytest.raises(InputError, match=r"clips\.tsv: line 2 has 5 fields, expected 4 as in the"):
        motion_table(table(folder, "a\tplain.npz\twait\tno\tyes"), loop_frames=50)


def test_text_in_another_encoding_is_refused_with_its_line(folder):
    path = table(folder, *ROWS)
    path.write_bytes(path.read_bytes().replace(b"wait", b"caf\xe9"))
    with pytest.raises(InputError, match=r"clips\.tsv: line 2 is not UTF-8 text \(byte 0xe9\)"):
        motion_table(path, loop_frames=50)


@pytest.mark.parametrize("rate", ["0", "-1", "nan", "inf", "x"])
def test_a_rate_must_be_above_zero(folder, rate):
    path = table(folder, f"a\ta.amc\t{rate}", header="name\tfile\tamc_fps")
    with pytest.raises(InputError, match=rf"'a' has amc_fps '{rate}', expected a number above 0"):
        motion_table(path, loop_frames=50)
