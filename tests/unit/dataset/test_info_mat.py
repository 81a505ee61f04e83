import io
from dataclasses import replace

import numpy as np
import pytest
import scipy.io

from drapeline.dataset.info_mat import (
    SampleInfo,
    read_info,
    read_placement,
    sample_scene,
    write_info,
)
from drapeline.errors import InputError
from drapeline.seeding import rng_for


@pytest.fixture(params=[5, 1], ids=["frames", "one_frame"])
def info(request):
    rng = np.random.default_rng(1)
    camera, lights = sample_scene(rng)
    return SampleInfo(
        poses=rng.normal(size=(request.param, 72)),
        trans=rng.normal(size=(request.param, 3)),
        shape=rng.normal(size=10),
        gender="male",
        outfit={
            "Tshirt": {"texture": {"type": "color", "data": [0.1, 0.2, 0.3]}, "fabric": "cotton"},
            "Trousers": {"texture": {"type": "pattern"}, "fabric": "denim"},
        },
        tightness=np.array([-1.2, 0.3]),
        camera_location=camera,
        lights=lights,
    )


def test_what_is_written_is_read(tmp_path, info):
    write_info(tmp_path / "info.mat", info)
    again = read_info(tmp_path / "info.mat")
    for name in ("poses", "trans", "shape", "tightness", "camera_location"):
        np.testing.assert_array_equal(getattr(again, name), getattr(info, name))
        assert getattr(again, name).dtype == np.float64
    assert (again.gender, again.zrot) == ("male", 0.0)
    assert again.outfit["Trousers"] == {"texture": {"type": "pattern"}, "fabric": "denim"}
    np.testing.assert_array_equal(again.outfit["Tshirt"]["texture"]["data"], [0.1, 0.2, 0.3])
    assert again.lights["type"] == info.lights["type"]


def test_the_placement_is_a_part_of_the_whole(tmp_path, info):
    path = tmp_path / "info.mat"
    write_info(path, replace(info, zrot=0.3))
    placement = read_placement(path)
    assert placement.garments == ("Tshirt", "Trousers")
    assert placement.zrot == 0.3
    np.testing.assert_array_equal(placement.trans, info.trans)
    write_info(path, replace(info, outfit={"../Top": info.outfit["Tshirt"]}))
    with pytest.raises(InputError, match=r"info.mat: a garment is '../Top'"):
        read_placement(path)


def test_fields_have_the_original_order_types_and_shapes(tmp_path, info):
    path = tmp_path / "info.mat"
    write_info(path, info)
    raw = scipy.io.loadmat(path)
    fields = {k: (v.dtype.str, v.shape) for k, v in raw.items() if not k.startswith("__")}
    count = len(info.poses)
    assert list(fields) == (
        ["shape", "lights", "camLoc", "zrot", "tightness", "outfit", "gender", "trans", "poses"]
    )
    assert fields["poses"] == ("<f8", (72, count))
    assert fields["trans"] == ("<f8", (3, count))
    assert fields["shape"] == ("<f8", (1, 10))
    assert fields["gender"] == ("<i8", (1, 1))
    assert fields["zrot"] == ("<f8", (1, 1))
    assert fields["tightness"] == ("<f8", (1, 2))
    assert fields["camLoc"] == ("<f8", (1, 3))
    outfit = raw["outfit"][0, 0]
    assert outfit.dtype.names == ("Tshirt", "Trousers")
    assert outfit["Tshirt"][0, 0].dtype.names == ("texture", "fabric")
    assert outfit["Tshirt"][0, 0]["texture"][0, 0]["data"].shape == (1, 3)
    assert raw["lights"][0, 0].dtype.names == ("type", "data")


def test_the_file_is_uncompressed_matlab_5_and_resaves_to_the_same_size(tmp_path, info):
    path = tmp_path / "info.mat"
    write_info(path, info)
    data = path.read_bytes()
    assert data.startswith(b"MATLAB 5.0 MAT-file Platform: posix")
    assert data[128:132] == (14).to_bytes(4, "little")  # miMATRIX; 15 would be compressed
    loaded = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    again = io.BytesIO()
    scipy.io.savemat(again, {k: v for k, v in loaded.items() if not k.startswith("__")})
    if len(info.poses) > 1:  # a squeezed single column is saved as a row: other shape, same size
        assert again.getvalue()[128:] == data[128:]
    assert len(again.getvalue()) == len(data)


def test_equal_contents_give_equal_bytes(tmp_path, info):
    write_info(tmp_path / "a.mat", info)
    write_info(tmp_path / "b.mat", info)
    assert (tmp_path / "a.mat").read_bytes() == (tmp_path / "b.mat").read_bytes()


@pytest.mark.parametrize("count", [1, 3])
def test_point_lights_are_a_list_however_many_there_are(tmp_path, info, count):
    lights = {"type": "point", "data": [{"loc": np.ones(3), "pwr": 60.0 + i} for i in range(count)]}
    write_info(tmp_path / "info.mat", replace(info, lights=lights))
    read = read_info(tmp_path / "info.mat").lights["data"]
    assert [light["pwr"] for light in read] == [60.0, 61.0, 62.0][:count]


def test_test_sets_without_tightness_and_fabrics_are_read(tmp_path, info):
    bare = replace(info, tightness=None, outfit={"Top": {"texture": {"type": "pattern"}}})
    write_info(tmp_path / "info.mat", replace(bare, lights=None, camera_location=None))
    again = read_info(tmp_path / "info.mat")
    assert again.tightness is None
    assert again.outfit == {"Top": {"texture": {"type": "pattern"}}}


def test_scenes_stay_in_the_originals_ranges():
    scenes = [sample_scene(rng_for(seed, "scene")) for seed in range(60)]
    for camera, lights in scenes:
        assert 4.4 <= camera[0] <= 5.8
        assert camera[1:].tolist() == [0, 1]
        if lights["type"] == "point":
            assert 1 <= len(lights["data"]) <= 3
            assert all(54 <= light["pwr"] <= 87 for light in lights["data"])
    assert {lights["type"] for _, lights in scenes} == {"sun", "point"}


def test_a_damaged_file_is_one_sentence(tmp_path, info):
    path = tmp_path / "info.mat"
    with pytest.raises(InputError, match=r"info.mat: no such file"):
        read_info(path)
    write_info(path, info)
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(InputError, match="not readable as a MATLAB v5 file"):
        read_info(path)
    path.write_text("poses")
    with pytest.raises(InputError, match="not readable as a MATLAB v5 file"):
        read_info(path)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"poses": np.zeros((71, 4))}, r"poses has shape \(71, 4\), expected \(72, N\)"),
        ({"trans": np.zeros((3, 3))}, "4 poses but 3 trans"),
        ({"gender": 2}, "gender is 2"),
        ({"shape": np.full((1, 10), np.nan)}, "shape holds NaN or infinity"),
    ],
)
def test_fields_that_do_not_fit_are_named(tmp_path, change, complaint):
    fields = {
        "poses": np.zeros((72, 4)),
        "trans": np.zeros((3, 4)),
        "shape": np.zeros((1, 10)),
        "gender": 0,
    }
    scipy.io.savemat(tmp_path / "info.mat", fields | change)
    with pytest.raises(InputError, match=complaint):
        read_info(tmp_path / "info.mat")


def test_missing_fields_are_listed(tmp_path):
    scipy.io.savemat(tmp_path / "info.mat", {"poses": np.zeros((72, 4)), "gender": 0})
    with pytest.raises(InputError, match="lacks trans, shape; it holds poses, gender"):
        read_info(tmp_path / "info.mat")
