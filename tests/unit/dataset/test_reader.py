import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices, save_body
from drapeline.dataset.info_mat import read_info, write_info
from drapeline.dataset.reader import Cloth3D, Sample, open_dataset
from drapeline.errors import DamagedFile, InputError
from drapeline.geometry.mesh import Mesh
from drapeline.geometry.obj import load_obj, save_obj
from drapeline.storage import atomic_folder
from toys.tiny_sample import GARMENTS, body_truth, write_tiny_sample


@pytest.fixture
def original(tiny, tmp_path):
    """The sample as the original would store it: no extras, and no meta."""
    folder = tmp_path / "train" / "00001"
    folder.mkdir(parents=True)
    for path in tiny.folder.glob("*.*"):
        shutil.copy(path, folder)
    return folder


def turn(angle):
    return np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )


def test_a_flat_folder_and_split_folders_are_both_datasets(tmp_path, tiny):
    for split, ids in (("train", ("00003", "00001")), ("val", ("00002",))):
        for sample in ids:
            shutil.copytree(tiny.folder, tmp_path / split / sample)
    (tmp_path / "train" / "notes").mkdir()
    (tmp_path / "samples.tsv").touch()
    everything = Cloth3D(tmp_path)
    assert len(everything) == 3
    assert [sample.id for sample in everything] == ["00001", "00002", "00003"]
    assert [sample.split for sample in everything] == ["train", "val", "train"]
    assert Cloth3D(tmp_path, "train").ids == ["00001", "00003"]
    assert Cloth3D(tmp_path / "train").ids == ["00001", "00003"]
    assert everything[-1].id == everything["00003"].id == "00003"
    assert "00002" in everything
    assert "00002" not in Cloth3D(tmp_path, "train")
    with pytest.raises(KeyError, match="00009"):
        everything["00009"]
    with pytest.raises(IndexError):
        everything[3]


def test_an_empty_or_missing_dataset_is_named(tmp_path):
    with pytest.raises(InputError, match="nowhere: no such folder"):
        Cloth3D(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"test: no folder with an info.mat"):
        Cloth3D(tmp_path, "test")


def test_one_id_in_two_splits_is_refused(tmp_path, tiny):
    shutil.copytree(tiny.folder, tmp_path / "train" / "00001")
    shutil.copytree(tiny.folder, tmp_path / "val" / "00001")
    with pytest.raises(InputError, match="sample 00001 is also in"):
        Cloth3D(tmp_path)
    assert len(Cloth3D(tmp_path, "val")) == 1


def test_garment_vertices_are_those_simulated(tiny):
    sample = Sample(tiny.folder)
    assert sample.garments == GARMENTS
    for name in GARMENTS:
        root = sample.vertices(name, 1, 4, "root")
        np.testing.assert_array_equal(root, tiny.vertices[name][1:4])
        world = sample.vertices(name, 1, 4)
        expected = tiny.vertices[name][1:4] + tiny.trans[1:4, None]
        np.testing.assert_allclose(world, expected, atol=1e-6)
        assert world.dtype == np.float32
    assert sample.vertices("Skirt").shape == (len(sample), 80, 3)
    assert sample.vertices("Skirt", 3, 3).shape == (0, 80, 3)


def test_labels_are_read(tiny):
    sample = Sample(tiny.folder)
    assert sample.fabrics == {"Tshirt": "jersey", "Skirt": "denim"}
    assert sample.info.outfit["Tshirt"]["fabric"] == "cotton"  # CLOTH3D knows no jersey
    assert (sample.gender, sample.fps, len(sample)) == ("female", 30, 6)
    np.testing.assert_array_equal(sample.tightness, [-1.0, 0.25])
    np.testing.assert_allclose(sample.root_positions(2, 4), tiny.trans[2:4])
    assert sample.health["inside_share"].shape == (6,)


def test_rest_mesh_has_quads_triangles_and_uvs(tiny):
    mesh = Sample(tiny.folder).mesh("Skirt")
    assert mesh.faces.shape == (64, 4)
    assert mesh.triangles.shape == (128, 3)
    assert mesh.uv_faces.shape == (64, 4)


def test_the_body_is_read_or_rebuilt_to_half_precision(tiny, toy_body):
    truth = body_truth(toy_body, tiny)
    stored = Sample(tiny.folder)
    rebuilt = Sample(tiny.folder, bodies={"female": toy_body})
    np.testing.assert_allclose(rebuilt.body_vertices(2, 5), truth[2:5], atol=1e-6)
    np.testing.assert_allclose(stored.body_vertices(2, 5), truth[2:5], atol=5e-4)
    np.testing.assert_array_equal(stored.body_mesh().faces, toy_body.faces)


def test_the_original_reads_the_same_without_extras(original, tiny, toy_body):
    sample = Cloth3D(original.parent.parent, bodies={"female": toy_body})[0]
    assert sample.meta is None
    assert sample.health == {}
    for name in GARMENTS:
        np.testing.assert_array_equal(
            sample.vertices(name, frame="root"), tiny.vertices[name].astype(np.float16)
        )
    np.testing.assert_allclose(sample.body_vertices(), body_truth(toy_body, tiny), atol=1e-6)
    np.testing.assert_allclose(
        sample.body_mesh().vertices, load_obj(tiny.folder / "extras/Body.obj").vertices, atol=1e-6
    )


def test_a_dataset_may_be_opened_with_the_files_of_bodies(original, tmp_path, toy_body):
    save_body(tmp_path / "body.npz", toy_body)
    given = {"female": str(tmp_path / "body.npz")}
    opened = open_dataset(original.parent.parent, bodies=given)
    known = Cloth3D(original.parent.parent, bodies={"female": toy_body})
    assert opened.ids == known.ids
    assert (opened[0].body_vertices() == known[0].body_vertices()).all()
    with pytest.raises(InputError, match=r"none.npz"):
        open_dataset(original.parent.parent, bodies={"female": tmp_path / "none.npz"})


def test_without_a_body_the_original_says_what_it_needs(original):
    with pytest.raises(InputError, match=r"Body.pc16: no such file, expected .* a body model"):
        Sample(original).body_vertices()
    with pytest.raises(InputError, match="no body model for gender female"):
        Sample(original).body_mesh()


def test_another_body_than_the_samples_own_is_refused(tiny, toy_body):
    other = replace(toy_body, v_template=toy_body.v_template * 1.01, name="other")
    with pytest.raises(InputError, match="made with body 'toy-1', but the body model"):
        Sample(tiny.folder, bodies={"female": other}).body_vertices()
    with pytest.raises(InputError, match="no body model for gender female, only for male"):
        Sample(tiny.folder, bodies={"male": toy_body}).body_vertices()


def test_the_scenes_turn_is_applied_after_the_translation(original, tiny, toy_body):
    info = read_info(original / "info.mat")
    write_info(original / "info.mat", replace(info, zrot=2.1))
    sample = Sample(original, bodies={"female": toy_body})
    expected = (tiny.vertices["Skirt"] + tiny.trans[:, None]) @ turn(2.1).T
    np.testing.assert_allclose(sample.vertices("Skirt"), expected, atol=1e-3)
    body = body_truth(toy_body, tiny) @ turn(2.1).T
    np.testing.assert_allclose(sample.body_vertices(), body, atol=1e-5)
    np.testing.assert_allclose(sample.root_positions(), tiny.trans @ turn(2.1).T)


@pytest.mark.parametrize("rest_turned", [True, False])
def test_rest_meshes_are_turned_back_where_the_release_turned_them(original, tiny, rest_turned):
    info = read_info(original / "info.mat")
    write_info(original / "info.mat", replace(info, zrot=-0.7))
    made = tiny.meshes["Tshirt"]
    if rest_turned:
        points = (made.vertices @ turn(-0.7).T).astype(np.float32)
        save_obj(original / "Tshirt.obj", Mesh(points, made.faces, made.uv, made.uv_faces))
    rest = Sample(original, rest_turned=rest_turned).mesh("Tshirt")
    np.testing.assert_allclose(rest.vertices, made.vertices, atol=2e-6)


def test_test_sets_without_fabrics_or_outfit_are_read(original):
    info = read_info(original / "info.mat")
    bare = {name: {"texture": {"type": "pattern"}} for name in GARMENTS}
    write_info(original / "info.mat", replace(info, tightness=None, outfit=bare))
    sample = Sample(original)
    assert sample.tightness is None
    assert sample.fabrics == {"Tshirt": None, "Skirt": None}
    write_info(original / "info.mat", replace(info, outfit={}))
    assert sorted(Sample(original).garments) == sorted(GARMENTS)


def test_a_single_frame_is_not_squeezed_away(tmp_path, toy_body):
    tiny = write_tiny_sample(tmp_path, toy_body, frames=1)
    sample = Sample(tiny.folder)
    assert len(sample) == 1
    assert sample.vertices("Skirt").shape == (1, 80, 3)
    assert sample.body_vertices().shape == (1, len(toy_body.v_template), 3)


@pytest.mark.parametrize(
    "read",
    [
        lambda sample: sample.vertices("Tshirt", 0, 1),
        lambda sample: sample.mesh("Tshirt"),
        lambda sample: sample.health,
        len,
    ],
)
def test_sizes_are_compared_whatever_is_read_of_a_sample(tmp_path, tiny, read):
    folder = shutil.copytree(tiny.folder, tmp_path / "00001")
    (folder / "Skirt.obj").write_bytes(b"v 0 0 0\n")
    with pytest.raises(DamagedFile, match=r"Skirt\.obj: 8 bytes, expected \d+ as in .*manifest"):
        read(Sample(folder))


def test_parts_of_a_sample_can_be_read_without_the_others(tmp_path, tiny):
    folder = shutil.copytree(tiny.folder, tmp_path / "00001")
    (folder / "extras" / "Tshirt.f32").unlink()
    assert Sample(folder).vertices("Tshirt", 0, 1).shape[0] == 1
    with pytest.raises(DamagedFile, match=r"Tshirt\.f32: cannot be read \(No such file"):
        Sample(folder).verify()


def test_sums_are_compared_where_that_is_asked_for(tmp_path, tiny):
    folder = shutil.copytree(tiny.folder, tmp_path / "train" / "00001")
    Cloth3D(tmp_path).verify()
    cache = bytearray((folder / "Skirt.pc16").read_bytes())
    cache[-1] ^= 1
    (folder / "Skirt.pc16").write_bytes(cache)
    assert len(Sample(folder)) > 0
    for whole in (Sample(folder), Cloth3D(tmp_path)):
        with pytest.raises(DamagedFile, match=r"Skirt\.pc16: its SHA-256 sum"):
            whole.verify()


def test_what_a_job_is_writing_is_no_sample(tmp_path, tiny):
    shutil.copytree(tiny.folder, tmp_path / "00001")
    with atomic_folder(tmp_path / "00002") as scratch:
        shutil.copytree(tiny.folder, scratch, dirs_exist_ok=True)
        assert Cloth3D(tmp_path).ids == ["00001"]
    assert Cloth3D(tmp_path).ids == ["00001", "00002"]


@pytest.mark.parametrize("suffix", ["f32", "pc16"])
def test_a_truncated_cache_is_one_sentence(tmp_path, tiny, suffix):
    folder = shutil.copytree(tiny.folder, tmp_path / "00001")
    [path] = folder.rglob(f"Skirt.{suffix}")
    path.write_bytes(path.read_bytes()[:-2])
    with pytest.raises(InputError, match=rf"Skirt.{suffix}: \d+ bytes, expected \d+"):
        Sample(folder).vertices("Skirt", 0, 1)


def test_frames_that_do_not_match_the_poses_are_refused(original):
    info = read_info(original / "info.mat")
    write_info(original / "info.mat", replace(info, poses=info.poses[:4], trans=info.trans[:4]))
    with pytest.raises(InputError, match=r"Skirt.pc16: 6 frames, expected 4 as in info.mat"):
        Sample(original).vertices("Skirt")


def test_frames_of_another_garment_are_refused(original):
    shutil.copy(original / "Tshirt.pc16", original / "Skirt.pc16")
    with pytest.raises(InputError, match=r"Skirt.pc16: \d+ vertices per frame, expected \d+ as in"):
        Sample(original).vertices("Skirt")


def test_positions_that_are_no_numbers_are_refused(original):
    data = bytearray((original / "Skirt.pc16").read_bytes())
    data[-2:] = np.float16(np.nan).tobytes()
    (original / "Skirt.pc16").write_bytes(data)
    sample = Sample(original)
    sample.vertices("Skirt", 0, 1)
    with pytest.raises(DamagedFile, match="Skirt.pc16: a position is not finite"):
        sample.vertices("Skirt")


def test_wrong_names_and_ranges_are_told(tiny, toy_body):
    sample = Sample(tiny.folder, bodies={"female": toy_body})
    with pytest.raises(KeyError, match="no garment Dress, only Tshirt, Skirt"):
        sample.vertices("Dress")
    with pytest.raises(KeyError, match="no garment ../00001/Skirt, only Tshirt, Skirt"):
        sample.mesh("../00001/Skirt")
    with pytest.raises(IndexError, match=r"within \[0, 6\)"):
        sample.vertices("Skirt", 0, 7)
    with pytest.raises(IndexError, match=r"within \[0, 6\)"):
        sample.body_vertices(-1, 2)
    with pytest.raises(ValueError, match="expected 'world' or 'root'"):
        sample.vertices("Skirt", frame="camera")


def test_a_sample_can_be_sent_to_another_process(tiny):
    sample = Sample(tiny.folder)
    before = sample.vertices("Skirt", 0, 2)
    np.testing.assert_array_equal(
        pickle.loads(pickle.dumps(sample)).vertices("Skirt", 0, 2), before
    )


def test_a_closed_sample_opens_again(tiny):
    with Sample(tiny.folder) as sample:
        before = sample.vertices("Skirt", 0, 1)
    np.testing.assert_array_equal(sample.vertices("Skirt", 0, 1), before)


def test_joints_are_those_of_the_body_that_made_the_sample(tiny, toy_body):
    with Sample(tiny.folder, bodies={"female": toy_body, "male": toy_body}) as sample:
        joints = sample.joints(1, 4)
        expected = posed_vertices(toy_body, sample.info.shape, sample.info.poses[1:4])[1]
        np.testing.assert_allclose(
            joints, expected + sample.root_positions(1, 4)[:, None], atol=1e-5
        )
        np.testing.assert_allclose(sample.joints(1, 4, frame="root"), expected, atol=1e-6)
        with pytest.raises(IndexError, match="within"):
            sample.joints(1, 99)
    with Sample(tiny.folder) as sample, pytest.raises(InputError, match="has different arrays"):
        sample.joints()
