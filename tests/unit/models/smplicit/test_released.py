import pickle

import pytest
import torch

from drapeline.errors import InputError
from drapeline.models.smplicit.decoder import (
    FieldDecoder,
    export_released,
    load_released,
    released_weights,
)

# Clusters, numbers of z_cut and of z_style, and of all weights, of the released models.
SIZES = {
    **dict.fromkeys(("upper", "pants", "skirts", "hair"), (500, 6, 12, 577_778)),
    "shoes": (100, 0, 4, 421_282),
}


def released_state(clusters, cut, style):
    """Random tensors of the shapes that FACTS of the released checkpoints list."""
    rng = torch.Generator().manual_seed(0)
    sizes = {
        "fc0_cloth": (128, style),
        "fc1_cloth": (128, 128),
        "fc0_query": (128, 3 * clusters, 1),
        "fc1_query": (256, 128, 1),
        "fc0": (312, 384 + cut, 1),
        "fc1": (312, 312, 1),
        "fc2": (256, 312, 1),
        "fc3": (128, 256, 1),
        "fc4": (1, 128, 1),
    }
    state = {}
    for name, (outputs, inputs, *one) in sizes.items():
        state[f"{name}.bias"] = torch.randn(outputs, generator=rng)
        state[f"{name}.weight_g"] = torch.rand(outputs, 1, *one, generator=rng)
        state[f"{name}.weight_v"] = torch.randn(outputs, inputs, *one, generator=rng)
    return state


@pytest.mark.parametrize("name", SIZES)
def test_released_checkpoints_load_and_come_back(tmp_path, name):
    clusters, cut, style, count = SIZES[name]
    state = released_state(clusters, cut, style)
    torch.save(state, tmp_path / "released.pth")
    decoder = load_released(tmp_path / "released.pth")
    assert (decoder.clusters, decoder.cut, decoder.style) == (clusters, cut, style)
    assert sum(value.numel() for value in decoder.parameters()) == count
    written = released_weights(decoder, 1.0)
    assert set(written) == set(state)
    for key, value in state.items():
        assert torch.equal(written[key], value), key
    points = torch.zeros(1, 2, 3)
    codes = torch.zeros(1, cut), torch.zeros(1, style)
    assert decoder(points, torch.zeros(1, clusters, 3), *codes).shape == (1, 2)


def test_exported_decoders_give_metres(tmp_path):
    decoder = FieldDecoder(20, 6, 12, rng=torch.Generator().manual_seed(1))
    export_released(tmp_path / "own.pth", decoder, 0.03)
    rng = torch.Generator().manual_seed(2)
    given = [torch.randn(1, *shape, generator=rng) for shape in ((4, 3), (20, 3), (6,), (12,))]
    torch.testing.assert_close(load_released(tmp_path / "own.pth")(*given), 0.03 * decoder(*given))


class Payload:
    def __reduce__(self):
        return print, ("executed",)


def test_files_that_execute_are_refused(tmp_path, capsys):
    path = tmp_path / "bad.pth"
    path.write_bytes(pickle.dumps({"fc0.bias": Payload()}))
    with pytest.raises(InputError, match=r"bad\.pth: not readable as a checkpoint"):
        load_released(path)
    torch.save({"fc0.bias": Payload()}, path)
    with pytest.raises(InputError, match=r"bad\.pth: asks Python to run or build 'print'"):
        load_released(path)
    assert "executed" not in capsys.readouterr().out


def test_other_weights_are_refused_in_a_sentence(tmp_path):
    path = tmp_path / "bad.pth"
    state = released_state(10, 6, 12)
    torch.save([1], path)
    with pytest.raises(InputError, match="holds no weights by name"):
        load_released(path)
    torch.save({k: v for k, v in state.items() if k != "fc0.weight_v"}, path)
    with pytest.raises(InputError, match=r"lacks a matrix 'fc0\.weight_v'"):
        load_released(path)
    torch.save({**state, "fc2.bias": torch.zeros(3)}, path)
    with pytest.raises(InputError, match=r"'fc2\.bias' has shape \(3,\), expected \(256,\)"):
        load_released(path)
    torch.save({k: v for k, v in state.items() if k != "fc1_query.bias"}, path)
    with pytest.raises(InputError, match=r"'fc1_query\.bias'"):
        load_released(path)
