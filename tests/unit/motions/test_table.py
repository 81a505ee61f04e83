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
    ],
)
def test_an_unusable_table_is_named(folder, rows, header, names, message):
    with pytest.raises(InputError, match=message):
        motion_table(table(folder, *rows, header=header), names, loop_frames=50)


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(InputError, match="none.tsv: no such file, expected a table of motions"):
        motion_table(tmp_path / "none.tsv", loop_frames=50)
