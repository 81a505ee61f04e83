"""Models of this room from their checkpoint files."""

from pathlib import Path

from drapeline.errors import InputError
from drapeline.models.gcvae.body_template import BodyTemplate
from drapeline.models.gcvae.codec import GarmentCodec
from drapeline.models.gcvae.garment_ppca import DynamicPpca, StaticPpca
from drapeline.models.gcvae.vae import DynamicVae, StaticVae
from drapeline.models.training.checkpoints import building, load_state, read_checkpoint

_CLASSES: dict[str, type[GarmentCodec]] = {
    cls.checkpoint_type: cls for cls in (StaticVae, DynamicVae, StaticPpca, DynamicPpca)
}


def load_codec(path: str | Path) -> GarmentCodec:
    """A trained VAE or a fitted PCA, ready to encode and decode.

    Args:
        path: of a checkpoint.

    Raises:
        InputError: see `read_checkpoint`; or the checkpoint is of another type of network.
    """
    checkpoint = read_checkpoint(path)
    metadata = checkpoint.metadata
    checkpoint_type = metadata["checkpoint_type"]
    if checkpoint_type not in _CLASSES:
        raise InputError(
            f"{path}: holds a '{checkpoint_type}' network, expected {' or '.join(_CLASSES)}"
        )
    cls = _CLASSES[checkpoint_type]
    with building(path):
        template = BodyTemplate.from_tensors(metadata["body_template"])
        model = cls(cls.SETTINGS(**metadata["settings"]), template)
    load_state(model, checkpoint, path)
    return model.eval()
