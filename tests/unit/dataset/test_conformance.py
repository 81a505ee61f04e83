"""Our samples through the logic of the two families of CLOTH3D readers, and against our reader.

Written from a description of what those readers do. The starter kit squeezes `info.mat`, insists
on half precision for `.pc16`, seeks single frames and adds `trans` before turning by `zrot`. The
DeePSD family does the same with its own code and takes the rest mesh turned back by `zrot`; it
lists garments by their OBJ files instead of asking `info.mat`.
"""

import os
import struct

import numpy as np
import pytest
import scipy.io

from drapeline.bodies.model import posed_vertices
from drapeline.dataset.collect import collect_dataset
from drapeline.dataset.info_mat import SampleInfo
from drapeline.dataset.reader import Sample
from drapeline.dataset.writer import GarmentAnimation, write_reconstruction
from drapeline.frames import REST_POSE
from toys.tiny_sample import GARMENTS, tube, write_tiny_sample


def plain_dict(struct_value):
    """Structs to dicts, all the way down, as the kit's `loadInfo` does."""
    out = {}
    for name in struct_value._fieldnames:
        value = getattr(struct_value, name)
        out[name] = plain_dict(value) if hasattr(value, "_fieldnames") else value
    return out


def starter_kit_info(folder):
    raw = scipy.io.loadmat(str(folder / "info.mat"), struct_as_record=False, squeeze_me=True)
    raw = {key: value for key, value in raw.items() if not key.startswith("__")}
    return {
        key: plain_dict(value) if hasattr(value, "_fieldnames") else value
        for key, value in raw.items()
    }


def starter_kit_frame(path, frame, half=True):
    assert path.suffix == (".pc16" if half else ".pc2"), "half precision if and only if .pc16"
    with open(path, "rb") as stream:
        stream.seek(16)
        vertices = struct.unpack("<i", stream.read(4))[0]
        stream.seek(28)
        frames = struct.unpack("<i", stream.read(4))[0]
        assert frame <= frames
        size = 2 if half else 4
        stream.seek(32 + 3 * size * vertices * frame)
        data = np.frombuffer(stream.read(3 * size * vertices), "<f2" if half else "<f4")
    return data.reshape(vertices, 3).astype(np.float32)


def starter_kit_obj(path):
    vertices, uv, faces, uv_faces = [], [], [], []
    for line in path.read_text().split("\n"):
        fields = line.split(" ")  # exactly one space: a double one would give an empty field
        if fields[0] == "v":
            vertices.append([float(x) for x in fields[1:]])
        elif fields[0] == "vt":
            uv.append([float(x) for x in fields[1:]])
        elif fields[0] == "f":
            corners = [field.split("/") for field in fields[1:]]
            faces.append([int(corner[0]) - 1 for corner in corners])
            uv_faces.append([int(corner[1]) - 1 for corner in corners])
        else:
            assert line == "", f"a line that is neither v, vt nor f: {line}"
    return np.array(vertices), np.array(uv), faces, uv_faces


def starter_kit_world(folder, garment, frame):
    info = starter_kit_info(folder)
    points = starter_kit_frame(folder / f"{garment}.pc16", frame)
    trans = info["trans"] if info["trans"].ndim == 1 else info["trans"][:, frame]
    return z_turn(points + trans, info["zrot"])


def z_turn(points, angle):
    sine, cosine = np.sin(angle), np.cos(angle)
    return points @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])


def deepsd_rest(folder, garment):
    """Rest mesh in the frame of the rest body: turned back by zrot, quads cut in two."""
    info = scipy.io.loadmat(str(folder / "info.mat"), struct_as_record=False, squeeze_me=True)
    vertices, _, faces, _ = starter_kit_obj(folder / f"{garment}.obj")
    triangles = []
    for face in faces:
        assert len(face) == 4
        triangles += [[face[0], face[1], face[2]], [face[0], face[2], face[3]]]
    return z_turn(vertices, -float(info["zrot"])), np.array(triangles)


def deepsd_frames(path):
    with open(path, "rb") as stream:
        header = stream.read(32)
        _, version, vertices, start, rate, frames = struct.unpack("<12siiffi", header)
        assert (version, start, rate) == (1, 0.0, 1.0)
        return np.frombuffer(stream.read(), np.float16).reshape(frames, vertices, 3)


@pytest.fixture(params=[4, 1], ids=["frames", "one_frame"])
def sample(request, tmp_path, toy_body):
    return write_tiny_sample(tmp_path, toy_body, frames=request.param)


def test_starter_kit_parses_the_info(sample):
    info = starter_kit_info(sample.folder)
    assert list(info["outfit"]) == list(GARMENTS)
    for garment in GARMENTS:
        assert info["outfit"][garment]["fabric"] in ("cotton", "silk", "denim", "leather")
        assert info["outfit"][garment]["texture"]["type"] == "color"
        assert info["outfit"][garment]["texture"]["data"].shape == (3,)
    assert info["lights"]["type"] in ("point", "sun")
    assert info["gender"] in (0, 1)
    assert info["shape"].shape == (10,)
    frames = len(sample.poses)
    assert info["poses"].shape == ((72, frames) if frames > 1 else (72,))


def test_starter_kit_and_our_reader_agree_on_every_frame(sample):
    opened = Sample(sample.folder)
    for garment in GARMENTS:
        for frame in range(len(opened)):
            theirs = starter_kit_world(sample.folder, garment, frame)
            ours = opened.vertices(garment, frame, frame + 1)[0]
            np.testing.assert_allclose(ours, theirs, atol=5e-4)  # ours is single precision
            half = ours - sample.trans[frame]
            np.testing.assert_allclose(half, theirs - sample.trans[frame], atol=3e-4)


def test_starter_kit_reads_the_meshes(sample):
    opened = Sample(sample.folder)
    for garment in GARMENTS:
        vertices, uv, faces, uv_faces = starter_kit_obj(sample.folder / f"{garment}.obj")
        mesh = opened.mesh(garment)
        np.testing.assert_allclose(vertices, mesh.vertices, atol=1e-6)
        np.testing.assert_allclose(uv, mesh.uv, atol=1e-6)
        np.testing.assert_array_equal(faces, mesh.faces)
        np.testing.assert_array_equal(uv_faces, mesh.uv_faces)
        assert len(vertices) == starter_kit_frame(sample.folder / f"{garment}.pc16", 0).shape[0]


def test_deepsd_family_and_our_reader_agree(sample):
    opened = Sample(sample.folder)
    for garment in GARMENTS:
        rest, triangles = deepsd_rest(sample.folder, garment)
        np.testing.assert_allclose(rest, opened.mesh(garment).vertices, atol=1e-6)
        np.testing.assert_array_equal(triangles, opened.mesh(garment).triangles)
        frames = deepsd_frames(sample.folder / f"{garment}.pc16")
        np.testing.assert_allclose(
            frames, opened.vertices(garment, frame="root"), atol=3e-4, rtol=0
        )


def test_deepsd_family_places_the_rest_body_inside_the_rest_garments(sample, toy_body):
    body, _ = posed_vertices(toy_body, sample.shape, REST_POSE[None].copy())
    for garment in GARMENTS:
        rest, _ = deepsd_rest(sample.folder, garment)
        # The tiny garments are tubes about the body's axis, so they share its middle plane.
        assert abs(rest[:, 0].mean() - body[0, :, 0].mean()) < 0.02


def test_starter_kit_finds_the_files_of_every_garment(sample):
    for garment in starter_kit_info(sample.folder)["outfit"]:
        assert (sample.folder / f"{garment}.obj").is_file()
        assert (sample.folder / f"{garment}.pc16").is_file()


@pytest.mark.parametrize("suffix", [".obj", ".pc16"])
def test_a_reader_that_takes_every_such_file_for_a_garment_finds_the_outfit(sample, suffix):
    outfit = starter_kit_info(sample.folder)["outfit"]
    names = [name for name in os.listdir(sample.folder) if name.endswith(suffix)]
    assert {outfit[name.removesuffix(suffix)]["fabric"] for name in names} == {"cotton", "denim"}
    assert len(names) == len(outfit)


def test_reconstructions_too_hold_nothing_but_garments(tmp_path, toy_body):
    rest = tube(0.25, -0.4, 0.05)
    poses = np.repeat(REST_POSE[None], 2, 0)
    texture = {"type": "color", "data": [0.4, 0.5, 0.7]}
    info = SampleInfo(
        poses, np.zeros((2, 3)), np.zeros(10), "female", outfit={"Skirt": {"texture": texture}}
    )
    skirt = GarmentAnimation("Skirt", rest, np.stack([rest.vertices] * 2))
    write_reconstruction(tmp_path / "Skirt", toy_body, info, [skirt])
    files = {path.name for path in (tmp_path / "Skirt").iterdir() if path.is_file()}
    assert files == {"info.mat", "Skirt.obj", "Skirt.pc16"}


def test_every_entry_of_a_split_is_a_sample(sample, tmp_path):
    collect_dataset([sample.folder], tmp_path / "dataset")
    for name in os.listdir(tmp_path / "dataset/train"):
        assert starter_kit_info(tmp_path / "dataset/train" / name)["zrot"] == 0
