"""Pictures of outfits at rest, put into the poses of samples, for the network to learn from."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drapeline.bodies.follow import pose_body
from drapeline.bodies.model import BodyModel, load_bodies
from drapeline.dataset.shards import samples_of
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.job import Job
from drapeline.learning_data.skinned import SampleMotion, read_motions, skin_outfit
from drapeline.learning_data.static import StaticData
from drapeline.models.gcvae.pictures.views import (
    PersonView,
    body_marks,
    cut_to_body,
    join_views,
    network_images,
    pixels_of_cut,
    see_body,
)
from drapeline.models.gcvae.settings import PictureViews
from drapeline.models.pictures.known import RISE, camera_around, segment
from drapeline.models.pictures.read import CLASSES, UNKNOWN, class_of_garment
from drapeline.models.training.batches import Batch
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.outfit import Outfit
from drapeline.outfits.static import StaticOutfit, load_static
from drapeline.rule_log import progress
from drapeline.seeding import rng_for
from drapeline.storage import ArrayFiles, atomic_folder, load_npz, open_arrays, save_npz

_LEAST_SHARE = 0.003  # of a view's pixels; of a garment that shows less there is nothing to see
_ROW = [("picture", np.int64), ("garment", np.int64), ("kind", np.int64), ("split", "U5")]
_ROWS = {
    **{"picture": "int<p n", "garment": "int<g n", "kind": f"int<{len(CLASSES)} n"},
    "split": "str n",
}
_IMAGES = {"body": "int p r r 4", "classes": "int p r r"}


def collect_pictures(
    folder: str | Path,
    outfits: Sequence[StaticOutfit],
    motions: Sequence[SampleMotion],
    data: StaticData,
    bodies: Mapping[str, BodyModel],
    settings: PictureViews,
) -> int:
    """Take pictures of outfits and write them.

    An outfit takes poses of samples of its own split, so that no motion is in two splits; each
    picture is of another frame, from another side.

    Args:
        folder: for `body.npy` and `classes.npy`, the views, and `rows.npz`, a row for each garment
            that one shows. Replaced as a whole.
        outfits: at rest; those of a split without motions are left out.
        motions: of samples.
        data: the same garments, registered; those that it lacks are left out.
        bodies: whole, by gender.

    Returns:
        Number of rows.
    """
    known = {
        (str(outfit), GARMENTS[garment]): row
        for row, (outfit, garment) in enumerate(zip(data.outfit, data.garment, strict=True))
    }
    marks = {gender: body_marks(body) for gender, body in bodies.items()}
    least = _LEAST_SHARE * settings.size_px**2
    by_split = {m.split: [one for one in motions if one.split == m.split] for m in motions}
    outfits = [one for one in outfits if one.split in by_split]
    shape = (len(outfits) * settings.per_outfit, settings.size_px, settings.size_px)
    rows: list[tuple[int, int, int, str]] = []
    with atomic_folder(folder) as scratch:
        files = ArrayFiles(scratch, {"body": (np.int8, (*shape, 4)), "classes": (np.uint8, shape)})
        for number, (name, split, outfit) in enumerate(progress(outfits, label="outfits")):
            rng = rng_for(settings.seed, "pictures", name)
            views = _take_views(rng, outfit, by_split[split], bodies, marks, settings)
            files.append(**join_views(views)._asdict())
            for picture, view in enumerate(views, number * settings.per_outfit):
                for worn in outfit.garments:
                    row, kind = known.get((name, worn.name)), class_code(worn.name)
                    if row is not None and (view.classes == kind).sum() >= least:
                        rows.append((picture, row, kind, split))
        files.flush()
        table = np.array(rows, dtype=_ROW)
        save_npz(scratch / "rows.npz", **{key: table[key] for key in _ROWS})
    return len(rows)


def class_code(garment: str) -> int:
    """The index into `CLASSES` of a garment type's class."""
    return CLASSES.index(class_of_garment(garment))


def _take_views(
    rng: np.random.Generator,
    outfit: Outfit,
    motions: Sequence[SampleMotion],
    bodies: Mapping[str, BodyModel],
    marks: Mapping[str, np.ndarray],
    settings: PictureViews,
) -> list[PersonView]:
    """Views of an outfit in poses that are drawn from motions, from sides that are drawn too."""
    body, views = bodies[outfit.gender], []
    chosen = rng.integers(len(motions), size=settings.per_outfit)
    frames = [motions[index].poses for index in chosen]
    poses = np.stack([own[rng.integers(len(own))] for own in frames])
    worn = skin_outfit(outfit, body, poses)
    faces = {garment.name: triangulate(garment.faces) for garment in outfit.garments}
    for frame, pose in enumerate(poses):
        wearer = pose_body(body, outfit.shape, pose, np.zeros(3))
        turn, rise = rng.uniform(0, 360), rng.uniform(0, RISE)
        around = camera_around(wearer.posed, pose, turn, rise, settings.size_px)
        camera = cut_to_body(around, wearer.posed, settings.size_px)
        garments = {
            class_of_garment(name): Mesh(cloth[frame], faces[name])
            for name, cloth in worn.garments.items()
        }
        classes = segment(wearer, garments, camera)
        row, column = pixels_of_cut(around, camera)
        classes[np.minimum(row[:, None], column) < 0] = CLASSES.index(UNKNOWN)
        views.append(PersonView(see_body(wearer, marks[outfit.gender], camera), classes))
    return views


class PictureData:
    """Pictures as `collect_pictures` wrote them, a row for each garment that one shows.

    Attributes:
        views: (P, R, R, 4) and (P, R, R), memory-mapped.
        picture: (N,) rows of the views.
        garment: (N,) rows of the garments' `StaticData`.
        kind: (N,) classes of the garments, indices into `CLASSES`.
        split: (N,) "train", "val" or "test".
    """

    def __init__(self, folder: str | Path, garments: int) -> None:
        """Open a folder of pictures of so many registered garments.

        Raises:
            InputError: a file is missing or damaged, or the pictures are of other garments.
        """
        arrays = open_arrays(folder, _IMAGES)
        self.views = PersonView(arrays["body"], arrays["classes"])
        count = len(self.views.classes)
        rows = load_npz(Path(folder) / "rows.npz", _ROWS, p=count, g=garments)
        self.picture, self.garment, self.kind = (
            rows[key] for key in ("picture", "garment", "kind")
        )
        self.split = rows["split"]

    @property
    def size_px(self) -> int:
        """R."""
        return self.views.classes.shape[1]

    def rows(self, split: str) -> np.ndarray:
        """Indices of the rows of a split."""
        return np.flatnonzero(self.split == split)

    def images(self, rows: np.ndarray) -> np.ndarray:
        """(B, CHANNELS, R, R) float32 images of the garments of some rows."""
        views = PersonView(*(np.asarray(part[self.picture[rows]]) for part in self.views))
        return network_images(views, self.kind[rows])


class PictureRows:
    """Pictures with the codes that they are to give, as rows to train on."""

    def __init__(self, pictures: PictureData, codes: np.ndarray, data: StaticData) -> None:
        """Codes are (N, Z), of the garments of the registered data."""
        self.rows, self._pictures, self._codes, self._data = pictures.rows, pictures, codes, data

    def batch(self, rows: np.ndarray) -> Batch:
        """`images` (B, CHANNELS, R, R), `kind` (B,), `z` (B, Z) and `names`."""
        garments = self._pictures.garment[rows]
        return {
            "images": self._pictures.images(rows),
            "kind": self._pictures.kind[rows],
            "z": self._codes[garments],
            "names": self._data.names(garments),
        }


def collect(job: Job) -> None:
    """Pictures of outfits at rest in poses of samples, to learn codes from."""
    given = job.input
    outfits = [one for shard in given.outfits for one in load_static(shard)]
    collect_pictures(
        job.output[0],
        [one for one in outfits if one.split != "test"],
        read_motions(samples_of(given.samples)),
        StaticData(given.data),
        load_bodies(given),
        PictureViews(**job.params.settings),
    )
