"""Garments at rest from pictures: the network, and the static model that decodes its codes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.follow import PosedBody
from drapeline.bodies.model import BodyModel
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.garment import garment_mesh
from drapeline.models.gcvae.codec import GarmentCodec, decode_codes
from drapeline.models.gcvae.load import load_codec
from drapeline.models.gcvae.pictures.network import PictureCoder, load_coder
from drapeline.models.gcvae.pictures.train import conditions_of
from drapeline.models.gcvae.pictures.views import (
    PersonView,
    body_marks,
    join_views,
    network_images,
    view_person,
)
from drapeline.models.gcvae.sample import mend
from drapeline.models.pictures.dressed import FittedGarment, posed_person
from drapeline.models.pictures.read import CLASSES, GARMENT_CLASSES, Person, Picture
from drapeline.models.training.checkpoints import tensors_digest
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.worn import SkinningOptions, pose_in_layers
from drapeline.registration.to_body.topology import topology_codes


class PictureModel:
    """Codes of the garments that pictures show, and their garments.

    Args:
        folder: of the network's training, such as `results/gcvae/pictures`.
        static: of the static model whose codes it has learned.
        bodies: whole, by gender, as the network has learned with.

    Attributes:
        coder: the network.
        codec: the static model.
        known: classes of `GARMENT_CLASSES` that it has learned.

    Raises:
        InputError: a file is missing or damaged, or the network has learned other codes.
    """

    def __init__(
        self, folder: str | Path, static: str | Path, bodies: Mapping[str, BodyModel]
    ) -> None:
        self.coder: PictureCoder = load_coder(folder)
        self.codec: GarmentCodec = load_codec(Path(static) / BEST)
        if tensors_digest(self.codec.state_dict()) != self.coder.model:
            raise InputError(
                f"{folder}: has learned the codes of another model than {static}, expected that of"
                " its training"
            )
        self.bodies = bodies
        known = self.coder.known.numpy()
        self.known = [name for name in GARMENT_CLASSES if known[CLASSES.index(name)]]
        self._marks = {gender: body_marks(body) for gender, body in bodies.items()}

    def view(self, picture: Picture, person: Person, body: PosedBody) -> PersonView:
        """What the network sees of a person of a picture, whose body is given."""
        marks = self._marks[person.gender]
        return view_person(picture, person, body, marks, self.coder.size_px)

    def images(self, view: PersonView, names: Sequence[str]) -> np.ndarray:
        """(n, CHANNELS, R, R) images of a person's garments, by their classes."""
        return network_images(join_views([view] * len(names)), kinds_of(names))

    def codes(self, images: np.ndarray, names: Sequence[str]) -> np.ndarray:
        """(n, Z) codes of garments of some classes in images (n, CHANNELS, R, R)."""
        return predict(self.coder, images, names)

    def decode(
        self, z: np.ndarray, name: str, gender: str, shape: np.ndarray, *, settle: bool = False
    ) -> Mesh:
        """The garment at rest of a code (Z,), root-relative metres, Z up.

        Args:
            name: class of the garment, which decides about its topology.
            gender, shape: of the wearer, (10,).
            settle: whether its largest piece alone is kept and mended, see `sample.mend`.
        """
        cvar = conditions_of(shape[None], np.array([gender]), self.coder.tightness.numpy())
        garment, template = GARMENT_CLASSES[name], self.codec.body_template
        topology = topology_codes(np.array([GARMENTS.index(garment)]))
        ((offsets, mask),) = decode_codes(self.codec, z[None], cvar, topology)
        body = template.rest_body(cvar[0])
        if settle:
            return mend(self.codec, garment, body, offsets, mask)
        return garment_mesh(body + offsets, template.faces_of(garment), mask)

    def dress(self, picture: Picture) -> list[dict[str, FittedGarment]]:
        """The garments of all people of a picture, by class, from the innermost to the outermost.

        They are mended, and follow the body into its pose.

        Raises:
            InputError: the picture shows a class of garments that the network has not learned.
        """
        people = []
        for person in picture.people:
            names = person.garments
            for name in names:
                if name not in self.known:
                    raise InputError(
                        f"{picture.name}: shows a garment of the class {name}, expected only those"
                        f" that were learned: {', '.join(self.known)}"
                    )
            body = posed_person(person, self.bodies)
            codes = self.codes(self.images(self.view(picture, person, body), names), names)
            sheets = {
                name: self.decode(z, name, person.gender, person.shape, settle=True)
                for name, z in zip(names, codes, strict=True)
            }
            worn = pose_in_layers(sheets, body, SkinningOptions())
            people.append(
                {
                    name: FittedGarment(z, sheets[name], worn[name])
                    for name, z in zip(names, codes, strict=True)
                }
            )
        return people


def predict(coder: PictureCoder, images: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """(n, Z) codes that a network gives for images of garments of some classes."""
    with torch.inference_mode():
        return coder(torch.from_numpy(images), torch.from_numpy(kinds_of(names))).numpy()


def kinds_of(names: Sequence[str]) -> np.ndarray:
    """(n,) indices into `CLASSES`."""
    return np.array([CLASSES.index(name) for name in names], dtype=np.int64)
