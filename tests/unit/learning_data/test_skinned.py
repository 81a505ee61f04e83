"""Static outfits in motion: kinematics, skirts between legs, bodies left alone, files."""

import dataclasses
import shutil

import igl
import numpy as np
import pytest

from drapeline.bodies.model import posed_vertices
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.weight_transfer import nearest_weights
from drapeline.dataset.settings import CloudSettings
from drapeline.errors import InputError
from drapeline.frames import REST_POSE
from drapeline.geometry.mesh import edges
from drapeline.learning_data.settings import SkinnedSettings
from drapeline.learning_data.skinned import load_skinned, skin_outfit, worn_weights, write_skinned
from drapeline.outfits.garment_types import LABELS
from drapeline.outfits.outfit import Garment, Outfit
from drapeline.outfits.static import StaticOutfit
from drapeline.storage import read_json
from toys.outfits_at_rest import save_static
from toys.tiny_sample import tube, write_tiny_sample

SHAPE = np.zeros(10)
SETTINGS = SkinnedSettings(frames=3, step=1, clouds=CloudSettings(points=100))


def garment(name, mesh):
    none = 3 * [np.zeros(0, np.float32)]
    return Garment(name, mesh.vertices, mesh.faces, np.zeros((0, 2)), np.zeros((0, 4)), *none)


def outfit(*garments, gender="female"):
    return Outfit(garments, SHAPE, np.zeros(2), np.zeros(2), gender)


@pytest.fixture(scope="module")
def skirt():
    return garment("Skirt", tube(0.25, -0.6, 0.0, around=32, rows=20))


@pytest.fixture(scope="module")
def top():
    return garment("Top", tube(0.28, 0.05, 0.35, around=20, rows=8))


def lifted(hip_rad):
    """A thigh lifted forwards, towards -Y."""
    pose = REST_POSE.copy()
    pose[3] = -hip_rad
    return pose


def test_an_outfit_at_rest_stays_as_it_is(toy_body, skirt, top):
    worn = skin_outfit(outfit(skirt, top), toy_body, REST_POSE[None])
    np.testing.assert_allclose(worn.body[0], rest_body(toy_body, SHAPE), atol=1e-5)
    for one in (skirt, top):
        assert worn.garments[one.name].dtype == np.float32
        np.testing.assert_allclose(worn.garments[one.name][0], one.vertices, atol=1e-5)


def test_a_turned_wearer_turns_the_outfit(toy_body, skirt, top):
    pose = REST_POSE.copy()
    pose[:3] = 0  # from upright to lying: the body model's own frame
    worn = skin_outfit(outfit(skirt, top), toy_body, pose[None])
    for one in (skirt, top):
        x, y, z = one.vertices.T
        np.testing.assert_allclose(worn.garments[one.name][0], np.stack([x, z, -y], -1), atol=1e-4)


def test_a_skirt_goes_from_leg_to_leg_without_a_crease(toy_body):
    skirt = garment("Skirt", tube(0.25, -0.6, 0.0, around=64, rows=40))
    rest = rest_body(toy_body, SHAPE)
    plain = nearest_weights(skirt.vertices, skirt.faces, rest, toy_body.faces, toy_body.weights)
    found = worn_weights(skirt, rest, toy_body)
    np.testing.assert_allclose(found.sum(axis=1), 1, atol=1e-5)
    assert found.min() > -1e-6
    pairs = edges(skirt.faces)
    jump = [np.abs(w[pairs[:, 0]] - w[pairs[:, 1]]).sum(1).max() for w in (plain, found)]
    assert jump[1] < 0.65 * jump[0]
    # Far out on the left the left leg (joints 1 and 4) still leads; in the middle neither does.
    low = skirt.vertices[:, 2] < -0.4
    side = found[:, [1, 4]].sum(1) - found[:, [2, 5]].sum(1)
    assert side[low & (skirt.vertices[:, 0] > 0.24)].min() > 0.5
    assert np.abs(side[low & (np.abs(skirt.vertices[:, 0]) < 1e-6)]).max() < 0.12


def test_other_garments_keep_their_weights(toy_body, skirt):
    rest = rest_body(toy_body, SHAPE)
    trousers = dataclasses.replace(skirt, name="Trousers")
    np.testing.assert_array_equal(
        worn_weights(trousers, rest, toy_body),
        nearest_weights(skirt.vertices, skirt.faces, rest, toy_body.faces, toy_body.weights),
    )


def test_a_lifted_leg_takes_its_side_of_the_skirt_along(toy_body, skirt):
    before, after = skin_outfit(
        outfit(skirt), toy_body, np.stack([REST_POSE, lifted(0.6)])
    ).garments["Skirt"]
    shift = (after - before)[skirt.vertices[:, 2] < -0.5]
    left = skirt.vertices[skirt.vertices[:, 2] < -0.5][:, 0] > 0.2
    right = skirt.vertices[skirt.vertices[:, 2] < -0.5][:, 0] < -0.2
    assert shift[left, 1].max() < -0.1
    assert np.abs(shift[right, 1]).max() < 0.5 * np.abs(shift[left, 1]).min()


def test_cloth_leaves_the_body(toy_body):
    """A tight tube about the hips, of which some begins inside."""
    tight = garment("Trousers", tube(0.16, -0.1, 0.05, around=40, rows=12))
    poses = np.stack([REST_POSE, lifted(0.4)])
    worn = skin_outfit(outfit(tight), toy_body, poses)

    def depth(cloth, body):
        return -igl.signed_distance(
            cloth.astype(np.float64), body.astype(np.float64), toy_body.faces.astype(np.int64)
        )[0]

    assert depth(tight.vertices, worn.body[0]).max() > 0.01
    for cloth, body in zip(worn.garments["Trousers"], worn.body, strict=True):
        assert depth(cloth, body).max() < 0.001
    np.testing.assert_array_equal(worn.body, posed_vertices(toy_body, SHAPE, poses)[0])


@pytest.fixture(scope="module")
def inputs(tmp_path_factory, toy_body, skirt, top):
    """A shard of outfits of two splits, and a sample of each of "train" and "test"."""
    stages = tmp_path_factory.mktemp("skinned")
    samples = [
        write_tiny_sample(stages, toy_body, sample, split, frames=5).folder
        for sample, split in (("00001", "train"), ("00002", "test"))
    ]
    dress = dataclasses.replace(skirt, name="Dress")
    outfits = [
        StaticOutfit("s1", "train", outfit(skirt, top)),
        StaticOutfit("s2", "test", outfit(skirt)),
        StaticOutfit("s3", "val", outfit(skirt)),
        StaticOutfit("s4", "train", outfit(dress)),
    ]
    save_static(stages / "outfits_at_rest", outfits)
    return stages / "outfits_at_rest", samples, outfits


@pytest.fixture(scope="module")
def written(inputs, toy_body, tmp_path_factory):
    shard, samples, _ = inputs
    folder = tmp_path_factory.mktemp("out") / "000"
    assert write_skinned(folder, shard, samples, {"female": toy_body}, SETTINGS) == 3
    return folder


def test_three_garments_are_kept(inputs, toy_body, skirt, top, tmp_path):
    _, samples, _ = inputs
    jacket = dataclasses.replace(top, name="Jacket")
    worn = [outfit(skirt), outfit(skirt, top, jacket)]
    statics = [StaticOutfit(f"s{k}", "train", one) for k, one in enumerate(worn)]
    save_static(tmp_path / "outfits_at_rest", statics)
    shard = tmp_path / "outfits_at_rest"
    assert write_skinned(tmp_path / "000", shard, samples, {"female": toy_body}, SETTINGS) == 2
    one, three = load_skinned(tmp_path / "000")
    assert list(one.garments) == ["Skirt"]
    assert {name: cloth.shape[1] for name, cloth in three.garments.items()} == {
        garment.name: len(garment.vertices) for garment in (skirt, top, jacket)
    }


def test_outfits_move_as_samples_of_their_own_split(written):
    found = list(load_skinned(written))
    assert [(one.name, one.split, one.sample) for one in found] == [
        ("s1", "train", "00001"),
        ("s2", "test", "00002"),
        ("s4", "train", "00001"),
    ]
    assert read_json(written / "about.json")["left_out"] == ["s3"]


def test_cloth_and_clouds_are_those_of_the_poses_named(written, inputs, toy_body):
    outfits = {static.name: static for static in inputs[2]}
    for one in load_skinned(written):
        static = outfits[one.name]
        np.testing.assert_array_equal(np.diff(one.number), 1)
        worn = skin_outfit(static.outfit, toy_body, one.poses)
        assert list(one.garments) == [g.name for g in static.outfit.garments]
        for name, cloth in one.garments.items():
            np.testing.assert_array_equal(cloth, worn.garments[name])
        assert one.points.shape == (3, 100, 3)
        codes = {0, *(LABELS.index(name) for name in one.garments)}
        assert set(np.unique(one.labels)) <= codes
        name = static.outfit.garments[0].name
        cloth = one.points[1][one.labels[1] == LABELS.index(name)]
        apart = np.linalg.norm(cloth[:, None] - one.garments[name][1][None], axis=-1)
        assert apart.min(axis=1).max() < 0.06  # between vertices some 5 cm apart


def test_the_same_seed_writes_the_same(written, inputs, toy_body, tmp_path):
    shard, samples, _ = inputs
    write_skinned(tmp_path / "b", shard, samples[::-1], {"female": toy_body}, SETTINGS)
    for name in ("points.npy", "labels.npy", "cloth.npy"):
        assert (tmp_path / "b" / name).read_bytes() == (written / name).read_bytes()


def test_frames_may_lie_apart_but_not_beyond_the_motion(inputs, toy_body, tmp_path):
    shard, samples, _ = inputs
    bodies = {"female": toy_body}
    apart = SETTINGS.replace(step=2)
    write_skinned(tmp_path / "a", shard, samples, bodies, apart)
    assert [one.number.tolist() for one in load_skinned(tmp_path / "a")] == [[0, 2, 4]] * 3
    far = SETTINGS.replace(step=3)
    with pytest.raises(InputError, match="longest of 2 samples has 5 frames, expected at least 7"):
        write_skinned(tmp_path / "b", shard, samples, bodies, far)


def test_a_shard_of_splits_that_nobody_moves_in_is_an_empty_folder(inputs, toy_body, tmp_path):
    _, samples, outfits = inputs
    shard = save_static(tmp_path / "at_rest", [one for one in outfits if one.split == "val"])
    assert write_skinned(tmp_path / "a", shard, samples, {"female": toy_body}, SETTINGS) == 0
    assert not list(load_skinned(tmp_path / "a"))
    assert read_json(tmp_path / "a" / "about.json")["left_out"] == ["s3"]


def test_damaged_folders_are_refused(written, tmp_path):
    folder = shutil.copytree(written, tmp_path / "a")
    np.save(folder / "cloth.npy", np.zeros((5, 3), np.float32))
    with pytest.raises(InputError, match="9 clouds and 5 vertices, expected 9 and"):
        list(load_skinned(folder))
    (folder / "labels.npy").unlink()
    with pytest.raises(InputError, match="labels.npy"):
        list(load_skinned(folder))
