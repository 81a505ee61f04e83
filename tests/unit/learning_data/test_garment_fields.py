import numpy as np
import pytest

from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.learning_data.garment_fields import (
    FieldData,
    body_clusters,
    collect_fields,
    covered_often,
    sample_field,
    sample_fields,
    unsigned_distances,
)
from drapeline.learning_data.occlusion import texture_pixels
from drapeline.seeding import rng_for
from drapeline.storage import load_npz, save_npz
from toys.bodies import toy_body as make_toy_body
from toys.smplicit import (
    BOXES,
    CLUSTERS,
    POINTS,
    RESOLUTION,
    SPLITS,
    toy_bodies,
    toy_fields,
    toy_outfits,
    toy_shard,
    tube,
)

BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
SHELL = tube(0.5, -0.4, 0.4, around=12, rings=3)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return toy_fields(tmp_path_factory.mktemp("fields"), make_toy_body)


def brute_force(point, mesh):
    """The least distance to very many places of each triangle."""
    steps = np.linspace(0, 1, 60)
    u, v = (a.ravel() for a in np.meshgrid(steps, steps))
    u, v = u[u + v <= 1], v[u + v <= 1]
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(float) for k in range(3))
    places = (a[:, None] + u[:, None] * (b - a)[:, None] + v[:, None] * (c - a)[:, None]).reshape(
        -1, 3
    )
    return np.linalg.norm(places - point, axis=1).min()


def test_distances_are_those_to_the_open_surface():
    points = np.random.default_rng(0).uniform(-1, 1, (25, 3)).astype(np.float32)
    found = unsigned_distances(points, SHELL)
    expected = [brute_force(point, SHELL) for point in points]
    np.testing.assert_allclose(found, expected, atol=6e-3)
    assert (found <= np.array(expected) + 1e-5).all()
    # Not closed: a point in the middle of the opening is half a metre from its rim.
    middle = unsigned_distances(np.array([[0, 0, 0.4]]), SHELL)[0]
    assert middle == pytest.approx(0.5, abs=0.02)


def test_points_lie_near_the_garment_in_the_box_and_near_the_skin():
    body = tube(0.2, -1.5, 0.9)
    sampled = sample_field(rng_for(0), SHELL, body, BOX, near=2000, space=2000)
    near, space = sampled["near_distance"], sampled["space_distance"]
    for name in ("near", "space"):
        expected = unsigned_distances(sampled[name], SHELL)
        np.testing.assert_array_equal(sampled[f"{name}_distance"], expected)
    assert np.median(near[::2]) < 0.006 < np.median(near[1::2]) < 0.03
    uniform, skin, beyond = (sampled["space"][k::n] for k, n in ((0, 2), (1, 4), (3, 4)))
    assert (np.abs(uniform) <= 1).all()
    np.testing.assert_allclose(uniform.mean(axis=0), 0, atol=0.08)
    np.testing.assert_allclose(uniform.std(axis=0), 3**-0.5, atol=0.04)
    from_skin = unsigned_distances(skin, body)
    assert np.median(from_skin) < 0.03
    # Skin outside the box is left out.
    assert skin[:, 2].min() > -1.2
    assert space.max() > 0.3
    # The shell would go on as a tube, above and below, on a polygon of twelve sides.
    height = np.abs(beyond[:, 2])
    assert np.percentile(height, [1, 99]) == pytest.approx([0.4, 0.6], abs=0.02)
    radius = np.linalg.norm(beyond[:, :2], axis=1)
    np.testing.assert_allclose(radius, 0.49, atol=0.04)
    assert 0.4 < (beyond[:, 2] > 0).mean() < 0.6


def test_a_seed_gives_the_same_points_for_a_garment_whatever_else_is_in_the_shard(toy_body):
    whole = toy_shard(make_toy_body)
    part = sample_fields(
        toy_outfits()[2:3],
        toy_bodies(toy_body),
        texture_pixels(toy_body, RESOLUTION),
        BOXES,
        seed=0,
        near=POINTS,
        space=POINTS,
    )
    for name, values in part.items():
        np.testing.assert_array_equal(values[0], whole[name][2])


def test_rows_say_what_they_are(data):
    assert data.split.tolist() == list(SPLITS)
    assert data.rows("val").tolist() == [4, 5]
    assert data.gender.tolist() == ["female", "male"] * 4
    assert data.names(np.array([3])) == ["s3/Skirt"]
    batch = data.batch(np.array([1, 6]))
    assert batch["near"].shape == (2, POINTS, 3)
    np.testing.assert_array_equal(batch["space_distance"][1], data.space_distance[6])
    assert data.occlusion.shape == (len(SPLITS), RESOLUTION, RESOLUTION)
    # The longer skirts cover more.
    long, short = data.occlusion[2].sum(), data.occlusion[0].sum()
    assert long > short > 0
    assert len(data.clusters) == CLUSTERS


def test_only_the_types_asked_for_are_collected(tmp_path, toy_body):
    shard = dict(toy_shard(make_toy_body))
    save_npz(tmp_path / "shard.npz", **shard)
    pixels = texture_pixels(toy_body, RESOLUTION)
    with pytest.raises(InputError, match="no garment of the types Tshirt, Top is for training"):
        collect_fields(
            tmp_path / "out",
            [tmp_path / "shard.npz"],
            ["Tshirt", "Top"],
            toy_bodies(toy_body),
            pixels,
            clusters=3,
        )
    assert not (tmp_path / "out").exists()


def test_shards_must_have_the_same_number_of_points(tmp_path, toy_body):
    shard = dict(toy_shard(make_toy_body))
    save_npz(tmp_path / "a.npz", **shard)
    shorter = shard | {key: shard[key][:, :5] for key in ("near", "near_distance")}
    save_npz(tmp_path / "b.npz", **shorter)
    with pytest.raises(InputError, match="has 5 points 'near' per garment, expected 64"):
        collect_fields(
            tmp_path / "out",
            [tmp_path / "a.npz", tmp_path / "b.npz"],
            ["Skirt"],
            toy_bodies(toy_body),
            texture_pixels(toy_body, RESOLUTION),
            clusters=3,
        )


def test_a_garment_outside_the_box_is_refused(toy_body):
    outfit = toy_outfits()[0]
    tiny = dict.fromkeys(BOXES, ((-0.1,) * 3, (0.1,) * 3))
    with pytest.raises(InputError, match="s0/Skirt: extends from .* expected it within the box"):
        sample_fields(
            [outfit],
            toy_bodies(toy_body),
            texture_pixels(toy_body, 8),
            tiny,
            seed=0,
            near=4,
            space=4,
        )


def slow_clusters(places, count):
    order = [int(np.linalg.norm(places - places.mean(axis=0), axis=1).argmin())]
    while len(order) < count:
        away = [min(np.linalg.norm(place - places[k]) for k in order) for place in places]
        order.append(int(np.argmax(away)))
    return order


def test_clusters_are_farthest_points():
    body = np.random.default_rng(1).normal(size=(60, 3))
    allowed = np.arange(5, 45)
    found = body_clusters(body, allowed, 12)
    assert found.tolist() == allowed[slow_clusters(body[allowed], 12)].tolist()
    moved = body @ np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0] + 4
    np.testing.assert_array_equal(body_clusters(moved, allowed, 12), found)


def test_with_too_few_vertices_clusters_repeat():
    body = np.random.default_rng(1).normal(size=(9, 3))
    found = body_clusters(body, np.array([2, 5, 7]), 7)
    assert sorted(found[:3]) == [2, 5, 7]
    assert found.tolist() == [*found[:3], *found[:3], found[0]]


def test_clusters_lie_on_what_garments_cover(data, toy_body):
    pixels = texture_pixels(toy_body, RESOLUTION)
    assert set(data.clusters) <= set(covered_often(data.occlusion, pixels))
    height = rest_body(toy_body, np.zeros(10))[data.clusters, 2]
    assert height.max() < 0.1


def test_a_damaged_folder_is_named(tmp_path, data):
    with pytest.raises(InputError, match=r"rows\.npz: no such file"):
        FieldData(tmp_path)
    rows = load_npz(data.folder / "rows.npz", {"*": "any ..."})
    save_npz(tmp_path / "rows.npz", **{name: value[:3] for name, value in rows.items()})
    for name in ("near.npy", "clusters.npz"):
        (tmp_path / name).write_bytes((data.folder / name).read_bytes())
    with pytest.raises(InputError, match=r"near\.npy: has shape \(8, 64, 3\) .*expected \(3, "):
        FieldData(tmp_path)


def test_meshes_are_not_changed():
    before = SHELL.vertices.copy()
    sample_field(rng_for(1), SHELL, tube(0.2, -1, 1), BOX, near=10, space=10)
    np.testing.assert_array_equal(SHELL.vertices, before)
