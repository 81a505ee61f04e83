"""Trained garment VAEs from their checkpoint files."""

from pathlib import Path

from drapeline.errors import InputError
from drapeline.models.gcvae.body_template import BodyTemplate
from drapeline.models.gcvae.ppca_vae import LinearDynamicVae, LinearVae
from drapeline.models.gcvae.vae import DynamicVae, GarmentVae, StaticVae, VaeSettings
from drapeline.models.training.checkpoints import read_checkpoint

_KINDS = {cls.kind: cls for cls in (StaticVae, DynamicVae, LinearVae, LinearDynamicVae)}


def load_vae(path: str | Path) -> GarmentVae:
    """A trained SVAE or DVAE, ready to encode and decode.

    Raises:
        InputError: see `read_checkpoint`.
    """
    checkpoint = read_checkpoint(path)
    about = checkpoint["drapeline"]
    if about["kind"] not in _KINDS:
        raise InputError(
            f"{path}: holds a '{about['kind']}' network, expected {' or '.join(_KINDS)}"
        )
    settings = VaeSettings.of(about["settings"])
    model = _KINDS[about["kind"]](settings, BodyTemplate.from_tensors(about["body_template"]))
    model.load_state_dict(checkpoint["state_dict"])
    return model.eval()
