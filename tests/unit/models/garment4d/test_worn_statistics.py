import numpy as np

from drapeline.models.garment4d.data import (
    measure_worn_garments,
    training_worn_statistics,
)
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.registration.springs import springs
from toys.gcvae import tube, tube_faces

FACES = tube_faces(False)


def test_worn_statistics_are_means_over_sequences_with_one_of_the_mean():
    rest = tube()
    moving = rest + 0.01 * np.sin(2 * np.arange(6))[:, None, None] * np.array([0, 0, 1.0])
    half = rest + 0.5 * (moving - rest)
    found = measure_worn_garments([half], [moving], [rest], FACES)
    np.testing.assert_allclose(found.shares, 1, atol=1e-9)
    np.testing.assert_allclose(found.follow, 0.5)
    wanted = np.sqrt(((half - moving)[:, 0] ** 2).sum(1).mean())
    np.testing.assert_allclose(found.error_m, wanted)
    # Twice as high, in one of two sequences: upright springs have shares of 1 and 2.
    high = moving * [1, 1, 2]
    found = measure_worn_garments([moving, high], [moving, high], [rest, rest], FACES)
    pairs = springs(FACES)[0]
    upright = np.linalg.norm((rest[pairs[:, 0]] - rest[pairs[:, 1]])[:, :2], axis=1) < 1e-9
    level = np.abs(rest[pairs[:, 0], 2] - rest[pairs[:, 1], 2]) < 1e-9
    assert upright.any()
    assert level.any()
    mean = (3 * found.shares[level][0] - 2) / 1
    np.testing.assert_allclose(found.shares[level], (1 + 1 + mean) / 3)
    np.testing.assert_allclose(found.shares[upright], (1 + 2 + mean) / 3)
    assert 1 < mean < 1.5
    np.testing.assert_allclose(found.follow, 1)
    np.testing.assert_allclose(found.error_m, 0, atol=1e-9)


def test_worn_statistics_are_those_beside_proposals_of_the_skinning_asked_for(sequences):
    # Toy garments are skinned like this, and sway by up to 2 cm.
    own = training_worn_statistics(sequences, SkinningSettings(neighbours=16, passes=5))
    other = training_worn_statistics(sequences, SkinningSettings(neighbours=1, passes=0))
    assert own.error_m.max() < 0.021
    assert own.error_m.mean() < 0.9 * other.error_m.mean()
    np.testing.assert_allclose(own.shares, other.shares)
