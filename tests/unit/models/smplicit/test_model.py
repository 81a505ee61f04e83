import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, boundary_loops
from drapeline.learning_data.garment_fields import unsigned_distances
from drapeline.models.load import load
from drapeline.models.package import pack_model
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.settings import Meshing
from drapeline.models.smplicit.surface.fields import REACH_M, NearBody
from drapeline.models.smplicit.surface.sheet import away_from_body, garment_of_field
from toys.smplicit import tube
from toys.smplicit_trainings import train_toy

BOX = ((-0.6, -0.6, -0.8), (0.6, 0.6, 0.2))
BODY, SKIRT = tube(0.15, -0.9, 0.3), tube(0.3, -0.5, 0.0)
WEARER = {"gender": "female", "shape": [0.0] * 10}


class Exact:
    """Distances to a mesh, and how many were asked for."""

    clip_m = 0.03

    def __init__(self, mesh):
        self.mesh, self.count = mesh, 0

    def distances(self, points):
        self.count += len(points)
        return np.minimum(unsigned_distances(points, self.mesh), self.clip_m)

    def gradients(self, points):
        step = 1e-3 * np.eye(3, dtype=np.float32)
        slopes = [(self.distances(points + s) - self.distances(points - s)) / 2e-3 for s in step]
        return self.distances(points), np.stack(slopes, axis=1)


@pytest.fixture(scope="module")
def model(tmp_path_factory, fields, toy_body):
    return SmplicitModel(train_toy(tmp_path_factory.mktemp("model"), fields, toy_body))


def test_a_field_becomes_an_open_surface_and_closed_walls():
    garment = garment_of_field(Exact(SKIRT), BOX, BODY, Meshing(cell_m=0.02, threshold_m=0.014))
    assert len(boundary_loops(garment.sheet.faces)) == 2
    assert len(boundary_loops(garment.walls.faces)) == 0
    assert unsigned_distances(garment.sheet.vertices, SKIRT).mean() < 0.004
    assert unsigned_distances(garment.walls.vertices, SKIRT).mean() > 0.012


def test_cloth_is_looked_for_near_the_body_alone():
    exact = Exact(SKIRT)
    near = NearBody(exact, BOX, BODY.vertices)
    points = np.random.default_rng(0).uniform(*BOX, (500, 3))
    found = near.distances(points)
    away = unsigned_distances(points, BODY)
    inside = away < REACH_M
    expected = Exact(SKIRT).distances(points)
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-6)
    assert exact.count < len(points)
    assert (found[found != expected] == np.float32(REACH_M)).all()


def test_the_way_out_is_the_normal_of_the_nearest_skin():
    points = np.array([[0.4, 0.0, -0.3], [0.0, -0.4, -0.3]])
    np.testing.assert_allclose(away_from_body(points, BODY), points * [2.5, 2.5, 0], atol=0.1)


def test_codes_are_decoded_on_any_body(model):
    garment = model.decode(
        model.mean_code, **WEARER, meshing=Meshing(cell_m=0.04, threshold_m=0.028)
    )
    assert isinstance(garment.sheet, Mesh)
    assert garment.walls.vertices.shape[1] == 3
    field = model.field(model.mean_code, **WEARER)
    on_walls = field.distances(garment.walls.vertices)
    if len(on_walls):
        np.testing.assert_allclose(on_walls, 0.028, atol=0.02)


def test_the_shared_loader_knows_it(model):
    loaded = load(model.folder)
    assert isinstance(loaded, SmplicitModel)
    assert loaded.garments == ("Skirt",)
    np.testing.assert_array_equal(loaded.codes.z, model.codes.z)


@pytest.mark.portable
def test_a_packed_model_gives_nearly_the_same(model, tmp_path):
    pack_model(model.folder, tmp_path / "skirt")
    packed = load(tmp_path / "skirt")
    np.testing.assert_allclose(packed.codes.z, model.codes.z, atol=1e-3)
    for gender, body in model.bodies.items():
        np.testing.assert_array_equal(packed.bodies[gender].faces, body.faces)
    points = np.random.default_rng(0).uniform(*BOX, (500, 3)).astype(np.float32)
    whole, half = (
        one.field(model.mean_code, **WEARER).distances(points) for one in (model, packed)
    )
    assert np.abs(half - whole).mean() < 1e-3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"z": np.zeros(3)}, r"code: shape \(3,\), expected 5 finite numbers"),
        ({"z": np.full(5, np.nan)}, "code: .* finite"),
        ({"shape": [0.0] * 3}, "shape: .* expected 10"),
        ({"gender": "other"}, "gender: 'other', expected one of female, male"),
    ],
)
def test_wrong_arguments_are_named(model, changes, message):
    arguments = {"z": model.mean_code, **WEARER, **changes}
    with pytest.raises(InputError, match=message):
        model.field(**arguments)


def test_samples_are_codes_of_the_models_and_follow_the_seed(model):
    codes = model.sample(3, seed=1)
    assert codes.shape == (3, model.latent)
    assert np.array_equal(codes, model.sample(4, seed=1)[:3])
    assert not np.array_equal(codes, model.sample(3, seed=2))
    low, high = model.codes.z.min(axis=0), model.codes.z.max(axis=0)
    assert (codes >= low - 1e-6).all()
    assert (codes <= high + 1e-6).all()
