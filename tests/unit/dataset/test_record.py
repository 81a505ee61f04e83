from dataclasses import replace

import pytest

from drapeline.dataset.record import (
    EXTRAS,
    body_fingerprint,
    clip_name,
    meta_path,
    read_meta,
    read_record,
)
from drapeline.errors import InputError
from drapeline.storage import write_json
from toys.tiny_sample import write_tiny_sample


def test_a_record_tells_the_files_of_cloth3d_from_the_others(tiny):
    record = read_record(tiny.folder)
    names = ["info.mat", "Tshirt.obj", "Tshirt.pc16", "Skirt.obj", "Skirt.pc16"]
    assert record.accepted
    assert record.meta["id"] == "00001"
    assert record.cloth3d_bytes == sum((tiny.folder / name).stat().st_size for name in names)
    assert record.total_bytes == sum(
        path.stat().st_size for path in tiny.folder.rglob("*") if path.is_file()
    )


def test_a_rejected_sample_has_a_record_without_data(tmp_path, toy_body):
    folder = write_tiny_sample(tmp_path, toy_body, status="rejected").folder
    record = read_record(folder)
    assert not record.accepted
    assert record.cloth3d_bytes == 0
    files = (folder / EXTRAS).iterdir()
    assert record.total_bytes == sum(path.stat().st_size for path in files)


def test_an_incomplete_meta_is_named(tmp_path, toy_body):
    folder = write_tiny_sample(tmp_path, toy_body).folder
    meta = read_meta(folder)
    del meta["motion"], meta["split"]
    write_json(meta_path(folder), meta)
    with pytest.raises(InputError, match="meta.json: lacks split, motion"):
        read_record(folder)
    meta_path(folder).unlink()
    with pytest.raises(InputError, match="meta.json: no such file"):
        read_record(folder)


@pytest.mark.parametrize(
    "array", ["v_template", "shapedirs", "posedirs", "J_regressor", "weights", "faces"]
)
def test_a_fingerprint_changes_with_every_array_that_moves_vertices(toy_body, array):
    changed = getattr(toy_body, array).copy()
    changed.flat[-1] += 1
    other = replace(toy_body, **{array: changed})
    assert body_fingerprint(other) != body_fingerprint(toy_body)
    assert body_fingerprint(replace(toy_body, name="other")) == body_fingerprint(toy_body)


@pytest.mark.parametrize(
    ("meta", "clip"),
    [
        ({"motion": {"sequence": "dance_a_s0"}}, "dance_a"),
        ({"motion": {"sequence": "run_s1_s12"}}, "run_s1"),
        ({"motion": {"sequence": "walk"}}, "walk"),
        ({"motion": {}}, "00001"),
        ({}, "00001"),
    ],
)
def test_pieces_of_a_clip_have_its_name_and_other_samples_their_own(meta, clip):
    assert clip_name(meta, "00001") == clip
