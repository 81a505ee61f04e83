"""Registered garments joined into mapped arrays."""

import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.learning_data.static import StaticData, collect_static
from drapeline.storage import save_npz


@pytest.fixture
def shards(tmp_path, toy_body):
    """Two shards of three garments; the second shard's last is for testing, far off."""
    rng = np.random.default_rng(0)
    count = len(toy_body.v_template)
    paths = []
    for number in range(2):
        splits = np.array(["train", "train", "test" if number else "val"])
        mask = rng.random((3, count)) < 0.5
        mask[:, 0], mask[:, 1] = True, False
        offsets = np.where(mask[..., None], rng.normal(0.1, 0.02, (3, count, 3)), 0)
        offsets[splits == "test"] *= 100
        paths.append(tmp_path / f"{number}.npz")
        save_npz(
            paths[-1],
            offsets=offsets.astype(np.float32),
            mask=mask,
            shape=rng.uniform(-1, 1, (3, 10)).astype(np.float32),
            gender=np.zeros(3, np.int8),
            tightness=rng.uniform(-1, 1, (3, 2)).astype(np.float32),
            garment=np.array([0, 3, 5], np.int8),
            outfit=np.array([f"s{number}{k}" for k in range(3)]),
            split=splits,
        )
    return paths


def test_rows_conditions_and_topologies(shards, tmp_path, toy_body):
    assert collect_static(tmp_path / "data", shards, {"female": toy_body}) == 6
    data = StaticData(tmp_path / "data")
    assert len(data) == 6
    assert {s: data.rows(s).tolist() for s in ("train", "val", "test")} == {
        "train": [0, 1, 3, 4],
        "val": [2],
        "test": [5],
    }
    assert isinstance(data.offsets, np.memmap)
    rows = np.array([4, 1])
    assert data.cvar(rows).shape == (2, 13)
    np.testing.assert_array_equal(data.cvar(rows)[:, :10], data.shape[rows])
    np.testing.assert_array_equal(data.topology(np.arange(6)), [0, 1, 1, 0, 1, 1])
    batch = data.batch(rows)
    np.testing.assert_array_equal(batch["offsets"], data.offsets[rows])
    assert batch["names"] == ["s11/Skirt", "s01/Skirt"]


def test_statistics_are_of_the_bodies_of_training_rows_only(shards, tmp_path, toy_body):
    collect_static(tmp_path / "data", shards, {"female": toy_body})
    data = StaticData(tmp_path / "data")
    train = data.rows("train")
    bodies = np.array([rest_body(toy_body, data.shape[r]) for r in train])
    np.testing.assert_allclose(data.body_mean, bodies.mean(0), atol=1e-5)


def test_shards_of_other_bodies_and_lost_files_are_refused(shards, tmp_path, toy_body):
    collect_static(tmp_path / "data", shards, {"female": toy_body})
    np.save(tmp_path / "data" / "mask.npy", np.zeros((5, 3), dtype=bool))
    with pytest.raises(InputError, match=r"mask.npy.*expected \(6, "):
        StaticData(tmp_path / "data")
    (tmp_path / "data" / "rows.npz").unlink()
    with pytest.raises(InputError, match=r"rows.npz"):
        StaticData(tmp_path / "data")
    count = len(toy_body.v_template)
    with np.load(shards[1]) as arrays:
        less = dict(arrays)
    less["offsets"] = less["offsets"][:, :-1]
    save_npz(shards[1], **less)
    with pytest.raises(
        InputError, match=rf"1\.npz: .*has shape \(\d+, {count}\).*expected \(\d+, {count - 1}\)"
    ):
        collect_static(tmp_path / "data", shards, {"female": toy_body})
