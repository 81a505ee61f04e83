"""Pickles that ask for more than they hold are refused before anything is carried out."""

import pickle
from collections import OrderedDict

import numpy as np
import pytest

from drapeline.pickles import pickle_end

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
