"""The decoder's weights in the form of SMPLicit's released checkpoints, read and written."""

from collections.abc import Mapping
from pathlib import Path

import torch

from drapeline.errors import InputError
from drapeline.models.smplicit.decoder import Decoder
from drapeline.models.training.checkpoints import read_torch_file, write_torch_file

# There, the layers that see points are convolutions over them, with one more dimension.
_STYLE_LAYERS = ("fc0_cloth", "fc1_cloth")
_LAST = "fc4"
# Layers that tell the sizes of the others.
_SIZED = ("fc0_cloth", "fc1_cloth", "fc0_query", "fc1_query", "fc0")


def load_released(path: str | Path) -> Decoder:
    """A decoder from a checkpoint of the released code, of any of its garments.

    The sizes are read off the weights. Its distances are in the unit that the file was trained in,
    which the released code does not state. Checkpoints of hair and shoes load like those of
    garments, though drapeline has no data to train them on.

    Raises:
        InputError: the file is missing, executes code, or lacks a weight of the expected shape.
    """
    state = read_torch_file(path)
    if not isinstance(state, dict):
        raise InputError(f"{path}: holds no weights by name, expected a checkpoint of SMPLicit")
    state = {
        name: value.squeeze(-1)
        if name.endswith(("weight_g", "weight_v")) and value.ndim == 3
        else value
        for name, value in state.items()
        if isinstance(value, torch.Tensor)
    }
    shapes = {name: tuple(value.shape) for name, value in state.items()}
    for name in _SIZED:
        if len(shapes.get(f"{name}.weight_v", ())) != 2:
            raise InputError(
                f"{path}: lacks a matrix '{name}.weight_v', expected a checkpoint of SMPLicit"
            )
    style_2, query_2 = (shapes[f"{name}.weight_v"][0] for name in ("fc1_cloth", "fc1_query"))
    decoder = Decoder(
        shapes["fc0_query.weight_v"][1] // 3,
        shapes["fc0.weight_v"][1] - style_2 - query_2,
        shapes["fc0_cloth.weight_v"][1],
        rng=torch.Generator(),
    )
    expected = {name: tuple(value.shape) for name, value in decoder.state_dict().items()}
    for name, shape in expected.items():
        if shapes.get(name) != shape:
            raise InputError(f"{path}: '{name}' has shape {shapes.get(name)}, expected {shape}")
    decoder.load_state_dict({name: state[name] for name in expected})
    return decoder.eval()


def export_released(path: str | Path, decoder: Decoder, unit_m: float) -> None:
    """Write a decoder as the released code saves its own; its distances are in metres.

    Args:
        path: of the checkpoint.
        decoder: of the released sizes, if the released code is to load it.
        unit_m: metres per unit of the decoder's distances.
    """
    write_torch_file(path, released_weights(decoder, unit_m))


def released_weights(decoder: Decoder, unit_m: float) -> Mapping[str, torch.Tensor]:
    """The weights by their released names and in their released shapes; see `export_released`."""
    state = {name: value.detach().clone() for name, value in decoder.state_dict().items()}
    for name in (f"{_LAST}.weight_g", f"{_LAST}.bias"):
        state[name] *= unit_m
    return {
        name: value if name.split(".")[0] in _STYLE_LAYERS or value.ndim == 1 else value[..., None]
        for name, value in state.items()
    }
