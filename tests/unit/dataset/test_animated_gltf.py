"""Motion in glTF files as other programs write them, beside plain arithmetic."""

import base64
import json

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from drapeline.dataset.animated_gltf import read_gltf
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import to_y_up
from drapeline.errors import DamagedFile, InputError
from toys.tiny_sample import write_tiny_sample

CORNERS = np.float32([[0, 0, 0], [1, 0, 0], [0, 2, 0], [1, 2, 0]])
TYPES = {"<f4": 5126, "<u2": 5123, "<u1": 5121, "|u1": 5121}
KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Writer:
    """Puts a `.gltf` file together, its data inside."""

    def __init__(self):
        self.data, self.views, self.accessors = b"", [], []
        self.document = {"asset": {"version": "2.0"}}

    def add(self, values, **more):
        values = np.atleast_2d(values)
        self.data += b"\0" * (-len(self.data) % 4)
        place = {"buffer": 0, "byteOffset": len(self.data), "byteLength": values.nbytes}
        self.views.append(place)
        self.data += values.tobytes()
        about = {"bufferView": len(self.views) - 1, "count": len(values)}
        kind = {"componentType": TYPES[values.dtype.str], "type": KINDS[values.shape[1]]}
        self.accessors.append(about | kind | more)
        return len(self.accessors) - 1

    def quad(self, **attributes):
        position = self.add(CORNERS)
        faces = self.add(np.uint16([[0], [1], [3], [0], [3], [2]]))
        primitive = {"attributes": {"POSITION": position, **attributes}, "indices": faces}
        self.document["meshes"] = [{"name": "cloth", "primitives": [primitive]}]
        return primitive

    def animate(self, *channels):
        """Channels: node, path, times, values and perhaps how to interpolate."""
        samplers = [
            {
                "input": self.add(np.float32(times)[:, None]),
                "output": self.add(np.float32(values)),
                **({"interpolation": kind[0]} if kind else {}),
            }
            for _, _, times, values, *kind in channels
        ]
        targets = [
            {"sampler": k, "target": {"node": node, "path": path}}
            for k, (node, path, *_) in enumerate(channels)
        ]
        self.document["animations"] = [{"samplers": samplers, "channels": targets}]

    def save(self, path):
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        buffers = [{"byteLength": len(self.data), "uri": uri}]
        whole = {"bufferViews": self.views, "accessors": self.accessors, "buffers": buffers}
        path.write_text(json.dumps(self.document | whole))
        return path


def points(part):
    return part.read(0, part.frame_count)


@pytest.fixture
def writer():
    return Writer()


def test_what_drapeline_writes_comes_back_with_its_seams_joined(tmp_path, toy_body):
    parts = scene_parts(Sample(write_tiny_sample(tmp_path, toy_body, frames=6).folder))
    write_glb(tmp_path / "a.glb", parts)
    for part, read in zip(parts, read_gltf(tmp_path / "a.glb"), strict=True):
        assert (read.name, read.frame_count) == (part.name, 6)
        if part.name == "Body":  # whose round limbs touch in places
            continue
        assert len(read.mesh.vertices) == len(part.mesh.vertices)
        shown = points(read)[:, read.mesh.triangles]
        written = to_y_up(points(part))[:, part.mesh.triangles]
        np.testing.assert_allclose(shown, written, atol=4e-5)


def test_a_node_turns_moves_and_grows_with_its_parent(writer, tmp_path):
    turn = Rotation.from_euler("z", [[0], [90]], degrees=True).as_quat()
    writer.quad()
    writer.document["nodes"] = [
        {"children": [1], "translation": [0, 0, 5]},
        {"mesh": 0, "scale": [2, 2, 2]},
    ]
    writer.animate(
        (0, "rotation", [0, 1], turn),
        (1, "translation", [0, 1], [[0, 0, 0], [0, 0, 1]]),
        (1, "scale", [0, 0.5], [[1, 1, 1], [3, 3, 3]], "STEP"),
    )
    [part] = read_gltf(writer.save(tmp_path / "a.gltf"), 4)
    assert part.name == "cloth"
    sizes = [1, 1, 3, 3, 3]
    expected = [
        Rotation.from_euler("z", 22.5 * k, degrees=True).apply(sizes[k] * CORNERS + [0, 0, k / 4])
        + [0, 0, 5]
        for k in range(5)
    ]
    order = [np.abs(points(part)[0] - corner).sum(axis=1).argmin() for corner in expected[0]]
    np.testing.assert_allclose(points(part)[:, order], expected, atol=1e-5)


def test_a_cubic_spline_is_hermites(writer, tmp_path):
    writer.quad()
    writer.document["nodes"] = [{"mesh": 0}]
    # x = t**3 from 0 to 2: in tangent, value, out tangent.
    keys = [[[0, 0, 0]] * 3, [[12, 0, 0], [8, 0, 0], [12, 0, 0]]]
    writer.animate((0, "translation", [0, 2], np.reshape(keys, (6, 3)), "CUBICSPLINE"))
    [part] = read_gltf(writer.save(tmp_path / "a.gltf"), 2)
    shift = points(part).min(axis=1)[:, 0]
    np.testing.assert_allclose(shift, np.array([0, 0.5, 1, 1.5, 2]) ** 3, atol=1e-5)


def test_a_skin_bends_vertices_with_their_joints(writer, tmp_path):
    joints = np.uint8([[0, 1, 0, 0]] * 4)
    weights = np.float32([[1, 0, 0, 0], [1, 0, 0, 0], [0, 2, 0, 0], [1, 1, 0, 0]])
    writer.quad(JOINTS_0=writer.add(joints), WEIGHTS_0=writer.add(weights))
    inverse = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    inverse[1, 3, 1] = -1  # stored by columns: the second joint is at (0, 1, 0)
    writer.document["skins"] = [
        {"joints": [1, 2], "inverseBindMatrices": writer.add(inverse.reshape(2, 16))}
    ]
    writer.document["nodes"] = [
        {"mesh": 0, "skin": 0, "translation": [7, 7, 7]},  # of no effect, says the specification
        {"children": [2]},
        {"translation": [0, 1, 0]},
    ]
    writer.animate((2, "rotation", [0, 1], [[0, 0, 0, 1], [0, 0, 1, 0]]))
    [part] = read_gltf(writer.save(tmp_path / "a.gltf"), 1)
    order = [np.abs(points(part)[0] - corner).sum(axis=1).argmin() for corner in CORNERS]
    # The joint turns by 180 degrees about (0, 1): half of a vertex's way if it has half the weight.
    bent = [[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0]]
    np.testing.assert_allclose(points(part)[0][order], CORNERS, atol=1e-6)
    np.testing.assert_allclose(points(part)[1][order], bent, atol=1e-6)


def test_targets_may_be_sparse(writer, tmp_path):
    primitive = writer.quad()
    where, what = writer.add(np.uint16([[3]])), writer.add(np.float32([[0, 0, 4]]))
    sparse = {
        "count": 1,
        "indices": {"bufferView": writer.accessors[where]["bufferView"], "componentType": 5123},
        "values": {"bufferView": writer.accessors[what]["bufferView"]},
    }
    writer.accessors.append({"componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse})
    primitive["targets"] = [{"POSITION": len(writer.accessors) - 1}]
    writer.document["nodes"] = [{"mesh": 0}]
    writer.animate((0, "weights", [0, 1], [[0], [0.5]]))
    [part] = read_gltf(writer.save(tmp_path / "a.gltf"), 1)
    assert sorted(points(part)[1][:, 2]) == [0, 0, 0, 2]


def test_a_still_scene_of_another_program_is_one_frame(tmp_path):
    ball = trimesh.creation.icosphere()
    trimesh.Scene([ball]).export(tmp_path / "ball.glb")
    [part] = read_gltf(tmp_path / "ball.glb")
    assert part.frame_count == 1
    assert trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False).is_watertight


def test_buffers_lie_beside_the_file_and_nowhere_else(writer, tmp_path):
    writer.quad()
    writer.document["nodes"] = [{"mesh": 0}]
    path = writer.save(tmp_path / "a.gltf")
    document = json.loads(path.read_text())
    (tmp_path / "my data.bin").write_bytes(writer.data)
    document["buffers"][0]["uri"] = "my%20data.bin"
    path.write_text(json.dumps(document))
    assert read_gltf(path)[0].frame_count == 1
    for uri in ("../secret.bin", "/etc/passwd", "http://there/a.bin", "file:///etc/passwd"):
        document["buffers"][0]["uri"] = uri
        path.write_text(json.dumps(document))
        with pytest.raises(InputError, match="expected a file beside it"):
            read_gltf(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(extensionsRequired=["KHR_draco_mesh_compression"]), "needs 'KHR_draco"),
        (lambda d: d.update(nodes=[]), "has no mesh"),
        (lambda d: d["meshes"][0]["primitives"][0].update(mode=1), "is not of triangles"),
        (lambda d: d["accessors"][0].update(count=10**12), "elements, expected 1 to"),
        (lambda d: d["accessors"][0].update(count=5), "is cut off"),
        (lambda d: d.pop("asset"), "is no glTF file"),
        (lambda d: d.pop("accessors"), "not readable as glTF"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(writer, tmp_path, change, words):
    writer.quad()
    writer.document["nodes"] = [{"mesh": 0}]
    path = writer.save(tmp_path / "a.gltf")
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=words):
        read_gltf(path)


def test_a_file_that_is_cut_off_is_refused(tmp_path, toy_body):
    parts = scene_parts(Sample(write_tiny_sample(tmp_path, toy_body, frames=2).folder))
    write_glb(tmp_path / "a.glb", parts)
    data = (tmp_path / "a.glb").read_bytes()
    for size in (0, 3, 11, 40, len(data) // 2, len(data) - 1):
        (tmp_path / "a.glb").write_bytes(data[:size])
        with pytest.raises(DamagedFile, match=r"a\.glb"):
            read_gltf(tmp_path / "a.glb")
