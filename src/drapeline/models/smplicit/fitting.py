"""A trained model that finds the codes of garments in what is seen of them.

    from drapeline.models.load import load

    upper = load("results/smplicit/upper")
    garment = upper.fit_image(shown, camera, gender="female", shape=shape, pose=pose, trans=trans)

It is what `load` returns; rules that only decode use `SmplicitModel`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drapeline.bodies.follow import pose_body
from drapeline.bodies.rest_body import SHAPES
from drapeline.bodies.settings import BodyFit
from drapeline.dataset.scans import to_scans
from drapeline.dataset.segmented_scans import segment_scans
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.models.smplicit.fit_images import wearing
from drapeline.models.smplicit.fit_pictures import (
    FittedGarment,
    Sought,
    View,
    Wearer,
    dress,
    fit_codes_to_views,
)
from drapeline.models.smplicit.hanging import Hang, hang_person
from drapeline.models.smplicit.model import SmplicitModel, check_gender, finite
from drapeline.models.smplicit.own_scans import find_garments
from drapeline.models.smplicit.pictures import Person, class_of_garment
from drapeline.models.smplicit.settings import FitImage, FitScan, Meshing
from drapeline.rendering.camera import Camera


class ScannedGarment(NamedTuple):
    """A garment that a scan shows, and the body under it.

    Attributes:
        garment: code, sheet at rest, and sheet as worn.
        moved: the worn sheet, moved to the points.
        pose: (72,) axis-angles of the body, rad.
        trans: (3,) its root joint, metres.
        shape: (10,).
    """

    garment: FittedGarment
    moved: Mesh
    pose: np.ndarray
    trans: np.ndarray
    shape: np.ndarray


class FittingModel(SmplicitModel):
    """A trained model with its fits; see `SmplicitModel`."""

    def fit_image(
        self,
        shown: np.ndarray,
        camera: Camera,
        garment: str | None = None,
        *,
        gender: str,
        shape: Sequence[float],
        pose: Sequence[float],
        trans: Sequence[float],
        unsure: np.ndarray | None = None,
        seed: int = 0,
        hang: Hang | None = None,
    ) -> FittedGarment:
        """The garment that a picture shows on a known body; see `fit_pictures` for whole pictures.

        Args:
            shown: (H, W) bool, the garment's pixels.
            camera: of the picture.
            garment: its type, any of `garments` if None.
            gender, shape: of the wearer.
            pose: (72,) axis-angle, rad; its root rotation leads to the world of the camera.
            trans: (3,) the root joint there, metres.
            unsure: (H, W) bool, pixels that tell nothing about the garment, such as those of what
                hides it.
            seed: of the points that the fit looks at.
            hang: hangs its sheet on the body, see `drapeline.generation.moving_sheets.make_hang`;
                what is upright in the picture is taken for upright. Skinned if None.

        Raises:
            InputError: an argument has another size, the model is not for that type, no pixel shows
                the garment, or those that do are not near the body.
        """
        wearer = Wearer(gender, finite("shape", shape, SHAPES))
        check_gender(gender)
        at = finite("pose", pose, 72), finite("trans", trans, 3)
        body = pose_body(self.bodies[gender], wearer.shape, *at)
        unsure = np.zeros_like(shown) if unsure is None else unsure
        if garment is not None and garment not in self.garments:
            raise InputError(
                f"garment: {garment!r:.60}, expected one of {', '.join(self.garments)}"
            )
        codes = self.codes.z if garment is None else self.codes_of(garment)
        view, settings, meshing = View(shown, unsure, camera, body), FitImage(), Meshing()
        (z,) = fit_codes_to_views(self, codes, [view], [wearer], [self.name], settings, seed)
        name = class_of_garment(garment or self.garments[0])
        outfit = dress(
            body,
            wearer,
            {name: (self, z)},
            wearing(settings),
            meshing,
        )
        if hang:
            person = Person(gender, wearer.shape, *at, camera, ~unsure, unsure, (name,))
            sought = {name: Sought(self, codes, view, self.name)}
            outfit = hang_person(person, outfit, sought, settings, meshing, seed, hang)
        return outfit[name]

    def fit_points(
        self,
        points: np.ndarray,
        labels: np.ndarray,
        garment: str | None = None,
        *,
        gender: str,
        pose: Sequence[float],
        trans: Sequence[float],
        shape: Sequence[float] = (0.0,) * SHAPES,
        joints: np.ndarray | None = None,
        seed: int = 0,
        hang: Hang | None = None,
    ) -> ScannedGarment:
        """The garment in a segmented scan, and the body under it; see `find_garments`.

        Args:
            points: (P, 3) of the dressed person, metres, Z up.
            labels: (P,) 0 for skin, 1 for the garment, 255 for other cloth.
            garment: its type, the first of `garments` if None.
            gender: of the wearer, "female" or "male".
            pose: (72,) axis-angle, rad, as estimated; its root rotation takes the body from Y up to
                Z up.
            trans: (3,) the root joint in the scan, as estimated, metres.
            shape: (10,) as estimated; the mean one if not given.
            joints: (24, 3) positions of the joints in the scan, if they were predicted apart.
            seed: of the points that count.
            hang: hangs its sheet on the body, as in `fit_image`.

        Raises:
            InputError: an argument has another size, the points are not in metres, not near the
                body or not labelled, or too few are the garment's.
        """
        check_gender(gender)
        name = garment or self.garments[0]
        parameters = {
            "poses": finite("pose", pose, 72)[None],
            "trans": finite("trans", trans, 3)[None],
            "shape": finite("shape", shape, SHAPES),
            "gender": gender,
        }
        if joints is not None:
            parameters["joints"] = np.asarray(joints)[None]
        scans = to_scans([points], parameters, self.bodies, labels=[labels])
        (scan,) = segment_scans(scans, [name], name="points")
        models = {self.name: self}
        found = find_garments(scan, models, BodyFit(), FitScan(), Meshing(), seed, hang)
        state = found.body
        place = state.pose, state.trans, state.shape
        return ScannedGarment(found.garments[name], found.moved[name], *place)
