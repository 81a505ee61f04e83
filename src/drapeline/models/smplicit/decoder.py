"""The decoder C(P_beta, z_cut, z_style): distances of points to a garment (SMPLicit 3.2, 5).

Sizes, order of layers and names of weights are those of the released network, so its checkpoints
can be loaded. Like it, and unlike the paper's text, the decoder takes z_cut as it is.

B garments, P points, K clusters of the body.
"""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import torch
from torch.nn import functional

from drapeline.errors import InputError
from drapeline.models.layers.linear import full_precision
from drapeline.models.training.checkpoints import read_torch_file, write_torch_file

STYLE_WIDTHS = (128, 128)
QUERY_WIDTHS = (128, 256)
WIDTHS = (312, 312, 256, 128)
# There, the layers that see points are convolutions over them, with one more dimension.
_STYLE_LAYERS = ("fc0_cloth", "fc1_cloth")
_LAST = "fc4"
# Layers that tell the sizes of the others.
_SIZED = ("fc0_cloth", "fc1_cloth", "fc0_query", "fc1_query", "fc0")


class WeightNormLinear(torch.nn.Module):
    """A linear layer with weight normalisation (Salimans and Kingma 2016).

    Its parameters are named as `torch.nn.utils.weight_norm` names them.
    """

    def __init__(self, inputs: int, outputs: int, rng: torch.Generator) -> None:
        super().__init__()
        bound = inputs**-0.5
        weight = torch.empty(outputs, inputs).uniform_(-bound, bound, generator=rng)
        self.bias = torch.nn.Parameter(torch.empty(outputs).uniform_(-bound, bound, generator=rng))
        self.weight_g = torch.nn.Parameter(weight.norm(dim=1, keepdim=True))
        self.weight_v = torch.nn.Parameter(weight)

    @property
    def weight(self) -> torch.Tensor:
        """(outputs, inputs)."""
        return self.weight_v * (self.weight_g / self.weight_v.norm(dim=1, keepdim=True))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(..., outputs) of (..., inputs)."""
        return functional.linear(x, self.weight, self.bias)


class Conditioned(NamedTuple):
    """The part of the decoder that is computed once per garment."""

    query_weight: torch.Tensor  # (B or 1, H, 3) of the first query layer, for the point alone
    query_bias: torch.Tensor  # (B or 1, H) with what the clusters add
    base: torch.Tensor  # (B, H0) what style and cut add to the first joint layer


class FieldDecoder(torch.nn.Module):
    """Unsigned distance of points to the garment of a code.

    Args:
        clusters: K.
        cut, style: numbers of the two codes.
        width: of hidden layers, as a share of the released network's.
    """

    def __init__(
        self, clusters: int, cut: int, style: int, *, width: float = 1.0, rng: torch.Generator
    ) -> None:
        super().__init__()
        style_1, style_2, query_1, query_2, *joint = (
            max(round(width * size), 4) for size in (*STYLE_WIDTHS, *QUERY_WIDTHS, *WIDTHS)
        )
        self.clusters, self.cut, self.style = clusters, cut, style
        self.fc0: WeightNormLinear
        self.fc0_cloth = WeightNormLinear(style, style_1, rng)
        self.fc1_cloth = WeightNormLinear(style_1, style_2, rng)
        self.fc0_query = WeightNormLinear(3 * clusters, query_1, rng)
        self.fc1_query = WeightNormLinear(query_1, query_2, rng)
        sizes = [style_2 + query_2 + cut, *joint, 1]
        for index, (inputs, outputs) in enumerate(pairwise(sizes)):
            setattr(self, f"fc{index}", WeightNormLinear(inputs, outputs, rng))
        self._style_size, self._joint = style_2, len(joint)

    def forward(
        self, points: torch.Tensor, places: torch.Tensor, z_cut: torch.Tensor, z_style: torch.Tensor
    ) -> torch.Tensor:
        """(B, P) distances, in the unit that it was trained in; may be slightly negative.

        Args:
            points: (B or 1, P, 3) metres, in the rest pose.
            places: (B or 1, K, 3) of the body's clusters.
            z_cut, z_style: (B, cut) and (B, style).
        """
        return self.distances(points, self.condition(places, z_cut, z_style))

    @full_precision
    def fold(self, places: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The first query layer as a function of the point alone: weight (1, H, 3), bias (B, H).

        The encoding P - v_k (3.2) is affine in the point, so K offsets fold into three inputs.
        """
        weight = self.fc0_query.weight
        by_cluster = weight.unflatten(1, (self.clusters, 3))
        return by_cluster.sum(1)[None], self.fc0_query.bias - places.flatten(1) @ weight.T

    def condition(
        self, places: torch.Tensor, z_cut: torch.Tensor, z_style: torch.Tensor
    ) -> Conditioned:
        """The part that does not depend on the points; see `forward`."""
        weight, bias = self.fold(places)
        return Conditioned(weight, bias, self.base(z_cut, z_style))

    def base(self, z_cut: torch.Tensor, z_style: torch.Tensor) -> torch.Tensor:
        """(B, H0) what codes add to the first joint layer; all that depends on them."""
        style = self.fc1_cloth(torch.relu(self.fc0_cloth(z_style)))
        weight, _ = self._joint_split()
        return torch.cat([torch.relu(style), z_cut], 1) @ weight.T + self.fc0.bias

    def base_slopes(self, z_style: torch.Tensor) -> torch.Tensor:
        """(B, H0, cut + style) derivatives of `base` by the numbers of the codes."""
        first = self.fc0_cloth(z_style)
        second = self.fc1_cloth(torch.relu(first))
        slopes = (first > 0)[..., None] * self.fc0_cloth.weight
        slopes = (second > 0)[..., None] * (self.fc1_cloth.weight @ slopes)
        by_style, by_cut = self._joint_split()[0].split([self._style_size, self.cut], 1)
        return torch.cat([by_cut.expand(len(slopes), -1, -1), by_style @ slopes], 2)

    def distances(self, points: torch.Tensor, given: Conditioned) -> torch.Tensor:
        """(B, P) distances of points (B or 1, P, 3) for what `condition` gave."""
        query = self.query(points, given.query_weight, given.query_bias)
        return self.joint(query + given.base[:, None])

    def query(self, points: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
        """(B, P, H0) what points (B, P, 3) add to the first joint layer; see `fold`."""
        return self.query_of(points @ weight.mT + bias[:, None])

    def query_of(self, first: torch.Tensor) -> torch.Tensor:
        """`query` of sums (B, P, H) of the first query layer, before its ReLU."""
        query = torch.relu(self.fc1_query(torch.relu(first)))
        _, weight = self._joint_split()
        return query @ weight.T

    def joint(self, hidden: torch.Tensor) -> torch.Tensor:
        """(..., ) distances for sums (..., H0) of what points and codes add."""
        hidden = torch.relu(hidden)
        for index in range(1, self._joint):
            hidden = torch.relu(getattr(self, f"fc{index}")(hidden))
        return getattr(self, f"fc{self._joint}")(hidden).squeeze(-1)

    def layers(self, given: Conditioned) -> list[tuple[torch.Tensor, torch.Tensor]]:
        """Weights (inputs, outputs) and biases (outputs,) that points of one garment pass through.

        There is a ReLU between one layer and the next.
        """
        _, query = self._joint_split()
        later = [self.fc1_query, *(getattr(self, f"fc{k}") for k in range(1, self._joint + 1))]
        (second, *rest) = [(layer.weight.T, layer.bias) for layer in later]
        first = (given.query_weight[0].T, given.query_bias[0])
        return [first, second, (query.T, given.base[0]), *rest]

    def _joint_split(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Columns of the first joint layer for style and cut, and for the query.

        It takes style, query and cut one after another.
        """
        weight, end = self.fc0.weight, self._style_size
        style, query, cut = weight.split([end, weight.shape[1] - end - self.cut, self.cut], 1)
        return torch.cat([style, cut], 1), query


def load_released(path: str | Path) -> FieldDecoder:
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
    decoder = FieldDecoder(
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


def export_released(path: str | Path, decoder: FieldDecoder, unit_m: float) -> None:
    """Write a decoder as the released code saves its own; its distances are in metres.

    Args:
        decoder: of the released sizes, if the released code is to load it.
        unit_m: metres per unit of the decoder's distances.
    """
    write_torch_file(path, released_weights(decoder, unit_m))


def released_weights(decoder: FieldDecoder, unit_m: float) -> Mapping[str, torch.Tensor]:
    """The weights by their released names and in their released shapes; see `export_released`."""
    state = {name: value.detach().clone() for name, value in decoder.state_dict().items()}
    for name in (f"{_LAST}.weight_g", f"{_LAST}.bias"):
        state[name] *= unit_m
    return {
        name: value if name.split(".")[0] in _STYLE_LAYERS or value.ndim == 1 else value[..., None]
        for name, value in state.items()
    }
