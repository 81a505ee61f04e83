"""A trained model that finds the codes of garments in what is seen of them.

    from drapeline.models.load import load

    upper = load("results/smplicit/upper")
    garment = upper.fit_image(shown, camera, gender="female", shape=shape, pose=pose, trans=trans)

It is what `load` returns; rules that only decode use `SmplicitModel`.
"""

from collections.abc import Sequence

import numpy as np

from drapeline.bodies.follow import pose_body
from drapeline.bodies.rest_body import SHAPES
from drapeline.models.smplicit.fit_images import FitImage
from drapeline.models.smplicit.fit_pictures import (
    FittedGarment,
    View,
    Wearer,
    dress,
    fit_codes_to_views,
)
from drapeline.models.smplicit.model import Meshing, SmplicitModel, check_gender, finite
from drapeline.rendering.camera import Camera


class FittingModel(SmplicitModel):
    """A trained model with its fits; see `SmplicitModel`."""

    def fit_image(
        self,
        shown: np.ndarray,
        camera: Camera,
        *,
        gender: str,
        shape: Sequence[float],
        pose: Sequence[float],
        trans: Sequence[float],
        unsure: np.ndarray | None = None,
        seed: int = 0,
    ) -> FittedGarment:
        """The garment that a picture shows on a known body; see `fit_pictures` for whole pictures.

        Args:
            shown: (H, W) bool, the garment's pixels.
            camera: of the picture.
            gender, shape: of the wearer.
            pose: (72,) axis-angle, rad; its root rotation leads to the world of the camera.
            trans: (3,) the root joint there, metres.
            unsure: (H, W) bool, pixels that tell nothing about the garment, such as those of what
                hides it.
            seed: of the points that the fit looks at.

        Raises:
            InputError: an argument has another size, no pixel shows the garment, or those that do
                are not near the body.
        """
        wearer = Wearer(gender, finite("shape", shape, SHAPES))
        check_gender(gender)
        at = finite("pose", pose, 72), finite("trans", trans, 3)
        body = pose_body(self.bodies[gender], wearer.shape, *at)
        unsure = np.zeros_like(shown) if unsure is None else unsure
        views, settings = [View(shown, unsure, camera, body)], FitImage()
        (z,) = fit_codes_to_views(self, views, [wearer], [self.name], settings, seed)
        return dress(body, wearer, {self.name: (self, z)}, settings.wearing, Meshing())[self.name]
