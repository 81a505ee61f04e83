"""The super-resolved body: exact count, clean boundaries, and the model of the whole body on it."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from drapeline.bodies.model import load_body, posed_vertices, save_body, shape_body
from drapeline.errors import InputError
from drapeline.frames import JOINT_NAMES
from drapeline.geometry.mesh import boundary_loops, edge_counts
from drapeline.registration.to_body.super_body import (
    VERTICES,
    build_super_body,
    interpolation,
    mirror_of,
)


def rough_body(body, seed=0):
    """As a licensed SMPL file: not quite symmetric, with pose blend shapes, no texture."""
    rng = np.random.default_rng(seed)
    return replace(
        body,
        v_template=(body.v_template + rng.normal(0, 5e-4, body.v_template.shape)).astype("f4"),
        posedirs=rng.normal(0, 1e-3, body.posedirs.shape).astype("f4"),
        vt=None,
        ft=None,
        name="rough",
    )


@pytest.fixture(scope="module", params=["symmetric", "rough"])
def pair(request, toy_body):
    """A body and its refined form."""
    body = toy_body if request.param == "symmetric" else rough_body(toy_body)
    return body, build_super_body({"female": body, "male": body}, 3000)


def assert_clean(refined, count):
    faces = refined.faces
    pairs, sides = edge_counts(faces)
    assert sides.max() == 2
    assert [len(body.v_template) for body in refined.bodies.values()] == [count] * 2
    np.testing.assert_array_equal(np.unique(faces), np.arange(count))
    assert len(boundary_loops(faces)) == 5
    assert count - len(pairs) + len(faces) == 2 - 5  # a sphere with five holes
    graph = csr_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    assert connected_components(graph, directed=False)[0] == 1


def edge_lengths(body):
    pairs, _ = edge_counts(body.faces)
    return np.linalg.norm(body.v_template[pairs[:, 0]] - body.v_template[pairs[:, 1]], axis=1)


def test_is_one_clean_piece_with_as_many_vertices_as_asked_for(pair):
    assert_clean(pair[1], 3000)


@pytest.mark.parametrize("count", [2000, 2001])
def test_both_sides_are_mirror_images_for_even_and_odd_counts(toy_body, count):
    refined = build_super_body({"female": toy_body, "male": toy_body}, count)
    assert_clean(refined, count)
    template = refined.bodies["male"].v_template
    np.testing.assert_allclose(template[refined.mirror], template * [-1, 1, 1], atol=1e-6)


def test_head_hands_and_feet_are_gone_and_the_rest_is_whole(pair):
    body, refined = pair
    joints = shape_body(body, np.zeros(10))[1]
    place = dict(zip(JOINT_NAMES, joints, strict=True))
    low, high = (
        refined.bodies["female"].v_template.min(0),
        refined.bodies["female"].v_template.max(0),
    )
    edge = 0.02
    assert place["left_wrist"][0] - edge < high[0] < place["left_hand"][0]
    assert place["right_wrist"][0] + edge > low[0] > place["right_hand"][0]
    assert place["neck"][1] < high[1] < place["head"][1]
    assert place["left_ankle"][1] + edge > low[1] > place["left_foot"][1]


def test_joints_are_those_of_the_whole_body_for_every_shape(pair):
    body, refined = pair
    rng = np.random.default_rng(1)
    for shape in [np.zeros(10), *rng.uniform(-3, 3, (20, 10))]:
        joints = shape_body(refined.bodies["female"], shape)[1]
        np.testing.assert_allclose(joints, shape_body(body, shape)[1], atol=1e-5)


def test_vertices_of_the_file_are_posed_as_in_the_whole_body(pair):
    body, refined = pair
    rng = np.random.default_rng(2)
    shape, poses = rng.uniform(-3, 3, 10), rng.uniform(-0.8, 0.8, (3, 72))
    kept = refined.shares.max(axis=1) == 1
    source = refined.corners[kept, refined.shares[kept].argmax(axis=1)]
    assert kept.sum() > 1000
    whole, joints = posed_vertices(body, shape, poses)
    ours, our_joints = posed_vertices(refined.bodies["female"], shape, poses)
    np.testing.assert_allclose(ours[:, kept], whole[:, source], atol=1e-5)
    np.testing.assert_allclose(our_joints, joints, atol=1e-5)


def test_new_vertices_lie_in_triangles_of_the_file_with_its_parameters(pair):
    body, refined = pair
    ours = refined.bodies["female"]
    np.testing.assert_allclose(refined.shares.sum(axis=1), 1)
    assert refined.shares.min() >= 0
    simplices = {
        frozenset(part)
        for a, b, c in body.faces.tolist()
        for part in ((a,), (b,), (c,), (a, b), (b, c), (c, a), (a, b, c))
    }
    for corners, shares in zip(refined.corners, refined.shares, strict=True):
        assert frozenset(corners[shares > 0].tolist()) in simplices
    matrix = interpolation(refined.corners, refined.shares, len(body.v_template)).toarray()
    np.testing.assert_allclose(ours.v_template, matrix @ body.v_template, atol=1e-6)
    np.testing.assert_allclose(ours.shapedirs[..., 3], matrix @ body.shapedirs[..., 3], atol=1e-6)
    np.testing.assert_allclose(ours.posedirs[..., 7], matrix @ body.posedirs[..., 7], atol=1e-6)
    np.testing.assert_allclose(ours.weights, matrix @ body.weights, atol=1e-6)
    np.testing.assert_allclose(ours.weights.sum(axis=1), 1, atol=1e-6)


def test_edges_come_out_even(toy_body):
    bodies = {"female": toy_body, "male": toy_body}
    before = edge_lengths(build_super_body(bodies, 0).bodies["male"])
    after = edge_lengths(build_super_body(bodies, 6000).bodies["male"])
    assert after.max() < 2 * np.median(after)
    assert after.max() < 0.6 * before.max()


def test_texture_is_carried_over_and_seams_stay_seams(toy_body):
    refined = build_super_body({"female": toy_body, "male": toy_body}, 3000).bodies["male"]
    # The toy's texture is a plane projection, the back's shifted by a half.
    low = toy_body.v_template[:, :2].min(axis=0)
    size = np.ptp(toy_body.v_template[:, :2], axis=0).max()
    plane = (refined.v_template[:, :2] - low) / size * [0.49, 0.98] + [0.005, 0.01]
    found = refined.vt[refined.ft]  # (F, 3, 2)
    is_back = (found[..., 0].mean(axis=1) > 0.5)[:, None, None]
    np.testing.assert_allclose(found, plane[refined.faces] + is_back * [0.5, 0], atol=1e-5)
    assert len(refined.v_template) < len(refined.vt) < 1.3 * len(refined.v_template)


def test_without_refinement_the_cut_body_comes_back(toy_body):
    cut = build_super_body({"female": toy_body, "male": toy_body}, 0)
    assert_clean(cut, len(cut.corners))
    assert len(cut.corners) < len(toy_body.v_template)


def test_the_same_bodies_give_the_same_arrays(pair):
    body, refined = pair
    again = build_super_body({"female": body, "male": body}, 3000)
    for field in fields(body):
        np.testing.assert_array_equal(
            getattr(again.bodies["male"], field.name), getattr(refined.bodies["male"], field.name)
        )


def test_a_saved_body_loads_as_it_was(pair, tmp_path):
    ours = pair[1].bodies["female"]
    save_body(tmp_path / "female.npz", ours)
    loaded = load_body(tmp_path / "female.npz")
    for field in fields(ours):
        expected = getattr(ours, field.name)
        if expected is None:
            assert getattr(loaded, field.name) is None
        else:
            np.testing.assert_array_equal(getattr(loaded, field.name), expected)


def test_too_few_vertices_are_refused_with_both_numbers(toy_body):
    with pytest.raises(InputError, match=r"toy-1: has 1\d{3} vertices .* at most the 500 asked"):
        build_super_body({"female": toy_body, "male": toy_body}, 500)


def test_genders_of_different_meshes_are_refused(toy_body):
    other = replace(toy_body, faces=toy_body.faces[::-1], name="other")
    with pytest.raises(InputError, match="other: its faces differ from those of toy-1"):
        build_super_body({"female": toy_body, "male": other}, 3000)


def test_faces_across_the_plane_are_not_symmetric():
    points = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert mirror_of(points, np.array([[0, 1, 2]])) is None
    points = np.array([[-1.0, 0, 0], [0, 0, 0], [0, 1, 0], [1, 0, 0]])
    mirror = mirror_of(points, np.array([[0, 1, 2], [1, 3, 2]]))
    np.testing.assert_array_equal(mirror, [3, 1, 2, 0])
    assert mirror_of(points, np.array([[0, 1, 2], [1, 2, 3]])) is None


def test_the_real_bodies_have_the_papers_number_of_vertices(baked_bodies):
    refined = build_super_body(baked_bodies)
    assert_clean(refined, VERTICES)
    assert refined.mirror is not None
    rng = np.random.default_rng(3)
    for gender, body in baked_bodies.items():
        shape = rng.uniform(-3, 3, 10)
        joints = shape_body(refined.bodies[gender], shape)[1]
        np.testing.assert_allclose(joints, shape_body(body, shape)[1], atol=1e-5)
        assert edge_lengths(refined.bodies[gender]).max() < 0.03
