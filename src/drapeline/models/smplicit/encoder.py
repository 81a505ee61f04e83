"""The image encoder f: from occlusion images to z_cut (SMPLicit 3.2), a ResNet-18.

Names of weights are torchvision's, so a local file of its weights can be the start.
"""

from pathlib import Path

import torch

from drapeline.errors import InputError
from drapeline.models.layers.resnet import ResNet18
from drapeline.models.training.checkpoints import read_torch_file

_COLOURS = 3  # as torchvision's weights expect


class ImageEncoder(ResNet18):
    """Codes of occlusion images.

    Args:
        outputs: numbers of a code.
        width: channels of the first stage.
    """

    def __init__(self, outputs: int, width: int, rng: torch.Generator) -> None:
        super().__init__(_COLOURS, outputs, width, rng)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(B, outputs) codes of images (B, R, R), 1 where the garment covers the body."""
        grey = (2.0 * images.to(self.fc.weight) - 1.0)[:, None]
        return super().forward(grey.expand(-1, _COLOURS, -1, -1))


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
