"""The decoder C(P_beta, z_cut, z_style): distances of points to a garment (SMPLicit 3.2, 5).

Sizes, order of layers and names of weights are those of the released network, so its checkpoints
can be loaded. Like it, and unlike the paper's text, the decoder takes z_cut as it is.

B garments, P points, K clusters of the body.
"""

from itertools import pairwise
from typing import NamedTuple

import torch
from torch.nn import functional

from drapeline.models.layers.precision import full_precision

STYLE_WIDTHS = (128, 128)
QUERY_WIDTHS = (128, 256)
WIDTHS = (312, 312, 256, 128)


class WeightNormLinear(torch.nn.Module):
    """A linear layer with weight normalisation (Salimans and Kingma 2016).

    Its parameters are named as `torch.nn.utils.weight_norm` names them.

    Args:
        inputs, outputs: sizes.
        rng: draws the weights.
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
    """What the decoder computes once per garment.

    Attributes:
        query_weight: (B or 1, H, 3) of the first query layer, for the point alone.
        query_bias: (B or 1, H) with what the clusters add.
        base: (B, H0) what style and cut add to the first joint layer.
    """

    query_weight: torch.Tensor
    query_bias: torch.Tensor
    base: torch.Tensor


class Decoder(torch.nn.Module):
    """Unsigned distance of points to the garment of a code.

    Args:
        clusters: K.
        cut, style: numbers of the two codes.
        width: of hidden layers, as a share of the released network's.
        rng: draws the weights.
    """

    def __init__(
        self,
        clusters: int,
        cut: int,
        style: int,
        *,
        width: float = 1.0,
        rng: torch.Generator,
    ) -> None:
        super().__init__()
        style_1, style_2, query_1, query_2, *joint = (
            max(round(width * size), 4) for size in (*STYLE_WIDTHS, *QUERY_WIDTHS, *WIDTHS)
        )
        self.clusters, self.cut, self.style = clusters, cut, style
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
        """What does not depend on the points; see `forward`."""
        return Conditioned(*self.fold(places), self.base(z_cut, z_style))

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
        """(B, P, H0) what points add to the first joint layer.

        Args:
            points: (B, P, 3).
            weight, bias: of `fold`.
        """
        return self.query_of(points @ weight.mT + bias[:, None])

    def query_of(self, first: torch.Tensor) -> torch.Tensor:
        """The same for sums (B, P, H) of the first query layer, before its ReLU."""
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
        """Weights (inputs, outputs) and biases (outputs,) that points of a garment pass through.

        There is a ReLU between one layer and the next.

        Args:
            given: of one garment.
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
