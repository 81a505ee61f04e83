"""Two balls for a body, whose thighs collide."""

from types import SimpleNamespace

import numpy as np
from trimesh.creation import icosphere

from drapeline.bodies.self_collision import body_parts
from drapeline.frames import JOINT_NAMES


def two_balls(radius_m, apart_m):
    """Vertices and parts of a left thigh at the origin and a right one along x."""
    ball = icosphere(subdivisions=4, radius=radius_m)
    count = len(ball.vertices)
    hips = [JOINT_NAMES.index("left_hip"), JOINT_NAMES.index("right_hip")]
    body = SimpleNamespace(
        v_template=np.concatenate([ball.vertices, ball.vertices + np.array([apart_m, 0, 0])]),
        faces=np.concatenate([ball.faces, ball.faces + count]).astype(np.int32),
        segmentation=np.repeat(hips, count),
    )
    return body.v_template, body_parts(body)
