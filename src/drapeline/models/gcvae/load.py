"""Trained garment VAEs from their checkpoint files."""

from pathlib import Path

from drapeline.errors import InputError
from drapeline.models.gcvae.body_template import BodyTemplate
from drapeline.models.gcvae.ppca_vae import DynamicPpcaVae, StaticPpcaVae
from drapeline.models.gcvae.settings import VaeSettings
from drapeline.models.gcvae.vae import DynamicVae, GarmentVae, StaticVae
from drapeline.models.training.checkpoints import read_checkpoint

_CLASSES: dict[str, type[GarmentVae]] = {
    cls.checkpoint_type: cls for cls in (StaticVae, DynamicVae, StaticPpcaVae, DynamicPpcaVae)
}


def load_vae(path: str | Path) -> GarmentVae:
    """A trained SVAE or DVAE, ready to encode and decode.

    Args:
        path: of a checkpoint.

    Raises:
        InputError: see `read_checkpoint`; or the checkpoint is of another type of network.
    """
    checkpoint = read_checkpoint(path)
    about = checkpoint["drapeline"]
    checkpoint_type = about["checkpoint_type"]
    if checkpoint_type not in _CLASSES:
        raise InputError(
            f"{path}: holds a '{checkpoint_type}' network, expected {' or '.join(_CLASSES)}"
        )
    settings = VaeSettings.of(about["settings"])
    template = BodyTemplate.from_tensors(about["body_template"])
    model = _CLASSES[checkpoint_type](settings, template)
    model.load_state_dict(checkpoint["state_dict"])
    return model.eval()
