"""The baked bodies, and the steps that make them."""

import make_bodies as bake
import numpy as np
import pytest
from make_bodies import mirror_map

from drapeline.bodies.model import FREE_BODY_VERSION, free_body, shape_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS, JOINT_NAMES
from drapeline.geometry.mesh import edge_counts


def test_a_vertex_and_its_mirror_image_name_each_other():
    vertices = np.array([[0.1, 0.2, 0.3], [0.0, 1.0, 0.0], [-0.1, 0.2, 0.3], [0.0, -1.0, 0.0]])
    assert mirror_map(vertices, axis=0).tolist() == [2, 1, 0, 3]
    swapped = vertices[:, [1, 0, 2]]
    assert mirror_map(swapped, axis=1).tolist() == [2, 1, 0, 3]


def test_the_toy_body_is_its_own_mirror_image(toy_body):
    mirror = mirror_map(toy_body.v_template.astype(np.float64), axis=0)
    np.testing.assert_array_equal(mirror[mirror], np.arange(len(mirror)))
    np.testing.assert_allclose(
        toy_body.v_template[mirror], toy_body.v_template * [-1, 1, 1], atol=1e-6
    )


def test_a_mesh_that_is_not_symmetric_is_refused():
    vertices = np.array([[0.1, 0.0, 0.0], [-0.1003, 0.0, 0.0]])
    with pytest.raises(ValueError, match="the mesh is not symmetric: 3.00e-04 m"):
        mirror_map(vertices, axis=0)


LIMBS = [
    ("shoulder", "elbow", (1, 0, 0)),
    ("elbow", "wrist", (1, 0, 0)),
    ("wrist", "hand", (1, 0, 0)),
    ("hip", "knee", (0, -1, 0)),
    ("knee", "ankle", (0, -1, 0)),
]


@pytest.fixture(params=GENDERS)
def baked(request, baked_bodies):
    return baked_bodies[request.param]


@pytest.fixture(scope="module")
def shapes():
    return np.random.default_rng(0).uniform(-3, 3, (20, 10))


def joint(joints, name):
    return joints[JOINT_NAMES.index(name)]


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.einsum("fi,fi->", a, np.cross(b, c)) / 6


def test_zero_pose_is_a_t_pose_for_every_shape(baked, shapes):
    for shape in [np.zeros(10), *shapes]:
        _, joints = shape_body(baked, shape)
        for side, sign in (("left", 1), ("right", -1)):
            for start, end, direction in LIMBS:
                bone = joint(joints, f"{side}_{end}") - joint(joints, f"{side}_{start}")
                cosine = bone @ (np.array(direction) * [sign, 1, 1]) / np.linalg.norm(bone)
                assert np.degrees(np.arccos(cosine)) < 3


def test_left_and_right_are_mirror_images(baked):
    mirror = mirror_map(baked.v_template, axis=0)
    joints = bake._mirror_joints()
    flip = np.array([-1, 1, 1], dtype=np.float32)
    np.testing.assert_array_equal(baked.v_template[mirror], baked.v_template * flip)
    np.testing.assert_allclose(baked.shapedirs[mirror], baked.shapedirs * flip[:, None], atol=1e-7)
    np.testing.assert_allclose(baked.weights[mirror][:, joints], baked.weights, atol=1e-6)
    np.testing.assert_allclose(baked.J_regressor[joints][:, mirror], baked.J_regressor, atol=1e-6)


def test_surface_is_closed_and_of_one_piece(baked):
    _, counts = edge_counts(baked.faces)
    assert (counts == 2).all()
    assert len(counts) == 3 * len(baked.faces) / 2
    assert len(baked.v_template) - len(counts) + len(baked.faces) == 2
    assert volume(baked.v_template, baked.faces) > 0.04


def test_statures_span_adults(baked_bodies):
    extremes = [
        np.ptp(shape_body(body, np.array([beta] + [0] * 9))[0][:, 1])
        for body in baked_bodies.values()
        for beta in (-3, 3)
    ]
    assert min(extremes) == pytest.approx(1.45, abs=0.05)
    assert max(extremes) == pytest.approx(2.05, abs=0.05)


def test_first_coefficient_alone_changes_stature(baked):
    heights = [np.ptp(shape_body(baked, 2.0 * np.eye(10)[k])[0][:, 1]) for k in range(10)]
    mean = np.ptp(baked.v_template[:, 1])
    assert abs(heights[0] - mean) > 0.1
    np.testing.assert_allclose(heights[1:], mean, atol=0.002)


def test_positive_tightness_makes_smaller_bodies_for_both_genders(baked_bodies):
    for gender, body in enumerate(baked_bodies.values()):
        plain = volume(body.v_template, body.faces)
        first = shape_body(body, np.eye(10)[0] * (-1) ** (gender + 1))[0]
        second = shape_body(body, np.eye(10)[1])[0]
        assert volume(first, body.faces) < 0.95 * plain
        assert volume(second, body.faces) < 0.95 * plain


def test_no_random_body_is_turned_inside_out(baked, shapes):
    for shape in shapes:
        vertices, _ = shape_body(baked, shape)
        kilograms = 1010 * volume(vertices, baked.faces)
        stature = np.ptp(vertices[:, 1])
        assert 13 < kilograms / stature**2 < 38  # body mass index


def test_regressor_is_a_sparse_mixture(baked):
    assert baked.J_regressor.min() >= 0
    np.testing.assert_allclose(baked.J_regressor.sum(axis=1), 1, atol=1e-5)
    assert (baked.J_regressor > 0).sum(axis=1).max() < 100


def test_every_segment_is_there_and_weights_are_local(baked):
    assert set(baked.segmentation) == set(range(24))
    np.testing.assert_allclose(baked.weights.sum(axis=1), 1, atol=1e-5)
    left_hand = baked.weights[:, JOINT_NAMES.index("left_hand")] > 0
    assert (baked.v_template[left_hand, 0] > 0.3).all()


def test_texture_coordinates_fit_the_unit_square(baked):
    assert baked.ft.shape == baked.faces.shape
    assert baked.ft.max() == len(baked.vt) - 1
    assert baked.vt.min() >= 0
    assert baked.vt.max() <= 1


def test_the_bodies_that_come_along_say_what_they_are(baked):
    gender = "female" if "female" in baked.name else "male"
    with np.load(free_body(gender)) as arrays:
        assert arrays["version"] == FREE_BODY_VERSION
        assert str(arrays["licence"]) == bake.LICENCE
        assert str(arrays["name"]) == f"drapeline-anny-{gender}-{FREE_BODY_VERSION}"


def test_same_seed_same_bodies_and_another_seed_others():
    once, again = (bake.bake_bodies(seed=3, samples=12)["male"] for _ in range(2))
    for key in ("v_template", "shapedirs", "J_regressor", "weights"):
        np.testing.assert_array_equal(getattr(once, key), getattr(again, key))
    other = bake.bake_bodies(seed=4, samples=12)["male"]
    assert np.abs(other.v_template - once.v_template).max() > 1e-4


def test_shape_space_has_unit_variance_and_rebuilds_people():
    """Boxes of random height, width, depth and shear: four modes, all linear."""
    rng = np.random.default_rng(0)
    corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(8, 3) * 1.0
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5],
         [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )  # fmt: skip
    sizes = 1 + 0.1 * rng.normal(size=(400, 3))
    people = corners * sizes[:, None]
    bumps = rng.normal(0, 0.01, (400, 8, 3))
    people = people + bumps
    joints = np.repeat(people.mean(axis=1, keepdims=True), 24, axis=1)
    mean, directions, _, _ = bake._shape_space(people, joints, faces, larger=1.0)
    flat = directions.reshape(-1, 10)
    scores = (people - mean).reshape(400, -1) @ np.linalg.pinv(flat).T
    np.testing.assert_allclose(np.cov(scores.T), np.eye(10), atol=1e-6)
    stature = np.ptp(people[:, :, 1], axis=1)
    assert np.corrcoef(scores[:, 0], stature)[0, 1] > 0.97
    left = people - mean - (scores @ flat.T).reshape(people.shape)
    assert left.std() < 0.5 * (people - mean).std()


def test_open_mesh_has_no_mirror_map():
    with pytest.raises(ValueError, match="not symmetric"):
        mirror_map(np.array([[0.0, 0, 0], [1, 0, 0]]), axis=0)


def test_a_damaged_cache_is_named(tmp_path, monkeypatch):
    def load_damaged():
        raise OSError("header too large\nmore")

    monkeypatch.setattr(bake, "get_anny_cache_path", lambda: tmp_path)
    monkeypatch.setattr(bake.anny, "Anny", load_damaged)
    with pytest.raises(
        InputError, match=r"cannot be loaded from its cache .*\(header too large\)"
    ) as e:
        bake.bake_bodies(0, 1)
    assert str(e.value).startswith(f"{tmp_path}: ")
    assert "ANNY_CACHE_DIR" in str(e.value)
