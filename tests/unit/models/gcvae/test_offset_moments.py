"""Mean and deviation of offsets, of each topology."""

import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.learning_data.vertex_moments import OFFSET_STD_FLOOR_M
from drapeline.models.gcvae.data import offset_moments

OFFSETS = np.random.default_rng(3).normal(0, 0.1, (9, 4, 3)).astype(np.float32)
MASK = np.ones((9, 4), dtype=bool)
MASK[:, 1] = False
TOPOLOGY = np.array([0, 1, 0, 0, 1, 1, 0, 1, 0])
TRAIN = np.arange(1, 9)  # the first row is held out


def moments(topology, of_each):
    shown = np.where(MASK[..., None], OFFSETS, 7.0)  # whatever stands outside the mask
    return offset_moments(
        lambda row: (shown[row], MASK[row]), TRAIN, topology[TRAIN], names, of_each=of_each
    )


def names(rows):
    return [f"toy{row}" for row in rows]


def test_each_topology_has_its_own_where_there_is_a_garment():
    mean, std = moments(TOPOLOGY, of_each=True)
    for code in (0, 1):
        worn = OFFSETS[TRAIN[TOPOLOGY[TRAIN] == code]][:, [0, 2, 3]]
        np.testing.assert_allclose(mean[code, [0, 2, 3]], worn.mean(0), atol=1e-6)
        np.testing.assert_allclose(std[code, [0, 2, 3]], worn.std(0), atol=1e-6)
        assert not mean[code, 1].any()  # never worn
    assert (std >= OFFSET_STD_FLOOR_M).all()


@pytest.mark.parametrize(
    ("topology", "of_each"), [(TOPOLOGY, False), (np.zeros(9, dtype=int), True)]
)
def test_together_they_have_those_of_all_and_so_has_one_without_garments(topology, of_each):
    mean, std = moments(topology, of_each=of_each)
    worn = OFFSETS[TRAIN][:, [0, 2, 3]]
    for code in (0, 1):
        np.testing.assert_allclose(mean[code, [0, 2, 3]], worn.mean(0), atol=1e-6)
        np.testing.assert_allclose(std[code, [0, 2, 3]], worn.std(0), atol=1e-6)


def test_garments_that_are_not_finite_are_named():
    spoilt = OFFSETS.copy()
    spoilt[5, 2] = np.inf

    def read(row):
        return spoilt[row], MASK[row]

    with pytest.raises(InputError, match="^samples toy5: offsets hold NaN"):
        offset_moments(read, TRAIN, TOPOLOGY[TRAIN], names, of_each=True)
