"""Garments at rest from pictures of held-out samples, beside what needs no network.

The pictures are those that SMPLicit's fit is evaluated on, and so is the measure at rest. Of each
garment class, silhouette, body and pose are known. What is compared with:

- the mean code of the class, and the mean garment of the class, which do not see the picture;
- an untrained network;
- the code of the training garment whose picture is nearest, by the same images;
- the code of the garment itself, registered, which is as near as codes get.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.follow import PosedBody
from drapeline.bodies.model import BodyModel, load_bodies
from drapeline.dataset.shards import samples_named
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh
from drapeline.job import Job
from drapeline.learning_data.static import StaticData
from drapeline.metrics.baselines import MeanGarment, fit_mean_garment
from drapeline.metrics.garment import garment_mesh
from drapeline.metrics.metric import Measured
from drapeline.metrics.predictions import BODY, TRUE, Fits, label_of, save_fitted_scans
from drapeline.metrics.table import join, summarise, write_evaluation
from drapeline.models.gcvae.pictures.data import PictureData
from drapeline.models.gcvae.pictures.model import PictureModel, kinds_of, predict
from drapeline.models.gcvae.pictures.network import PictureCoder
from drapeline.models.gcvae.pictures.train import conditions_of, encode_untold, types_of_class
from drapeline.models.gcvae.pictures.views import mirror_images
from drapeline.models.pictures.dressed import seen_parts, shown_labels
from drapeline.models.pictures.known import KnownPicture, pictures_of_job, rest_distances
from drapeline.models.pictures.read import CLASSES, GARMENT_CLASSES
from drapeline.models.training.batches import as_tensors
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.dynamic_offsets import SampleGarment, load_sample_garment
from drapeline.registration.to_body.topology import topology_codes
from drapeline.report.models.gcvae.pictures import GARMENTS_AT_REST, PICTURES
from drapeline.rule_log import progress
from drapeline.schema import Table
from drapeline.storage import save_npz

MODEL = "picture"
_AT_ONCE = 256  # training pictures that are compared with one


class PictureEvaluation:
    """Measures of garments at rest from pictures, and of what they are compared with."""

    def __init__(self, model: PictureModel, data: StaticData, pictures: PictureData) -> None:
        coder = model.coder
        self._model, self._data, self._pictures = model, data, pictures
        self._codes = encode_untold(model.codec, data, coder.tightness.numpy())
        self._untrained = PictureCoder(coder.settings, coder.size_px, coder.space).eval()
        self._train = pictures.rows("train")
        self._means = {name: self._fit_mean(name) for name in model.known}

    def run(
        self,
        pictures: Sequence[KnownPicture],
        registered: Callable[[str, str], SampleGarment],
        *,
        split: str,
        seed: int,
    ) -> tuple[Table, dict[str, Fits]]:
        """All rows, and the garments at rest by picture, variant and type.

        Args:
            pictures: of samples.
            registered: sample and garment type -> the garment's registration.
            split: name of theirs.
            seed: named in the rows, and draws the intervals.

        Raises:
            InputError: none of them shows a garment of a class that was learned.
        """
        pictures = [known for known in pictures if known.person.garments]
        if not pictures:
            raise InputError(
                f"no picture of the {split} split shows a garment of the classes"
                f" {', '.join(self._model.known)}, expected some"
            )
        measured: dict[str, list[Measured]] = {}
        found: dict[str, Fits] = {}
        for known in progress(pictures, total=len(pictures), label="pictures"):
            wearer = Mesh(known.body.rest.astype(np.float32), known.body.faces)
            shown: dict[str, dict[str, Mesh]] = {TRUE: {}, BODY: {BODY: wearer}}
            for name, variants in self._find(known, registered):
                garment, true = known.garments[name], known.rest[name]
                shown[TRUE][garment] = true
                for variant, mesh in variants.items():
                    shown.setdefault(variant, {})[garment] = mesh
                    one = Measured(known.clip, garment, rest_distances(mesh, true), known.source)
                    measured.setdefault(variant, []).append(one)
            found[known.picture.name] = shown
        summary = partial(summarise, model=MODEL, split=split, seed=seed)
        tables = (summary(part, variant=f"{MODEL}_{name}") for name, part in measured.items())
        return join(tables), found

    def _find(
        self, known: KnownPicture, registered: Callable[[str, str], SampleGarment]
    ) -> Iterator[tuple[str, dict[str, Mesh]]]:
        """Class -> variant -> garment at rest, of each garment that a picture shows."""
        model, person, names = self._model, known.person, known.person.garments
        images = model.images(model.view(known.picture, person, known.body), names)
        codes = {
            "network": model.codes(images, names),
            "untrained": predict(self._untrained, images, names),
            "nearest": np.stack([self._nearest(*one) for one in zip(images, names, strict=True)]),
            "mean_code": model.coder.means.numpy()[kinds_of(names)],
            "registered": np.stack(
                [
                    self._encode(registered(known.sample, known.garments[name]), name, known)
                    for name in names
                ]
            ),
        }
        for index, name in enumerate(names):
            meshes = {
                variant: model.decode(z[index], name, person.gender, person.shape)
                for variant, z in codes.items()
            }
            yield name, meshes | {"mean_garment": self._mean_garment(name, known)}

    def _nearest(self, image: np.ndarray, name: str) -> np.ndarray:
        """(Z,) code of the training garment of a class in the nearest image, or its mirror image.

        The image is (CHANNELS, R, R).
        """
        rows = self._train[self._of_class(name)[self._pictures.garment[self._train]]]
        both = np.stack([image, mirror_images(torch.from_numpy(image)[None])[0].numpy()])
        distances = [
            np.square(self._pictures.images(part)[None] - both[:, None]).sum((2, 3, 4)).min(0)
            for part in np.array_split(rows, -(-len(rows) // _AT_ONCE))
        ]
        return self._codes[self._pictures.garment[rows[np.concatenate(distances).argmin()]]]

    def _of_class(self, name: str) -> np.ndarray:
        """(N,) whether a garment may be one of a class."""
        return np.isin(self._data.garment, [GARMENTS.index(one) for one in types_of_class(name)])

    def _encode(self, garment: SampleGarment, name: str, known: KnownPicture) -> np.ndarray:
        """(Z,) code of a registered garment."""
        batch = {
            "offsets": garment.offsets[None],
            "mask": garment.mask[None],
            "cvar": self._conditions(known),
            "topology": topology_codes(np.array([GARMENTS.index(GARMENT_CLASSES[name])])),
        }
        return self._model.codec.encode(as_tensors(batch)).mean[0].numpy()

    def _conditions(self, known: KnownPicture) -> np.ndarray:
        person = known.person
        tightness = self._model.coder.tightness.numpy()
        return conditions_of(person.shape[None], np.array([person.gender]), tightness)

    def _fit_mean(self, name: str) -> MeanGarment:
        """The mean of the training garments of a class."""
        data, rows = self._data, self._data.rows("train")
        kinds = np.zeros(len(data), dtype=np.int64)
        own = rows[self._of_class(name)[rows]]
        return fit_mean_garment(data.offsets, data.mask, kinds, own, 1)

    def _mean_garment(self, name: str, known: KnownPicture) -> Mesh:
        """The mean garment of a class on the wearer's body."""
        template, mean = self._model.codec.body_template, self._means[name]
        body = template.rest_body(self._conditions(known)[0])
        faces = template.faces_of(GARMENT_CLASSES[name])
        return garment_mesh(body + mean.offsets[0], faces, mean.mask[0])


def type_labels(known: KnownPicture) -> np.ndarray:
    """(H, W) uint8 labels of a picture's pixels, by garments' types instead of classes."""
    classes = known.picture.classes
    labels = shown_labels(classes)
    for name, garment in known.garments.items():
        labels[classes == CLASSES.index(name)] = label_of(garment)
    return labels


def seen_segments(body: PosedBody, model: BodyModel, known: KnownPicture) -> np.ndarray:
    """(H, W) uint8, 0 where no skin is seen, else 1 + the joint that its segment follows."""
    segment = model.segmentation[body.faces[:, 0]]
    parts = [
        Mesh(body.posed, body.faces[segment == joint]) for joint in range(model.weights.shape[1])
    ]
    empty = body._replace(faces=body.faces[:0])
    seen = seen_parts(empty, [*parts, *known.true.values()], known.person.camera)
    return np.where(seen < 2 + len(parts), np.maximum(seen, 1) - 1, 0).astype(np.uint8)


def evaluate(job: Job) -> None:
    """Garments at rest from pictures of held-out samples, by the network and without one."""
    given, params = job.input, job.params
    torch.set_num_threads(job.threads)
    bodies, data = load_bodies(given), StaticData(given.data)
    model = PictureModel(given.network, given.model, bodies)
    pictures = pictures_of_job(job, bodies, model.known)

    def registered(sample: str, garment: str) -> SampleGarment:
        (folder,) = samples_named(given.registrations, [sample])
        return load_sample_garment(folder / f"{garment}.npz")

    evaluation = PictureEvaluation(model, data, PictureData(given.pictures, len(data)))
    rows, found = evaluation.run(pictures, registered, split=params.split, seed=params.seed)
    shown = [known for known in pictures if known.picture.name in found]

    def save_shown(folder: Path) -> None:
        save_fitted_scans(folder / GARMENTS_AT_REST, found)
        save_npz(
            folder / PICTURES,
            name=np.array([known.picture.name for known in shown], dtype=np.str_),
            labels=np.stack([type_labels(known) for known in shown]),
            segments=np.stack(
                [seen_segments(known.body, bodies[known.person.gender], known) for known in shown]
            ),
        )

    write_evaluation(job.output[0], rows, save_shown)
