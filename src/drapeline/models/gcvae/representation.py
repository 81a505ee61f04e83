"""Garments as offsets from the body, without a code and through the codes of VAEs and PCA."""

from collections.abc import Iterator, Sequence

import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.static import StaticData
from drapeline.metrics.baselines import fit_pca
from drapeline.metrics.garment import garment_mesh
from drapeline.metrics.registered import Prediction
from drapeline.models.contract import HeldOutGarment
from drapeline.models.gcvae.body_template import BodyTemplate
from drapeline.models.gcvae.codec import GarmentCodec
from drapeline.models.gcvae.codes import decode_codes, encode_garments
from drapeline.models.gcvae.truth import static_truth


class RegisteredOffsets:
    """No code: offsets and mask as registered.

    Args:
        data: registered garments.
        template: its rest bodies are those that the offsets are added to.
    """

    variant = "body_registered"

    def __init__(self, data: StaticData, template: BodyTemplate) -> None:
        self.data, self._truth = data, static_truth(template, data)

    def code_numbers(self, garment: str) -> int | None:
        """None: there is no code."""

    def rebuild(self, garments: Sequence[HeldOutGarment]) -> Iterator[Mesh]:
        """Body plus offsets, within the mask."""
        predictions = self.predict(np.array([garment.row for garment in garments]))
        for garment, (offsets, mask) in zip(garments, predictions, strict=True):
            body, faces = self._truth.body(garment.row), self._truth.faces(garment.row)
            yield garment_mesh(body + offsets, faces, mask)

    def predict(self, rows: np.ndarray) -> Iterator[Prediction]:
        """Offsets and mask of rows."""
        return ((self.data.offsets[row], self.data.mask[row]) for row in rows)


class OffsetPca(RegisteredOffsets):
    """Principal components of the training rows' offsets, and the mask regressed on them.

    Args:
        components: at most.
    """

    variant = "body_pca"

    def __init__(self, data: StaticData, template: BodyTemplate, components: int) -> None:
        super().__init__(data, template)
        self._pca = fit_pca(data.offsets, data.mask, data.rows("train"), components)

    def code_numbers(self, garment: str) -> int:
        """The number of components."""
        return len(self._pca.axes)

    def predict(self, rows: np.ndarray) -> Iterator[Prediction]:
        """Offsets and mask of rows from their components."""
        return (self._pca.rebuild(self.data.offsets[row]) for row in rows)


class VaeCode(RegisteredOffsets):
    """The posterior mean of a trained static VAE.

    Args:
        variant: of the VAE.
        model: with a mask branch.
    """

    def __init__(self, variant: str, model: GarmentCodec, data: StaticData) -> None:
        super().__init__(data, model.body_template)
        self.variant, self._model = variant, model

    def code_numbers(self, garment: str) -> int:
        """The size of z."""
        return self._model.latent

    def predict(self, rows: np.ndarray) -> Iterator[Prediction]:
        """Offsets and mask of rows, encoded and decoded."""
        z = encode_garments(self._model, self.data, rows).mean
        return decode_codes(self._model, z, self.data.cvar(rows), self.data.topology(rows))
