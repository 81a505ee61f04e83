"""The body's nearest points in lanes against those in turn, which a GPU searches."""

import numpy as np
import trimesh
import warp as wp

from drapeline.geometry.lanes import INDICES, make_patches, repeat_first
from drapeline.geometry.warp_mesh import start_warp, warp_mesh
from drapeline.seeding import rng_for
from drapeline.xpbd.body_contact import search_in_turn
from drapeline.xpbd.body_lanes import search_in_lanes


def test_a_limb_comes_first_and_then_the_whole_body():
    start_warp()
    rng = rng_for(1, "points")
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    limbs = [ball.vertices + [x, 0, 0] for x in (0.0, 0.15)]
    whole = np.concatenate(limbs), np.concatenate([ball.faces, ball.faces + len(ball.vertices)])
    meshes = [*(warp_mesh(limb, ball.faces) for limb in limbs), warp_mesh(*whole)]
    homes = np.repeat([0, 1, 2], [301, 200, 99])
    points = rng.uniform(-0.15, 0.15, (600, 3)) + homes[:, None] * [0.075, 0, 0]
    reaches = rng.choice([0, 0.01, 0.03], 600)
    ids = np.array([mesh.id for mesh in meshes], dtype=np.uint64)
    patches = repeat_first(make_patches(points, homes))
    fixed = [
        wp.array(ids, dtype=wp.uint64, device="cpu"),
        wp.array(homes.astype(np.int32), dtype=int, device="cpu"),
    ]
    rows = wp.array(patches, dtype=INDICES, device="cpu")
    asked = [
        wp.array(points.astype(np.float32), dtype=wp.vec3, device="cpu"),
        0.05,
        wp.array(reaches.astype(np.float32), dtype=float, device="cpu"),
    ]
    ends = []
    for kernel, count, inputs in (
        (search_in_turn, 600, [*fixed, *asked]),
        (
            search_in_lanes,
            len(patches),
            [*fixed, rows, *asked, wp.zeros(600, dtype=float, device="cpu")],
        ),
    ):
        parts, found = (wp.full(600, -1, dtype=int, device="cpu") for _ in range(2))
        weights = wp.zeros(600, dtype=wp.vec3, device="cpu")
        wp.launch(kernel, count, inputs, [parts, found, weights], device="cpu")
        part, face, weight = parts.numpy(), found.numpy(), weights.numpy()
        hit = face >= 0
        near = np.zeros((600, 3))
        for number, mesh in enumerate(meshes):
            on = hit & (part == number)
            corners = mesh.indices.numpy().reshape(-1, 3)[face[on]]
            near[on] = np.einsum("pki,pk->pi", mesh.points.numpy()[corners], weight[on])
        ends.append((hit, np.where(hit, part, -1), near))
    (hit, part, near), (hit_two, part_two, near_two) = ends
    assert (part < 0).any()
    assert set(part[homes == 0]) == {-1, 0, 2}
    assert not hit[reaches == 0].any()
    # One whose distance is its reach, to rounding, may be found on either.
    clear = np.abs(np.linalg.norm(points - near, axis=1) - reaches) > 1e-5
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(hit[clear], hit_two[clear])
    np.testing.assert_array_equal(part[clear], part_two[clear])
    np.testing.assert_allclose(near_two[clear], near[clear], atol=1e-5)
