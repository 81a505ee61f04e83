"""Garments of simulated samples, read from the files of their stages."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.learning_data.moving import load_moving, moving_files_test_first
from toys.moving import moving_garment, write_registered_sample


@pytest.fixture
def samples(toy_body, tmp_path):
    """An accepted training sample and a rejected test sample, in a shard."""
    return [
        write_registered_sample(tmp_path, toy_body, name, split, status)
        for name, split, status in (("00001", "train", "accepted"), ("00002", "test", "rejected"))
    ]


def shards(*samples):
    """With these samples and with their registrations."""
    return (
        list(dict.fromkeys(sample.tiny.folder.parent for sample in samples)),
        list(dict.fromkeys(sample.registration.parent for sample in samples)),
    )


def test_only_accepted_samples_are_loaded_root_relative(samples):
    found = list(load_moving(*shards(*samples), ["train"])["train"])
    assert {(m.sample, m.split, m.clip) for m in found} == {("00001", "train", "walk")}
    assert {m.name for m in found} == {"Tshirt", "Skirt"}
    for moving in found:
        np.testing.assert_allclose(moving.cloth, samples[0].tiny.vertices[moving.name], atol=1e-5)
        assert moving.faces.max() < moving.cloth.shape[1]
    assert not list(load_moving(*shards(*samples), ["test"])["test"])


def test_each_garment_is_read_when_it_is_its_turn(samples):
    turns = load_moving(*shards(*samples), ["train"])["train"]
    first = next(turns).name
    (last,) = {"Tshirt", "Skirt"} - {first}
    (samples[0].registration / f"{last}.npz").unlink()
    with pytest.raises(InputError, match=rf"{last}\.npz: no such file"):
        next(turns)


def test_pictures_take_held_out_garments_first(samples, toy_body, tmp_path):
    assert {m.split for m in moving_files_test_first(*shards(*samples))} == {"train"}
    held_out = write_registered_sample(tmp_path / "other", toy_body, "00003", "test")
    found = moving_files_test_first(*shards(*samples, held_out))
    assert [m.split for m in found] == ["test", "test", "train", "train"]
    loaded = found[1].load()
    assert (loaded.sample, loaded.name) == ("00003", found[1].name)
    np.testing.assert_allclose(loaded.cloth, held_out.tiny.vertices[loaded.name], atol=1e-5)
    alone = write_registered_sample(tmp_path / "alone", toy_body, "00004", "test", "rejected")
    with pytest.raises(InputError, match="none of 1 samples was accepted"):
        moving_files_test_first(*shards(alone))


def test_registered_points_lie_on_the_cloth_and_return_to_their_vertices(toy_body):
    moving = moving_garment(toy_body, "test", "Tshirt")
    frames = np.array([4, 1])
    points = moving.points(frames)
    np.testing.assert_array_equal(points, moving.cloth[frames])  # each point is a vertex here
    spread = moving.on_vertices(points[0])
    mask = moving.registered.mask
    np.testing.assert_array_equal(spread[mask], points[0])
    assert not spread[~mask].any()
