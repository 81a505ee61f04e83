"""Messages of one line, and what parsers raise as one of them."""

import errno
import os
import pickle

import pytest

from drapeline.errors import DamagedFile, InputError, refuse_damage


def test_a_message_is_one_printable_line_of_bounded_length():
    assert str(InputError("a.obj: line 3 is 'v é 1'")) == "a.obj: line 3 is 'v é 1'"
    assert str(InputError("a\nb\x00\x1b[0m\ud800")) == r"a\nb\x00\x1b[0m\ud800"
    long = str(InputError("start " + "x" * 5000 + " end"))
    assert len(long) < 1100
    assert long.startswith("start ")
    assert long.endswith(" end")


def test_an_error_survives_being_sent_to_another_process():
    error = pickle.loads(pickle.dumps(InputError("a.obj: damaged")))
    assert isinstance(error, InputError)
    assert str(error) == "a.obj: damaged"


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (KeyError("poses"), r"a\.mat: not readable as MATLAB \('poses'\)"),
        (ValueError("first\nsecond"), r"a\.mat: not readable as MATLAB \(first\)"),
        (RecursionError(), r"a\.mat: not readable as MATLAB \(RecursionError\)"),
        (FileNotFoundError(2, "x"), r"a\.mat: no such file, expected MATLAB"),
    ],
)
def test_whatever_a_parser_raises_names_the_file(error, message):
    with pytest.raises(InputError, match=message), refuse_damage("a.mat", "MATLAB"):
        raise error


@pytest.mark.parametrize("number", [errno.EACCES, errno.EIO, errno.EMFILE])
def test_a_failing_machine_is_not_called_a_damaged_file(number):
    error = OSError(number, os.strerror(number))
    with pytest.raises(InputError) as caught, refuse_damage("a.mat", "MATLAB"):
        raise error
    assert str(caught.value).startswith(f"a.mat: cannot be read ({error.strerror})")
    assert not isinstance(caught.value, DamagedFile)


@pytest.mark.parametrize(
    "error", [InputError("b.obj: its own"), MemoryError(), KeyboardInterrupt()]
)
def test_what_is_not_damage_passes(error):
    with pytest.raises(type(error)) as caught, refuse_damage("a.mat", "MATLAB"):
        raise error
    assert caught.value is error


def test_pipes_and_devices_are_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "zeros.json").symlink_to("/dev/zero")
    for name in ("pipe.yaml", "zeros.json"):
        with (
            pytest.raises(InputError, match=f"{name}: a pipe, socket or device, expected YAML"),
            refuse_damage(tmp_path / name, "YAML"),
        ):
            raise AssertionError("it was opened")
