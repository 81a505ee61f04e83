"""A garment on its wearer in motion."""

import json
import struct

import numpy as np
import pytest

from drapeline.bodies.animation import make_body_sequence
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.sequence import body_sequence_vertices
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.gallery.motion import save_clip, worn_clip

SHAPE = np.zeros(10)


@pytest.fixture(scope="module")
def record(toy_body):
    poses = np.tile(REST_POSE, (4, 1))
    poses[:, 3 * 18 + 2] = np.linspace(0, 0.8, 4)
    path = np.zeros((4, 3))
    path[:, 0] = np.arange(4)
    return make_body_sequence(toy_body, SHAPE, poses, path, gender="female")


def clip(toy_body, record, frames, skinning="nearest"):
    skin = Mesh(rest_body(toy_body, SHAPE).astype(np.float32), toy_body.faces)
    return worn_clip(
        skin, "Dress", toy_body, record, np.array(frames), skinning=skinning, push_out=False
    )


def test_the_skin_as_a_garment_is_the_body_in_the_world(toy_body, record):
    frames = [3, 1]
    worn = clip(toy_body, record, frames)
    bodies = body_sequence_vertices(toy_body, record, world=True)
    for frame, one in zip(frames, worn, strict=True):
        assert one.wearer.vertices == pytest.approx(bodies[frame], abs=1e-5)
        fixed = np.unique(record.fix_vertex[record.fix_frame == frame])
        others = np.setdiff1d(np.arange(len(bodies[0])), fixed)
        assert one.garment.vertices[others] == pytest.approx(bodies[frame, others], abs=1e-5)
        assert one.garment_type == "Dress"


def test_a_clip_is_an_animated_scene(tmp_path, toy_body, record):
    save_clip(tmp_path / "clip.glb", clip(toy_body, record, range(4)))
    data = (tmp_path / "clip.glb").read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    document = json.loads(data[20 : 20 + length])
    assert [mesh["name"] for mesh in document["meshes"]] == ["Body", "Dress"]
    assert all(len(mesh["weights"]) == 3 for mesh in document["meshes"])
