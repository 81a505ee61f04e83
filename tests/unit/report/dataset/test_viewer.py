import base64
import io
import json
import re
import zlib

import numpy as np
import pytest
from PIL import Image

from drapeline.dataset.reader import Sample
from drapeline.dataset.sample_meshes import scene_parts
from drapeline.dataset.scene_part import ScenePart
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.report.dataset import viewer
from drapeline.report.dataset.viewer import (
    STEPS_M,
    encode_frames,
    encode_parts,
    example_sample,
    write_viewer,
)
from toys.tiny_sample import write_tiny_sample


def parts_of(header, data):
    """The slow twin of the page's own decoding: [(vertices (N, V, 3), triangles)]."""
    data = zlib.decompress(data)
    offset, found = 0, []
    for part in header["parts"]:
        size = 12 * part["triangles"]
        triangles = np.frombuffer(data[offset : offset + size], "<u4").reshape(-1, 3)
        offset += size
        if "print" in part:
            source = np.frombuffer(data, "<u4", part["corners"], offset)
            uv = np.frombuffer(data, "<f4", 2 * part["corners"], offset + 4 * part["corners"])
            offset += 12 * part["corners"]
            part |= {"uv": uv.reshape(-1, 2)[triangles]}
            triangles = source[triangles]
        frames, vertices = header["frames"], part["vertices"]
        count = frames * vertices * 3
        coded = data[offset : offset + 2 * count]
        offset += 2 * count
        steps = np.zeros((frames, vertices, 3), dtype=int)
        for f in range(frames):
            for axis in range(3):
                change = 0
                for v in range(vertices):
                    at = (f * 3 + axis) * vertices + v
                    folded = coded[at] | coded[count + at] << 8
                    change += folded >> 1 if folded % 2 == 0 else -(folded >> 1) - 1
                    before = steps[f - 1, v, axis] if f else 0
                    steps[f, v, axis] = (before + change) % 2**16
        found.append((np.array(header["origin_m"]) + header["step_m"] * steps, triangles))
    assert offset == len(data)
    return found


def read_page(path):
    text = path.read_text()
    header = re.search(r'id="header">(.*?)</script>', text, re.DOTALL).group(1)
    data = re.search(r'id="data">(.*?)</script>', text, re.DOTALL).group(1)
    return text, json.loads(header), base64.b64decode(data)


def triangle_part(frames, vertices=3):
    points = np.asarray(frames, dtype=np.float32)
    mesh = Mesh(points[0], np.array([[0, 1, 2]], dtype=np.int32))
    return ScenePart("Skirt", mesh, (0.1, 0.2, 0.3), lambda a, b: points[a:b], len(points))


def test_the_page_holds_the_sample_within_rounding(tmp_path, dataset):
    folder = dataset.path / "test/00004"
    size = write_viewer(tmp_path / "x.html", folder)
    text, header, data = read_page(tmp_path / "x.html")
    assert size == (tmp_path / "x.html").stat().st_size
    sequence = Sample(folder)
    expected = scene_parts(sequence)
    found = parts_of(header, data)
    assert [part["name"] for part in header["parts"]] == ["Body", "Tshirt", "Skirt"]
    for part, about, (vertices, triangles) in zip(expected, header["parts"], found, strict=True):
        np.testing.assert_allclose(vertices, np.stack(list(part.frames())), atol=1.01e-4)
        np.testing.assert_array_equal(triangles, part.mesh.triangles)
        np.testing.assert_allclose(about["colour"], part.colour, atol=1e-4)
    assert (header["fps"], header["stride"], header["frames"]) == (30, 1, 6)
    assert "Sample 00004" in text
    assert "Tshirt of jersey, Skirt of denim" in text


def test_the_page_needs_no_network(tmp_path, dataset):
    write_viewer(tmp_path / "x.html", dataset.path / "test/00004")
    text = re.sub(r'(?s)id="data">.*?</script>', "", (tmp_path / "x.html").read_text())
    for sign in ("http:", "https:", "//cdn", "import(", "fetch(", "src=", "href=", "@import"):
        assert sign not in text


def test_any_16_bit_positions_come_back(tmp_path):
    rng = np.random.default_rng(0)
    steps = rng.integers(0, 2**16, (4, 5, 3)).astype(np.uint16)
    steps[:, 0] = [[0, 65535, 0], [65535, 0, 65535], [0, 65535, 0], [1, 2, 3]]
    header = {
        "origin_m": [0, 0, 0],
        "step_m": 1,
        "frames": 4,
        "parts": [{"triangles": 0, "vertices": 5}],
    }
    [(found, _)] = parts_of(header, zlib.compress(encode_frames(steps)))
    np.testing.assert_array_equal(found, steps)


def test_a_clip_wider_than_16_bits_is_rounded_more_coarsely():
    way = np.linspace(0, 40, 5)[:, None, None]
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) + way
    header, data = encode_parts([triangle_part(points)], range(5))
    assert header["step_m"] == pytest.approx(41 / 65535)
    [(found, _)] = parts_of(header, data)
    np.testing.assert_allclose(found, points, atol=0.51 * header["step_m"] + 1e-5)


def test_long_clips_keep_their_speed_and_their_length(tmp_path, dataset, monkeypatch):
    monkeypatch.setattr(viewer, "FRAMES_MAX", 3)
    write_viewer(tmp_path / "x.html", dataset.path / "test/00004")
    _, header, _ = read_page(tmp_path / "x.html")
    assert (header["frames"], header["stride"], header["fps"]) == (3, 2, 15)


@pytest.mark.parametrize("share", [0.95, 0.5])
def test_heavy_samples_are_rounded_then_lose_frames_and_never_vertices(tmp_path, dataset, share):
    whole = write_viewer(tmp_path / "whole.html", dataset.path / "test/00004")
    data = 4 / 3 * len(read_page(tmp_path / "whole.html")[2])
    limit = int(share * data) + viewer._PAGE_BYTES
    size = write_viewer(tmp_path / "less.html", dataset.path / "test/00004", bytes_max=limit)
    _, header, _ = read_page(tmp_path / "less.html")
    assert size < min(limit, whole)
    assert header["step_m"] > STEPS_M[0]
    assert (header["frames"] == 6) == (share == 0.95)
    assert header["parts"][1]["vertices"] == 60


def test_a_rejected_sample_gets_a_page_that_says_why(tmp_path, dataset):
    write_viewer(tmp_path / "x.html", dataset.samples / "00003")
    _, header, data = read_page(tmp_path / "x.html")
    assert header["title"] == "Sample 00003 was rejected"
    assert header["lines"] == ["1.20 % of the vertices inside the body"]
    assert data == b""


def test_the_example_is_a_test_sample_if_there_is_one(dataset, rejected, tmp_path):
    assert example_sample(dataset.path) == dataset.path / "test/00004"
    assert example_sample(rejected.path) is None
    write_viewer(tmp_path / "x.html", None)
    assert "No sample was accepted" in (tmp_path / "x.html").read_text()


def test_vertices_that_are_not_finite_are_refused():
    with pytest.raises(InputError, match="Skirt: vertices are not finite"):
        encode_parts([triangle_part([[[0, 0, 0], [1, 0, 0], [0, np.nan, 0]]])], range(1))


def test_text_cannot_leave_the_header(tmp_path, dataset):
    viewer._write(tmp_path / "x.html", {"title": "</script><b>", "lines": []}, b"")
    text, header, _ = read_page(tmp_path / "x.html")
    assert header["title"] == "</script><b>"
    assert "<title>&lt;/script&gt;&lt;b&gt;</title>" in text


def test_what_a_label_says_leaves_the_script_element_closed(tmp_path):
    viewer._write(tmp_path / "x.html", {"title": "t", "lines": ["<!--<script>"]}, b"")
    text = (tmp_path / "x.html").read_text()
    assert "<!--<script" not in text
    header = json.loads(re.search(r'id="header">(.*?)</script>', text, re.DOTALL).group(1))
    assert header["lines"] == ["<!--<script>"]


def test_a_print_comes_with_the_corners_that_it_splits_vertices_into(tmp_path, toy_body):
    told = {"kind": "breton", "size_m": 0.1, "colours": [[0.8, 0, 0], [1, 1, 1]], "seed": 1}
    folder = write_tiny_sample(tmp_path, toy_body, prints={"Skirt": told}).folder
    write_viewer(tmp_path / "x.html", folder)
    _, header, data = read_page(tmp_path / "x.html")
    shown = parts_of(header, data)
    with Sample(folder) as sample:
        mesh, points = sample.mesh("Skirt"), sample.vertices("Skirt")
    [number] = [n for n, part in enumerate(header["parts"]) if "print" in part]
    about, (vertices, triangles) = header["parts"][number], shown[number]
    assert about["name"] == "Skirt"
    np.testing.assert_array_equal(triangles, mesh.triangles)
    np.testing.assert_allclose(vertices, points, atol=header["step_m"])
    np.testing.assert_allclose(about["uv"], mesh.uv[triangulate(mesh.uv_faces)], atol=1e-6)
    picture = base64.b64decode(about["print"].removeprefix("data:image/png;base64,"))
    with Image.open(io.BytesIO(picture)) as image:
        assert image.size == (1024, 1024)
