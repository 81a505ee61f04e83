"""Checkpoints and digests."""

import json
import struct
import zipfile

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from drapeline.errors import InputError
from drapeline.models.training import checkpoints
from drapeline.models.training.checkpoints import (
    SMALL,
    Checkpoint,
    arrays_digest,
    halve,
    load_network,
    load_state,
    read_checkpoint,
    read_torch_file,
    write_checkpoint,
)

METADATA = {"checkpoint_type": "toy", "settings": {"network": {"width": 3}}}


def saved(path, *, metadata=METADATA, **weights):
    write_checkpoint(path, {"layer": torch.arange(6.0).reshape(2, 3), **weights}, metadata)
    return path


def write_raw(path, header, data=b""):
    """A safetensors file whose header says anything."""
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + data)
    return path


@pytest.mark.parametrize("content", [b"", b"not weights", b"\xff" * 8 + b"{}"])
def test_what_is_no_checkpoint_is_refused(tmp_path, content):
    path = tmp_path / "best"
    with pytest.raises(InputError, match="best: no such file, expected a checkpoint"):
        read_checkpoint(path)
    path.write_bytes(content)
    with pytest.raises(InputError, match="best: not readable as a checkpoint in safetensors"):
        read_checkpoint(path)


def test_a_network_comes_back_with_all_that_it_was_built_from(tmp_path):
    shared = torch.arange(4)
    metadata = {
        **METADATA,
        "space": {"faces/body": shared, "mean": torch.zeros(0, 3, dtype=torch.float64)},
        "levels": [{"alpha": torch.tensor(2.5)}, "text", None, 0.1, True],
    }
    wide, turned = torch.ones(1).expand(1000), torch.arange(6.0).reshape(2, 3).T
    path = saved(tmp_path / "a", metadata=metadata, wide=wide, turned=turned, same=shared)
    found = read_checkpoint(path)
    expected = {"layer": torch.arange(6.0).reshape(2, 3), "wide": wide, "turned": turned}
    assert found.weights.keys() == expected.keys() | {"same"}
    for name, value in expected.items():
        assert torch.equal(found.weights[name], value)
    assert found.metadata["levels"][0]["alpha"] == 2.5
    assert found.metadata["levels"][1:] == metadata["levels"][1:]
    for name, value in metadata["space"].items():
        assert found.metadata["space"][name].dtype == value.dtype
        assert torch.equal(found.metadata["space"][name], value)
    write_checkpoint(tmp_path / "again", *found)
    assert (tmp_path / "again").read_bytes() == path.read_bytes()


def test_a_checkpoint_that_is_cut_off_or_longer_than_it_says_is_refused(tmp_path):
    path = saved(tmp_path / "a")
    data = path.read_bytes()
    for other in (*(data[:end] for end in range(0, len(data), 7)), data + b"more"):
        path.write_bytes(other)
        with pytest.raises(InputError, match="a: not readable as a checkpoint in safetensors"):
            read_checkpoint(path)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_and_arrays_must_be_finite(tmp_path, value):
    path = saved(tmp_path / "a", bias=torch.tensor([1.0, value]))
    with pytest.raises(InputError, match="a: 'bias' holds NaN or infinity"):
        read_checkpoint(path)
    saved(path, metadata={**METADATA, "space": [{"mean": torch.tensor([value])}]})
    with pytest.raises(InputError, match="a: 'mean' holds NaN or infinity"):
        read_checkpoint(path)


def test_a_tensor_that_is_larger_than_its_file_is_refused(tmp_path):
    for shape in ([1 << 40], [1 << 40, 1 << 40], [3], [-1]):
        tensor = {"dtype": "F32", "shape": shape, "data_offsets": [0, 8]}
        header = {"__metadata__": {"drapeline": json.dumps(METADATA)}, "x": tensor}
        path = write_raw(tmp_path / "a", header, bytes(8))
        with pytest.raises(InputError, match="a: not readable as a checkpoint in safetensors"):
            read_checkpoint(path)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "Expecting"),
        ('{"checkpoint_type": "toy", "rate": NaN}', "NaN is no number"),
        ('{"checkpoint_type": "toy", "rate": 1e999}', "too large"),
        ('{"space": {"tensor": "metadata/space"}}', "lacks the tensor 'metadata/space'"),
        ("[" * 100_000, "recursion"),
    ],
)
def test_metadata_that_is_no_sound_json_is_refused(tmp_path, text, reason):
    path = write_raw(tmp_path / "a", {"__metadata__": {"drapeline": text}})
    with pytest.raises(InputError, match=f"a: not readable as a checkpoint .*{reason}"):
        read_checkpoint(path)


@pytest.mark.parametrize(
    "metadata", [{}, {"other": "x"}, {"drapeline": "{}"}, {"drapeline": '{"checkpoint_type": 3}'}]
)
def test_a_checkpoint_says_what_it_is_of(tmp_path, metadata):
    path = write_raw(tmp_path / "a", {"__metadata__": metadata})
    with pytest.raises(InputError, match="a: not a checkpoint of drapeline"):
        read_checkpoint(path)


def test_sizes_that_its_weights_contradict_are_refused_before_a_network_is_built(tmp_path):
    metadata = {
        **METADATA,
        "settings": {"network": {"widths": [8, 10**10]}, "training": {"epochs": 10**9}},
    }
    with pytest.raises(InputError, match="a: 'widths' is 10000000000, but it holds 6 weights"):
        read_checkpoint(saved(tmp_path / "a", metadata=metadata))


@pytest.mark.parametrize(
    ("weights", "reason"),
    [
        ({}, r"do not fit its network \(Missing key"),
        ({"weight": torch.zeros(3, 3), "bias": torch.zeros(2)}, r"its network \(size mismatch"),
        (
            {"weight": torch.zeros(2, 3), "bias": torch.zeros(2), "more": torch.zeros(1)},
            r"its network \(Unexpected",
        ),
        (
            {"weight": torch.zeros(2, 3, dtype=torch.int64), "bias": torch.zeros(2)},
            "'weight' is of torch.int64, expected torch.float32",
        ),
        (
            {"weight": torch.zeros(2, 3), "bias": torch.zeros(2, dtype=torch.complex64)},
            "'bias' is of torch.complex64, expected torch.float32",
        ),
    ],
)
def test_weights_that_do_not_fit_their_network_are_named(weights, reason):
    network = torch.nn.Linear(3, 2)
    with pytest.raises(InputError, match=f"a: .*{reason}"):
        load_state(network, Checkpoint(weights, {}), "a")


class Toy(torch.nn.Module):
    def __init__(self, width):
        super().__init__()
        self.layer = torch.nn.Parameter(torch.zeros(2, width))


def build(metadata):
    return Toy(metadata["settings"]["network"]["width"])


def test_trained_networks_are_built_from_what_they_said(tmp_path):
    network = load_network(saved(tmp_path / "a"), "toy", build)
    assert network.layer.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert not network.training
    assert not network.layer.requires_grad


def test_networks_of_another_kind_are_refused(tmp_path):
    with pytest.raises(InputError, match="a: holds a 'toy' network, expected tale"):
        load_network(saved(tmp_path / "a"), "tale", build)


# ---- fewer bits


def test_large_tensors_are_stored_in_16_bits_and_read_in_32(tmp_path):
    few, many = SMALL - 1, SMALL
    ends = torch.tensor([-(2**15), 2**15 - 1]).int()
    whole = {
        "layer": torch.linspace(-7, 8, many).reshape(100, -1),
        "double": torch.linspace(0, 3, many, dtype=torch.float64),
        "bias": torch.linspace(-7, 8, few),
        "faces": ends.repeat(many // 2),
        "beyond": (ends + 1).repeat(many // 2),
        "count": torch.arange(many),
        "some": torch.arange(few).int(),
    }
    stored = {"layer": torch.float16, "double": torch.float16, "faces": torch.int16}
    read = {"layer": torch.float32, "double": torch.float32, "faces": torch.int32}
    metadata = {**METADATA, "space": [dict(whole), 0.1, "text", None]}
    write_checkpoint(tmp_path / "half", halve(whole), halve(metadata))
    kept = load_file(tmp_path / "half")
    assert len(kept) == 2 * len(whole)
    for name, value in kept.items():
        own = name.rpartition("/")[2]
        assert value.dtype == stored.get(own, whole[own].dtype)
    found = read_checkpoint(tmp_path / "half")
    assert found.metadata["space"][1:] == metadata["space"][1:]
    for tensors in (found.weights, found.metadata["space"][0]):
        for name, value in whole.items():
            assert tensors[name].dtype == read.get(name, value.dtype)
            expected = value.half() if stored.get(name) == torch.float16 else value
            assert torch.equal(tensors[name], expected.to(tensors[name].dtype))


@pytest.mark.parametrize("number", [70_000.0, -1e9])
def test_a_number_too_large_for_half_precision_is_refused(number):
    sentence = f"a weight is {abs(number):g}, expected at most 65504 in half precision"
    large = torch.full((SMALL,), 0.1)
    large[7] = number
    with pytest.raises(InputError, match=sentence.replace("+", r"\+")):
        halve({"layer": [{"bias": large}]})
    assert torch.equal(halve({"bias": large[1:]})["bias"], large[1:])
    assert torch.equal(halve([large.long()])[0], large.long())


# ---- files of torch


def saved_by_torch(path, *, legacy=False, **weights):
    state = {"layer": torch.arange(6.0).reshape(2, 3), **weights}
    torch.save(state, path, _use_new_zipfile_serialization=not legacy)
    return path


@pytest.mark.parametrize("legacy", [False, True])
def test_honest_files_of_both_formats_are_read(tmp_path, legacy):
    found = read_torch_file(saved_by_torch(tmp_path / "a.pth", legacy=legacy))
    assert found["layer"].tolist() == [[0, 1, 2], [3, 4, 5]]


@pytest.mark.parametrize(
    ("tensor", "reason"),
    [
        (torch.eye(3).to_sparse(), "is sparse or without numbers"),
        (torch.zeros(3, device="meta"), "is sparse or without numbers"),
        (torch.zeros(3, dtype=torch.uint64), "is of torch.uint64, expected plain numbers"),
    ],
)
def test_tensors_that_no_network_has_are_refused(tmp_path, tensor, reason):
    torch.save({"bias": tensor}, tmp_path / "a.ckpt")
    with pytest.raises(InputError, match=rf"a\.ckpt: 'bias' {reason}"):
        read_torch_file(tmp_path / "a.ckpt")


def test_the_best_loss_of_a_training_may_be_infinite_but_no_weight(tmp_path):
    for weight in (1.0, float("nan")):
        state = {"bias": torch.tensor(weight)}
        torch.save({"state_dict": state, "best": torch.tensor(float("inf"))}, tmp_path / "a.ckpt")
        if weight == 1.0:
            assert read_torch_file(tmp_path / "a.ckpt")["state_dict"] == state
    with pytest.raises(InputError, match=r"a\.ckpt: 'bias' holds NaN or infinity"):
        read_torch_file(tmp_path / "a.ckpt")


# A storage of more elements than there are, as a pickle gives their number; a tensor larger than
# its storage, as it gives the shape.
LIES = [(b"cpuq\x06K\x06", b"cpuq\x06J\xff\xff\xff\x00"), (b"K\x02K\x03", b"K\x02K\xff")]


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize(("honest", "lie"), LIES)
def test_a_tensor_reaches_no_further_than_its_file(tmp_path, legacy, honest, lie):
    path = saved_by_torch(tmp_path / "a.pth", legacy=legacy)
    if legacy:
        data = path.read_bytes()
        assert data.count(honest) == 1
        path.write_bytes(data.replace(honest, lie))
    else:
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        assert honest in members["a/data.pkl"]
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in members.items():
                archive.writestr(name, data.replace(honest, lie))
    with pytest.raises(InputError, match=r"a\.pth: not readable as a checkpoint of plain weights"):
        read_torch_file(path)


def test_a_tensor_that_repeats_its_numbers_beyond_its_file_is_refused(tmp_path):
    path = saved_by_torch(tmp_path / "a.pth", wide=torch.ones(1).expand(1 << 40))
    with pytest.raises(InputError, match=r"a\.pth: 'wide' is of 1099511627776 numbers"):
        read_torch_file(path)


class Payload:
    def __reduce__(self):
        return print, ("ran",)


def test_a_refused_object_is_named_without_advice_to_load_it_all_the_same(tmp_path):
    torch.save({"layer": Payload()}, tmp_path / "a.pth")
    with pytest.raises(InputError, match=r"a\.pth: asks Python to run or build 'print'") as caught:
        read_torch_file(tmp_path / "a.pth")
    assert "weights_only" not in str(caught.value)
    assert "trust" not in str(caught.value)


def test_a_digest_tells_names_shapes_types_and_contents_apart(monkeypatch):
    array = np.arange(12, dtype=np.int32).reshape(4, 3)
    others = [
        {"b": array},
        {"a": array.reshape(3, 4)},
        {"a": array.astype(np.uint32)},
        {"a": array + np.eye(4, 3, dtype=np.int32)},
        {"a": array, "b": array},
    ]
    found = {arrays_digest(arrays) for arrays in ({"a": array}, *others)}
    assert len(found) == 1 + len(others)
    assert arrays_digest({"b": array, "a": array}) == arrays_digest({"a": array, "b": array})
    strided = np.stack([array, array])[:, ::2]
    assert arrays_digest({"a": strided}) == arrays_digest({"a": strided.copy()})
    # A large array: every second row.
    monkeypatch.setattr(checkpoints, "_DIGESTED_BYTES", array.nbytes // 2)
    for row, same in ((1, True), (2, False)):
        changed = array.copy()
        changed[row] += 1
        assert (arrays_digest({"a": changed}) == arrays_digest({"a": array})) is same
