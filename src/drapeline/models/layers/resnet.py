"""ResNet-18 (He et al. 2016), of any width and for images of any number of channels.

Names of weights are torchvision's.
"""

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

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


class ResNet18(nn.Module):
    """Numbers of images.

    Args:
        channels: of an image.
        outputs: numbers for each.
        width: channels of the first stage, which doubles in each of the three that follow.
    """

    def __init__(self, channels: int, outputs: int, width: int, rng: torch.Generator) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels, width, 7, 2, 3, bias=False)
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
        # Outputs start near zero, as codes do.
        nn.init.normal_(self.fc.weight, std=1e-2, generator=rng)
        nn.init.zeros_(self.fc.bias)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(B, outputs) of images (B, channels, H, W)."""
        x = functional.relu(self.bn1(self.conv1(images)))
        x = functional.max_pool2d(x, 3, 2, 1)
        for stage in range(1, 5):
            x = getattr(self, f"layer{stage}")(x)
        return self.fc(x.mean((2, 3)))
