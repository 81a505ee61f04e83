import numpy as np
import pytest

from drapeline.errors import InputError
from drapeline.motions.joint_map import BUILT_IN, REQUIRED, JointMap, built_in_map, load_joint_map
from drapeline.motions.skeleton import Take


def take_with(*names):
    zeros = np.zeros((len(names), 3))
    turns = np.tile(np.eye(3), (1, len(names), 1, 1))
    parents = np.arange(len(names)) - 1
    return Take("m.bvh", names, parents, zeros, turns, zeros[None], np.zeros(1))


def written(path, text):
    path.write_text(text)
    return path


def lines(**changes):
    joints = {joint: f"my_{joint}" for joint in REQUIRED} | changes
    return "joints:\n" + "".join(f"  {k}: {v}\n" for k, v in joints.items() if v)


def test_a_map_is_read(tmp_path):
    found = load_joint_map(written(tmp_path / "m.yaml", lines(neck="Hals") + "up: -Z\n"))
    assert found.joints["neck"] == "Hals"
    assert found.up == "-Z"


@pytest.mark.parametrize("path", sorted(BUILT_IN.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_map_is_complete_and_found_by_its_joints(path):
    found = load_joint_map(path)
    take = take_with(*dict.fromkeys(found.joints.values()))
    assert set(built_in_map(take).joints.values()) <= set(take.names)
    assert len(set(found.joints.values())) == len(found.joints)


def test_the_richest_built_in_map_is_told_by_its_names():
    cmu = load_joint_map(BUILT_IN / "cmu_bvh.yaml")
    assert built_in_map(take_with(*cmu.joints.values(), "Spine2")).name == cmu.name


def test_a_prefix_of_every_joint_is_ignored():
    mixamo = load_joint_map(BUILT_IN / "mixamo.yaml")
    names = [f"mixamorig:{name}" for name in mixamo.joints.values()]
    found = built_in_map(take_with(*names))
    assert found.indices(take_with(*names))["left_knee"] == names.index("mixamorig:LeftLeg")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joints: [1, 2", "not readable as YAML"),
        ("hello", "expected a key 'joints'"),
        (lines(left_hip=None), "no source joint to left_hip"),
        (lines(tail="Tail"), "tail is no SMPL joint"),
        (lines() + "up: W\n", "'up' is 'W', expected one of X, Y, Z"),
        (lines() + "scale: 2\n", "unknown key scale"),
        (lines() + "twist_deg: 3\n", "'twist_deg' is 3, expected angles of left_hip"),
        (lines() + "twist_deg: {head: 3}\n", "expected angles of left_hip"),
        (lines() + "twist_deg: {left_hip: x}\n", "twist of left_hip is x, expected -180 to 180"),
        (lines() + "up: &a [X]\ntwist_deg: *a\n", "it has an alias"),
        ("joints: !!python/object/apply:os.system ['true']\n", "not readable as YAML"),
    ],
)
def test_bad_maps_are_named(tmp_path, text, message):
    with pytest.raises(InputError, match=r"m\.yaml: ") as caught:
        load_joint_map(written(tmp_path / "m.yaml", text))
    assert message in str(caught.value)


def test_a_missing_map_is_named(tmp_path):
    with pytest.raises(InputError, match=r"m\.yaml: no such file"):
        load_joint_map(tmp_path / "m.yaml")


def test_joints_the_file_lacks_are_named():
    with pytest.raises(
        InputError, match="has no joint Hips that joint map mine names; it has a, b"
    ):
        JointMap("mine", {"pelvis": "Hips", "head": "a"}).indices(take_with("a", "b"))
