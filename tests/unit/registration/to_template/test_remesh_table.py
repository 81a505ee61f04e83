"""Garments in the topology of their template, and the tables that take them there."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.registration.to_template.remesh_table import RemeshTable, load_tables, remesh
from drapeline.storage import load_npz, save_npz

TABLE = RemeshTable(
    np.array([[0, 1, 2], [2, 2, 0]], dtype=np.int32),
    np.array([[0.25, 0.5, 0.25], [0.5, 0.5, 0.0]], dtype=np.float32),
)


def test_template_vertices_follow_their_corners_in_every_frame():
    cloth = np.array([[0, 0, 0], [4, 0, 0], [0, 8, 0]], dtype=np.float32)
    frames = np.stack([cloth, cloth + 1])
    np.testing.assert_allclose(remesh(cloth, TABLE), [[2, 2, 0], [0, 8, 0]])
    np.testing.assert_allclose(
        remesh(frames, TABLE), [[[2, 2, 0], [0, 8, 0]], [[3, 3, 1], [1, 9, 1]]]
    )


@pytest.fixture
def folders(tmp_path):
    for number, name in enumerate(("s1", "s2")):
        arrays = {f"{name}/{key}": value for key, value in TABLE._asdict().items()}
        save_npz(tmp_path / str(number) / "Skirt.npz", **arrays)
    return [tmp_path / "0", tmp_path / "1"]


def test_tables_of_all_folders_are_read_by_name(folders):
    tables = load_tables(folders, "Skirt")
    assert set(tables) == {"s1", "s2"}
    np.testing.assert_array_equal(tables["s2"].shares, TABLE.shares)


def test_a_table_without_shares_is_refused(folders):
    arrays = load_npz(folders[1] / "Skirt.npz", {"*": "number ..."})
    del arrays["s2/shares"]
    save_npz(folders[1] / "Skirt.npz", **arrays)
    with pytest.raises(InputError, match=r"1/Skirt.npz: lacks s2/shares"):
        load_tables(folders, "Skirt")
