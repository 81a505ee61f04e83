import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.models.garment4d.data import training_worn_statistics
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.models.garment4d.stages import load_posed_files, save_posed_files
from drapeline.storage import save_npz

SKINNING = SkinningSettings(neighbours=16, passes=5)


def test_bodies_sizes_and_statistics_come_back(sequences, tmp_path):
    save_posed_files(tmp_path, sequences, SKINNING)
    bodies, points, worn = load_posed_files(tmp_path)
    assert points == sequences.data.points.shape[1]
    for name, array in sequences.bodies.arrays().items():
        np.testing.assert_array_equal(bodies.arrays()[name], array)
    wanted = training_worn_statistics(sequences, SKINNING)
    for part, again in zip(wanted, worn, strict=True):
        np.testing.assert_array_equal(part, again)


def test_without_simulated_training_sequences_there_are_no_statistics(sequences, tmp_path):
    sequences.data.source = np.full_like(sequences.data.source, "skinned")
    save_posed_files(tmp_path, sequences, SKINNING)
    assert load_posed_files(tmp_path).worn_statistics is None


def test_a_missing_body_is_named(sequences, tmp_path):
    save_posed_files(tmp_path, sequences, SKINNING)
    (tmp_path / "bodies" / f"{GENDERS[1]}.npz").unlink()
    with pytest.raises(InputError, match=r"male\.npz: no such file"):
        load_posed_files(tmp_path)


def test_numbers_of_points_are_above_zero(tmp_path):
    save_npz(tmp_path / "reconstruction.npz", body_points=-1, points=5)
    with pytest.raises(InputError, match=r"reconstruction\.npz: 'body_points' is -1, expected at"):
        load_posed_files(tmp_path)
