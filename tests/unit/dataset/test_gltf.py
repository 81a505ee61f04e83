import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from drapeline.dataset.gltf import write_glb
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import to_y_up
from drapeline.geometry.mesh import vertex_normals

FRAMES = 6


def read_glb(path):
    """The JSON document and the binary data of a file whose sizes add up."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    document = json.loads(data[20 : 20 + size])
    binary_size, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert (kind, 28 + size + binary_size) == (b"BIN\0", length)
    assert document["buffers"] == [{"byteLength": binary_size}]
    return document, data[28 + size :]


def accessor_values(document, binary, index):
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    assert view["byteOffset"] % 4 == 0
    dtype = {5126: "<f4", 5125: "<u4"}[accessor["componentType"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor["type"]]
    values = np.frombuffer(binary, dtype, accessor["count"] * width, view["byteOffset"])
    values = values.reshape(-1, width)
    assert view["byteLength"] == values.nbytes
    if "min" in accessor:
        np.testing.assert_array_equal(values.min(axis=0), np.float32(accessor["min"]))
        np.testing.assert_array_equal(values.max(axis=0), np.float32(accessor["max"]))
    return values


@pytest.fixture
def parts(tiny):
    return scene_parts(Sample(tiny.folder))


@pytest.fixture
def glb(tmp_path, parts):
    write_glb(tmp_path / "a.glb", parts)
    return read_glb(tmp_path / "a.glb")


def test_every_part_is_a_node_with_its_colour(glb, parts):
    document, _ = glb
    assert document["asset"]["version"] == "2.0"
    assert [node["name"] for node in document["nodes"]] == ["Body", "Tshirt", "Skirt"]
    for node, part in zip(document["nodes"], parts, strict=True):
        primitive = document["meshes"][node["mesh"]]["primitives"][0]
        material = document["materials"][primitive["material"]]
        colour = material["pbrMetallicRoughness"]["baseColorFactor"]
        np.testing.assert_allclose(colour, [*part.colour, 1])


def test_morph_targets_hold_the_points_and_normals_of_every_frame(glb, parts):
    document, binary = glb
    for index in range(len(document["accessors"])):
        accessor_values(document, binary, index)
    for part, mesh in zip(parts, document["meshes"], strict=True):
        primitive = mesh["primitives"][0]
        assert len(primitive["targets"]) == FRAMES - 1
        faces = accessor_values(document, binary, primitive["indices"]).reshape(-1, 3)
        base = {
            name: accessor_values(document, binary, index)
            for name, index in primitive["attributes"].items()
        }
        zero = np.zeros_like(base["POSITION"])
        for frame, points in enumerate(part.frames()):
            moved = {
                name: base[name]
                + (
                    accessor_values(document, binary, primitive["targets"][frame - 1][name])
                    if frame
                    else zero
                )
                for name in ("POSITION", "NORMAL")
            }
            normals = vertex_normals(points, part.mesh.triangles)
            corners = part.mesh.triangles
            expected = to_y_up(points)[corners]
            np.testing.assert_allclose(moved["POSITION"][faces], expected, atol=1e-6)
            np.testing.assert_allclose(moved["NORMAL"][faces], to_y_up(normals)[corners], atol=1e-5)


def test_only_vertices_on_seams_are_split(glb, tiny):
    document, binary = glb
    [mesh] = [mesh for mesh in document["meshes"] if mesh["name"] == "Skirt"]
    attributes = mesh["primitives"][0]["attributes"]
    rest = tiny.meshes["Skirt"]
    # The seam of the tube runs along a column of its vertices.
    assert len(accessor_values(document, binary, attributes["POSITION"])) == len(rest.uv)
    uv = accessor_values(document, binary, attributes["TEXCOORD_0"])
    flipped = rest.uv * [1, -1] + [0, 1]
    np.testing.assert_allclose(np.unique(uv, axis=0), np.unique(np.float32(flipped), axis=0))


def test_each_frame_is_fully_on_at_its_own_time(glb):
    document, binary = glb
    for sampler in document["animations"][0]["samplers"]:
        times = accessor_values(document, binary, sampler["input"])
        np.testing.assert_allclose(times[:, 0], np.arange(FRAMES) / 30, atol=1e-7)
        weights = accessor_values(document, binary, sampler["output"])
        weights = weights.reshape(FRAMES, FRAMES - 1)
        np.testing.assert_array_equal(weights, np.eye(FRAMES)[:, 1:])
        assert sampler["interpolation"] == "LINEAR"


def test_a_single_frame_is_a_still(tmp_path, parts):
    write_glb(tmp_path / "a.glb", [replace(part, frame_count=1) for part in parts])
    document, _ = read_glb(tmp_path / "a.glb")
    assert "animations" not in document
    assert "targets" not in document["meshes"][0]["primitives"][0]
