import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from drapeline.dataset.animated_gltf import read_gltf
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import to_y_up
from drapeline.frames import GENDERS, JOINT_NAMES
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
    assert binary_size % 4 == 0
    [buffer] = document["buffers"]
    assert 0 <= binary_size - buffer["byteLength"] < 4
    return document, data[28 + size :]


def accessor_values(document, binary, index):
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    assert view["byteOffset"] % 4 == 0
    dtypes = {5120: "<i1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
    dtype = np.dtype(dtypes[accessor["componentType"]])
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
    stride = view.get("byteStride", width * dtype.itemsize)
    assert view["byteLength"] == accessor["count"] * stride
    assert stride % 4 == 0 or view.get("target") != 34962, "vertices begin at multiples of 4 bytes"
    values = np.ndarray(
        (accessor["count"], width), dtype, binary, view["byteOffset"], (stride, dtype.itemsize)
    )
    if "min" in accessor:
        np.testing.assert_array_equal(values.min(axis=0), np.float32(accessor["min"]))
        np.testing.assert_array_equal(values.max(axis=0), np.float32(accessor["max"]))
    if accessor.get("normalized"):
        return values / np.iinfo(dtype).max
    return values


def values_of(document, binary, path):
    """What is animated under that name: (nodes' names, (F, n) values per node)."""
    [animation] = document["animations"]
    found = {}
    for channel in animation["channels"]:
        if channel["target"]["path"] == path:
            sampler = animation["samplers"][channel["sampler"]]
            times = accessor_values(document, binary, sampler["input"])
            np.testing.assert_allclose(times[:, 0], np.arange(FRAMES) / 30, atol=1e-7)
            assert sampler["interpolation"] == "LINEAR"
            values = accessor_values(document, binary, sampler["output"])
            name = document["nodes"][channel["target"]["node"]]["name"]
            found[name] = values.reshape(FRAMES, -1)
    return found


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
    *nodes, root = document["nodes"]
    assert [node["name"] for node in nodes] == ["Body", "Tshirt", "Skirt"]
    assert root == {"name": "sample", "children": [0, 1, 2]}
    assert document["scenes"] == [{"nodes": [3]}]
    for node, part in zip(nodes, parts, strict=True):
        primitive = document["meshes"][node["mesh"]]["primitives"][0]
        material = document["materials"][primitive["material"]]
        colour = material["pbrMetallicRoughness"]["baseColorFactor"]
        np.testing.assert_allclose(colour, [*part.linear_colour, 1])


def test_morph_targets_hold_the_points_and_normals_of_every_frame(glb, parts):
    document, binary = glb
    for index in range(len(document["accessors"])):
        accessor_values(document, binary, index)
    [path] = values_of(document, binary, "translation").values()
    weights = values_of(document, binary, "weights")
    for part, mesh in zip(parts, document["meshes"], strict=True):
        primitive = mesh["primitives"][0]
        assert len(primitive["targets"]) == FRAMES - 1
        faces = accessor_values(document, binary, primitive["indices"]).reshape(-1, 3)
        base = {
            name: accessor_values(document, binary, index)
            for name, index in primitive["attributes"].items()
        }
        for frame, points in enumerate(part.frames()):
            moved = {"POSITION": base["POSITION"] + path[frame], "NORMAL": base["NORMAL"]}
            for target, weight in enumerate(weights[part.name][frame]):
                for name, index in primitive["targets"][target].items():
                    delta = weight * accessor_values(document, binary, index)
                    moved[name] = moved[name] + delta
            normals = vertex_normals(points, part.mesh.triangles)
            corners = part.mesh.triangles
            expected = to_y_up(points)[corners]
            np.testing.assert_allclose(moved["POSITION"][faces], expected, atol=4e-5)
            np.testing.assert_allclose(moved["NORMAL"][faces], to_y_up(normals)[corners], atol=0.01)


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
    weights = values_of(document, binary, "weights")
    assert set(weights) == {"Body", "Tshirt", "Skirt"}
    for values in weights.values():
        np.testing.assert_array_equal(values > 0, np.eye(FRAMES, dtype=bool)[:, 1:])


def test_targets_take_half_the_bytes_of_single_precision(glb):
    document, _ = glb
    assert document["extensionsUsed"] == ["KHR_mesh_quantization"]
    assert document["extensionsRequired"] == ["KHR_mesh_quantization"]
    for mesh in document["meshes"]:
        [primitive] = mesh["primitives"]
        count = document["accessors"][primitive["attributes"]["POSITION"]]["count"]
        for target in primitive["targets"]:
            views = [document["accessors"][index]["bufferView"] for index in target.values()]
            sizes = [document["bufferViews"][view]["byteLength"] for view in views]
            assert sum(sizes) == 12 * count


def test_a_part_far_from_the_origin_and_moving_fast_is_as_exact(tmp_path, parts):
    skirt = parts[-1]
    away = replace(
        skirt,
        read=lambda start, stop: (
            skirt.read(start, stop)
            + np.arange(start, stop)[:, None, None] * np.array([1.0, 2.0, -0.5])
        ),
    )
    write_glb(tmp_path / "a.glb", [away])
    document, binary = read_glb(tmp_path / "a.glb")
    [path] = values_of(document, binary, "translation").values()
    [weights] = values_of(document, binary, "weights").values()
    primitive = document["meshes"][0]["primitives"][0]
    base = accessor_values(document, binary, primitive["attributes"]["POSITION"])
    faces = accessor_values(document, binary, primitive["indices"]).reshape(-1, 3)
    last = accessor_values(document, binary, primitive["targets"][-1]["POSITION"])
    moved = base + path[-1] + weights[-1, -1] * last
    expected = to_y_up(away.read(FRAMES - 1, FRAMES)[0])[skirt.mesh.triangles]
    np.testing.assert_allclose(moved[faces], expected, atol=4e-5)


def test_a_part_that_does_not_move_is_written(tmp_path, parts):
    still = replace(
        parts[-1], read=lambda start, stop: np.repeat(parts[-1].read(0, 1), stop - start, 0)
    )
    write_glb(tmp_path / "a.glb", [still])
    document, binary = read_glb(tmp_path / "a.glb")
    for target in document["meshes"][0]["primitives"][0]["targets"]:
        for index in target.values():
            assert not accessor_values(document, binary, index).any()


def test_trimesh_reads_the_first_frame_with_its_colours(tmp_path, parts):
    write_glb(tmp_path / "a.glb", parts)
    scene = trimesh.load_scene(tmp_path / "a.glb")
    for part in parts:
        mesh = scene.geometry[part.name]
        corners = to_y_up(part.read(0, 1)[0])[part.mesh.triangles]
        np.testing.assert_allclose(mesh.triangles, corners, atol=1e-6)
        colour = mesh.visual.material.baseColorFactor[:3] / 255
        np.testing.assert_allclose(colour, part.linear_colour, atol=3e-3)


def test_a_single_frame_is_a_still(tmp_path, parts):
    write_glb(tmp_path / "a.glb", [replace(part, frame_count=1) for part in parts])
    document, _ = read_glb(tmp_path / "a.glb")
    assert "animations" not in document
    assert "extensionsRequired" not in document
    assert "targets" not in document["meshes"][0]["primitives"][0]


@pytest.fixture
def rigged(tmp_path, tiny, toy_body):
    """The same with the body model, and the parts."""
    with Sample(tiny.folder, bodies=dict.fromkeys(GENDERS, toy_body)) as sample:
        write_glb(tmp_path / "rigged.glb", scene_parts(sample))
        yield tmp_path / "rigged.glb"


def test_bones_and_sparse_targets_move_a_body_whose_model_is_known(rigged, parts):
    found = {part.name: part for part in read_gltf(rigged)}
    for part in parts:
        off = 1.1e-3 if part.name == "Body" else 5e-5
        for frame in range(FRAMES):
            [points], [expected] = (
                found[part.name].read(frame, frame + 1),
                part.read(frame, frame + 1),
            )
            expected = to_y_up(expected)
            assert KDTree(points).query(expected)[0].max() < off
            assert KDTree(expected).query(points)[0].max() < off


def test_what_bones_say_is_kept_small(rigged, glb):
    document, binary = read_glb(rigged)
    [skin] = document["skins"]
    assert [document["nodes"][joint]["name"] for joint in skin["joints"]] == list(JOINT_NAMES)
    body = document["meshes"][0]["primitives"][0]
    weights = accessor_values(document, binary, body["attributes"]["WEIGHTS_0"])
    assert weights.shape[1] == 4
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    for target in body["targets"]:
        assert set(target) == {"POSITION"}
        accessor = document["accessors"][target["POSITION"]]
        assert 1 <= accessor["sparse"]["count"] < accessor["count"] / 4
    _, binary_of_plain = glb
    assert len(binary) < 0.7 * len(binary_of_plain)


def test_turns_of_bones_take_the_short_way(rigged):
    document, binary = read_glb(rigged)
    for values in values_of(document, binary, "rotation").values():
        np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1, atol=1e-6)
        assert ((values[1:] * values[:-1]).sum(axis=1) > 0).all()
