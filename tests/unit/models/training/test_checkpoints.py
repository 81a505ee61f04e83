import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.training.checkpoints import load_network, load_state, read_checkpoint


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "no such file"), (b"not weights", "not readable as a checkpoint"), ({}, "drapeline")],
)
def test_what_is_no_checkpoint_of_ours_is_refused(tmp_path, content, message):
    path = tmp_path / "best.ckpt"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        torch.save(content, path)
    with pytest.raises(InputError, match=rf"best\.ckpt.*{message}"):
        read_checkpoint(path)


ABOUT = {"checkpoint_type": "toy", "settings": {"network": {"width": 3}}}


def saved(path, *, about=ABOUT, legacy=False, **weights):
    state = {"layer": torch.arange(6.0).reshape(2, 3), **weights}
    content = {"state_dict": state, "drapeline": about, "best": float("inf")}
    torch.save(content, path, _use_new_zipfile_serialization=not legacy)
    return path


@pytest.mark.parametrize("legacy", [False, True])
def test_honest_checkpoints_of_both_formats_are_read(tmp_path, legacy):
    wide = torch.ones(1).expand(1000)
    checkpoint = read_checkpoint(saved(tmp_path / "a.ckpt", legacy=legacy, wide=wide))
    assert checkpoint["state_dict"]["layer"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert checkpoint["state_dict"]["wide"].shape == (1000,)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_must_be_finite(tmp_path, value):
    path = saved(tmp_path / "a.ckpt", bias=torch.tensor([1.0, value]))
    with pytest.raises(InputError, match=r"a\.ckpt: 'bias' holds NaN or infinity"):
        read_checkpoint(path)


@pytest.mark.parametrize("legacy", [False, True])
def test_a_storage_that_is_smaller_than_it_says_is_refused(tmp_path, legacy):
    path = saved(tmp_path / "a.ckpt", legacy=legacy)
    data = path.read_bytes()
    assert data.count(b"X\x03\x00\x00\x00cpuq") == 1
    start = data.index(b"K\x06", data.index(b"X\x03\x00\x00\x00cpuq"))
    path.write_bytes(data[:start] + b"K\xff" + data[start + 2 :])
    with pytest.raises(InputError, match=r"a\.ckpt: not readable as a checkpoint of plain weights"):
        read_checkpoint(path)


def test_a_refused_object_is_named_without_advice_to_load_it_all_the_same(tmp_path):
    torch.save({"drapeline": Payload()}, tmp_path / "a.ckpt")
    with pytest.raises(InputError, match=r"a\.ckpt: asks Python to run or build 'print'") as caught:
        read_checkpoint(tmp_path / "a.ckpt")
    assert "weights_only" not in str(caught.value)
    assert "trust" not in str(caught.value)


class Payload:
    def __reduce__(self):
        return print, ("ran",)


def test_sizes_that_its_weights_contradict_are_refused_before_a_network_is_built(tmp_path):
    about = {
        **ABOUT,
        "settings": {"network": {"widths": [8, 10**10]}, "training": {"epochs": 10**9}},
    }
    with pytest.raises(
        InputError, match=r"a\.ckpt: 'widths' is 10000000000, but it holds 6 weights"
    ):
        read_checkpoint(saved(tmp_path / "a.ckpt", about=about))


@pytest.mark.parametrize("about", [{}, {"checkpoint_type": 3}, "x", None])
def test_a_checkpoint_says_what_it_is_of(tmp_path, about):
    with pytest.raises(InputError, match=r"a\.ckpt: not a checkpoint of drapeline"):
        read_checkpoint(saved(tmp_path / "a.ckpt", about=about))


@pytest.mark.parametrize(
    ("state", "reason"),
    [
        ({}, "Missing key"),
        ({"weight": torch.zeros(3, 3), "bias": torch.zeros(2)}, "size mismatch"),
        (
            {"weight": torch.zeros(2, 3), "bias": torch.zeros(2), "more": torch.zeros(1)},
            "Unexpected",
        ),
    ],
)
def test_weights_that_do_not_fit_their_network_are_named(state, reason):
    network = torch.nn.Linear(3, 2)
    with pytest.raises(
        InputError, match=rf"a\.ckpt: its weights do not fit its network \({reason}"
    ):
        load_state(network, {"state_dict": state}, "a.ckpt")


class Toy(torch.nn.Module):
    def __init__(self, width):
        super().__init__()
        self.layer = torch.nn.Parameter(torch.zeros(2, width))


def build(about):
    return Toy(about["settings"]["network"]["width"])


def test_trained_networks_are_built_from_what_they_said(tmp_path):
    network = load_network(saved(tmp_path / "a.ckpt"), "toy", build)
    assert network.layer.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert not network.training
    assert not network.layer.requires_grad


def test_networks_of_another_kind_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"a\.ckpt: holds a 'toy' network, expected tale"):
        load_network(saved(tmp_path / "a.ckpt"), "tale", build)
