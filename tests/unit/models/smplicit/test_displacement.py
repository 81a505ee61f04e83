import numpy as np
import pytest

from drapeline.bodies.rest_skinning import tpose_motions
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.models.load import load
from drapeline.models.smplicit.displacement import PoseDisplacement
from drapeline.models.smplicit.repose import garment_weights
from drapeline.seeding import rng_for
from toys.displacement_trainings import train_toy_displacement
from toys.smplicit import tube

SHAPE = 0.5 * rng_for(0, "shape").normal(size=10)


@pytest.fixture(scope="module")
def trained(tmp_path_factory, displacements, toy_body):
    return train_toy_displacement(tmp_path_factory.mktemp("trained"), displacements, toy_body)


def test_it_is_what_load_gives(trained):
    model = load(trained)
    assert isinstance(model, PoseDisplacement)
    assert model.name == "skirt"
    assert model.codes.shape == (3, 3)


def test_no_code_is_zero(trained, toy_body):
    model, mesh = load(trained), tube(0.3, -0.5, 0.0)
    given = (
        mesh.vertices,
        garment_weights(mesh, toy_body, SHAPE),
        REST_POSE[None],
        tpose_motions(toy_body, SHAPE, REST_POSE[None]),
    )
    wearer = {"gender": "female", "shape": SHAPE}
    unknown, zero, other = (
        model.worn_by(**wearer, z=z).displace(*given) for z in (None, np.zeros(3), np.full(3, 5.0))
    )
    np.testing.assert_array_equal(unknown, zero)
    assert np.abs(other - zero).max() > 1e-6


def test_bad_input_is_refused(trained):
    model = PoseDisplacement(trained)
    with pytest.raises(InputError, match="gender: 'child', expected one of"):
        model.worn_by(gender="child", shape=SHAPE)
    with pytest.raises(InputError, match=r"shape: shape \(3,\), expected 10"):
        model.worn_by(gender="male", shape=SHAPE[:3])
    with pytest.raises(InputError, match=r"z_theta: shape \(4,\), expected 3"):
        model.worn_by(gender="male", shape=SHAPE, z=np.zeros(4))
