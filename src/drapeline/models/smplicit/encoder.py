"""The image encoder f: from occlusion images to z_cut (SMPLicit 3.2), a ResNet-18 (He et al. 2016).

Names of weights are torchvision's, so a local file of its weights can be the start.
"""

from itertools import pairwise
from pathlib import Path

import torch
from torch import nn
from torch.nn import functional

from drapeline.errors import InputError
from drapeline.models.training.checkpoints import read_torch_file

_BLOCKS = 2  # per stage


class _Block(nn.Module):
    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.downsample = None
        if stride > 1:
            self.downsample = nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs)
            )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        beside = x if self.downsample is None else self.downsample(x)
        x = functional.relu(self.bn1(self.conv1(x)))
        return functional.relu(self.bn2(self.conv2(x)) + beside)


class ImageEncoder(nn.Module):
    """Codes of occlusion images.

    Args:
        outputs: numbers of a code.
        width: channels of the first stage, which doubles in each of the three that follow.
    """

    def __init__(self, outputs: int, width: int, rng: torch.Generator) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, width, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        sizes = [width, width, 2 * width, 4 * width, 8 * width]
        for stage, (before, after) in enumerate(pairwise(sizes), 1):
            blocks = [_Block(before, after, 1 if stage == 1 else 2)]
            blocks += [_Block(after, after, 1) for _ in range(_BLOCKS - 1)]
            setattr(self, f"layer{stage}", nn.Sequential(*blocks))
        self.fc = nn.Linear(sizes[-1], outputs)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(
                    module.weight, mode="fan_out", nonlinearity="relu", generator=rng
                )
        # Codes start near zero, where the decoder's noise and prior expect them.
        nn.init.normal_(self.fc.weight, std=1e-2, generator=rng)
        nn.init.zeros_(self.fc.bias)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(B, outputs) codes of images (B, R, R), 1 where the garment covers the body."""
        x = (2.0 * images.to(self.fc.weight) - 1.0)[:, None].expand(-1, 3, -1, -1)
        x = functional.relu(self.bn1(self.conv1(x)))
        x = functional.max_pool2d(x, 3, 2, 1)
        for stage in range(1, 5):
            x = getattr(self, f"layer{stage}")(x)
        return self.fc(x.mean((2, 3)))


def load_encoder_weights(encoder: ImageEncoder, path: str | Path) -> None:
    """Start an encoder from a file of torchvision's ResNet-18, but for its last layer.

    Raises:
        InputError: the file is missing, is not readable as plain weights, or has other names or
            shapes.
    """
    state = read_torch_file(path)
    if not isinstance(state, dict):
        raise InputError(f"{path}: holds no weights by name, expected those of a ResNet-18")
    state = {name: value for name, value in state.items() if not name.startswith("fc.")}
    own = {name: value for name, value in encoder.state_dict().items() if name[:3] != "fc."}
    wrong = sorted(
        name
        for name, value in own.items()
        if not isinstance(state.get(name), torch.Tensor) or state[name].shape != value.shape
    )
    if wrong:
        raise InputError(
            f"{path}: lacks '{wrong[0]}' of shape {tuple(own[wrong[0]].shape)}, expected weights of"
            f" a ResNet-18 of width {encoder.conv1.out_channels}"
        )
    encoder.load_state_dict({name: state[name] for name in own}, strict=False)
