"""The questions that all models are asked, as files, and the answers of a method from elsewhere.

A method is compared with ours by a folder of meshes, `{question}/{case}/{Garment}.obj`, of any
topology. What it is asked stands in the folder that `write_protocol` leaves, with all that a model
may know of each case; the truth stays in the dataset. Answers are measured as our own are.
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drapeline.bodies.model import load_bodies
from drapeline.bodies.rest_body import signed_tightness
from drapeline.dataset.settings import CLEAN, WORSE
from drapeline.dataset.shards import samples_of
from drapeline.errors import DamagedFile, InputError
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.mesh import Mesh, face_normals, triangulate
from drapeline.geometry.obj import load_obj, save_obj
from drapeline.job import Job
from drapeline.learning_data.static import StaticData
from drapeline.metrics.metric import Measured, Variant
from drapeline.metrics.predictions import Fits
from drapeline.metrics.registry import variant
from drapeline.metrics.shared import MOVED, REPRESENTATION
from drapeline.metrics.table import join, summarise, write_evaluation
from drapeline.models.compare import (
    SCANNED,
    KnownScan,
    compare_frames,
    compare_representations,
    held_out_garments,
    known_scans,
)
from drapeline.models.contract import HeldOutGarment, Stopwatch
from drapeline.models.pictures.known import KnownPicture, pictures_of_job, rest_distances
from drapeline.models.pictures.read import CLASSES, GARMENT_CLASSES
from drapeline.outfits.garment_types import GARMENTS, LABELS
from drapeline.outfits.static import load_static
from drapeline.schema import Column, Schema, Table, make_table, write_table
from drapeline.storage import atomic_folder, save_npz

# Questions, named as the folders of their cases are.
REST, MOTION, POINTS, WORSE_POINTS, PICTURE = "rest", "motion", "points", "worse_points", "picture"
_QUESTIONS = REST, MOTION, POINTS, WORSE_POINTS, PICTURE
_SCANS = {POINTS: CLEAN, WORSE_POINTS: WORSE}
CASES = Schema(
    "a table of cases",
    {
        "question": Column(allowed=_QUESTIONS),
        "case": Column(),
        "garment": Column(allowed=GARMENTS),
    },
    key=("question", "case", "garment"),
)
_ABOUT = """\
# What methods are asked

`cases.tsv` has a row for each garment that is asked for. A method answers with a folder of meshes,
`{question}/{case}/{garment}.obj`, triangles or quads of any topology, in metres, Z up, and
`snakemake score --config predictions=FOLDER` measures it. It may leave out questions, and garment
types; but where it answers a question for a garment type, it has to answer every case of it. Each
question is to be answered from its own folder alone, and from what was learned of the training split.

| question | what a method is given | what it answers |
|---|---|---|
| `rest` | `{garment}.obj` at rest and its `wearer.npz` | the same, from its code |
| `motion` | each `{garment}.obj` at rest, and `wearer.npz` with the poses up to the frame | the garment in the last frame, in the wearer's world |
| `points` | `scan.npz`: exact points of a known body in motion | the garment in the middle frame, in the points' world |
| `worse_points` | the same of one camera, with noise and holes, of a body that was fitted to them | likewise |
| `picture` | `picture.npz`: labelled pixels, the camera, and the body | the garment at rest |

Garments at rest are worn in the pose `rest_pose` of `bodies/rest_pose.npz`, their root joint at the origin.
Bodies are SMPL-format files, `bodies/{gender}.npz`; `poses` (T, 72) are axis-angles, `trans` (T, 3)
the root joint, `shape` (10,) coefficients, and `tightness` (2,) is what was added to the first two of them when
the garments were made, which fit that body. The body of a picture has one `pose` (72,) and its root joint `trans` (3,), in
a world whose Z is up. `points` (T, P, 3) have `labels` (T, P), indices into
`label_names`; so have a picture's `pixels` (H, W), with `intrinsics` (3, 3) and `world_to_camera` (4, 4).
"""  # noqa: E501


class _Cases(NamedTuple):
    """All cases of an experiment, with the truth."""

    rest: list[HeldOutGarment]
    scans: dict[str, list[KnownScan]]  # question -> scans
    pictures: list[KnownPicture]


def _cases(job: Job) -> _Cases:
    given, params = job.input, job.params
    bodies, samples = load_bodies(given), samples_of(given.samples)
    outfits = (outfit for shard in given.outfits for outfit in load_static(shard))
    data, pictures = StaticData(given.data), list[KnownPicture]()
    if params.samples or params.others:
        taken = pictures_of_job(job, bodies, [*GARMENT_CLASSES])
        pictures = [one for one in taken if one.person.garments]
    return _Cases(
        held_out_garments(data, outfits, params.garments, params.split),
        {
            question: known_scans(given[f"{kind}_scans"], samples, bodies)
            for question, kind in _SCANS.items()
        },
        pictures,
    )


def write_protocol(job: Job) -> None:
    """Leave the folder of all questions."""
    given, cases = job.input, _cases(job)
    data, rows = StaticData(given.data), list[dict[str, str]]()
    with atomic_folder(job.output[0]) as scratch:
        (scratch / "bodies").mkdir()
        for gender in GENDERS:
            shutil.copyfile(given[gender], scratch / "bodies" / f"{gender}.npz")
        save_npz(scratch / "bodies" / "rest_pose.npz", rest_pose=REST_POSE)
        for one in cases.rest:
            folder = _add(rows, scratch, REST, one.outfit, one.garment)
            save_obj(folder / f"{one.garment}.obj", one.mesh)
            wearer = {key: getattr(data, key)[one.row] for key in ("gender", "shape")}
            save_npz(folder / "wearer.npz", **wearer, tightness=data.tightness[one.row])
        for known in cases.scans[POINTS]:
            person = known.person
            for name, mesh in person.rest.items():
                folder = _add(rows, scratch, MOTION, known.scan.name, name)
                save_obj(folder / f"{name}.obj", mesh)
            about = {key: getattr(person, key) for key in ("gender", "shape", "poses", "trans")}
            if person.tightness is not None:
                about["tightness"] = signed_tightness(person.tightness, person.gender)
            save_npz(folder / "wearer.npz", **about)
        for question, scans in cases.scans.items():
            for known in scans:
                for name in known.person.rest:
                    folder = _add(rows, scratch, question, known.scan.name, name)
                save_npz(folder / "scan.npz", **_points(known))
        for picture in cases.pictures:
            for name in _seen(picture).values():
                folder = _add(rows, scratch, PICTURE, picture.picture.name, name)
            save_npz(folder / "picture.npz", **_pixels(picture))
        write_table(scratch / "cases.tsv", make_table(CASES, rows), CASES)
        (scratch / "README.md").write_text(_ABOUT)


def _add(rows: list[dict[str, str]], scratch: Path, question: str, case: str, garment: str) -> Path:
    """Add a garment that is asked for; the folder of its case."""
    rows.append({"question": question, "case": case, "garment": garment})
    folder = scratch / question / case
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _points(known: KnownScan) -> dict[str, Any]:
    """A scan with its window, in the world of the sample."""
    scan, body = known.scan, known.body
    window = scan.window
    if window is None:
        root = known.person.trans[-1]
        points, labels = (scan.points + root)[None], scan.labels[None]
        poses, trans = body.pose[None], (body.trans + root)[None]
    else:
        points = window.points + window.trans[:, None]
        labels, poses, trans = window.labels, window.poses, window.trans
    return {
        "points": points.astype(np.float32),
        "labels": labels,
        "label_names": np.array(LABELS, dtype=np.str_),
        "poses": poses,
        "trans": trans,
        "shape": body.shape,
        "gender": scan.gender,
    }


def _pixels(known: KnownPicture) -> dict[str, Any]:
    person = known.person
    return {
        "pixels": known.picture.classes,
        "label_names": np.array(CLASSES, dtype=np.str_),
        "intrinsics": person.camera.intrinsics,
        "world_to_camera": person.camera.world_to_camera,
        "gender": person.gender,
        "shape": person.shape,
        "pose": person.pose,
        "trans": person.trans,
    }


def _seen(known: KnownPicture) -> dict[str, str]:
    """Class -> garment type of what is seen of a picture's person."""
    return {kind: known.garments[kind] for kind in known.person.garments}


class Predictions:
    """Meshes that a method answered a question with.

    Args:
        folder: of its answers, `{question}/{case}/{garment}.obj`.
        question: one of them.
        asked: case -> garments that are asked for.

    Attributes:
        garments: types that it answered.

    Raises:
        InputError: there is an answer that nobody asked for, or one is missing.
    """

    def __init__(
        self, folder: str | Path, question: str, asked: Mapping[str, Sequence[str]]
    ) -> None:
        self._folder = Path(folder) / question
        found = {
            (path.parent.name, path.stem): path for path in sorted(self._folder.glob("*/*.obj"))
        }
        wanted = {(case, name) for case, names in asked.items() for name in names}
        for key, path in found.items():
            if key not in wanted:
                raise DamagedFile(
                    path, f"answers no case of '{question}', expected one of cases.tsv's"
                )
        self.garments = {name for _, name in found}
        for case, name in sorted(wanted - set(found)):
            if name in self.garments:
                raise DamagedFile(
                    self._folder / case / f"{name}.obj",
                    f"no such file, expected an answer for every {name} since there are some",
                )
        self._found = found

    def __bool__(self) -> bool:
        return bool(self._found)

    def mesh(self, case: str, garment: str) -> Mesh:
        """The triangles of an answer.

        Raises:
            InputError: it is no mesh, or has no area.
        """
        path = self._found[case, garment]
        mesh = load_obj(path)
        faces = triangulate(mesh.faces)
        if not face_normals(mesh.vertices, faces).any():
            raise DamagedFile(path, "all of its faces are without area, expected a surface")
        return Mesh(mesh.vertices, faces)


class _RestAnswers:
    """Fulfils `Representation` with a method's answers."""

    def __init__(self, variant: str, answers: Predictions) -> None:
        self.variant, self._answers = variant, answers

    def rebuild(self, garments: Sequence[HeldOutGarment]) -> Iterator[Mesh]:
        """The answers for garments."""
        return (self._answers.mesh(one.outfit, one.garment) for one in garments)

    def code_numbers(self, garment: str) -> int | None:
        """None: nobody knows."""


def score(job: Job) -> None:
    """Leave the evaluation of a method's folder of meshes.

    Args:
        job: its params have `predictions`, the folder, whose name is that of the method.

    Raises:
        InputError: the folder has no answer, or see `Predictions`.
    """
    params, cases = job.params, _cases(job)
    folder = Path(params.predictions).resolve()
    about = {"split": params.split, "seed": params.seed}
    models = REPRESENTATION, MOVED, *SCANNED.values(), PICTURE
    if any(variant(model, folder.name) != Variant(folder.name) for model in models):
        raise InputError(
            f"{folder}: '{folder.name}' is the name of a method of ours, expected another one"
        )
    for path in sorted(folder.rglob("*")):
        place = path.relative_to(folder).parts
        if path.is_file() and (
            place[0] not in _QUESTIONS or len(place) != 3 or path.suffix != ".obj"
        ):
            raise DamagedFile(path, "is no answer, expected {question}/{case}/{garment}.obj")
    tables: list[Table] = []
    answers = Predictions(folder, REST, _by_case((one.outfit, one.garment) for one in cases.rest))
    if answers:
        garments = [one for one in cases.rest if one.garment in answers.garments]
        rows, _ = compare_representations(garments, [_RestAnswers(folder.name, answers)], **about)
        tables.append(rows)
    frames = [(MOTION, MOVED, cases.scans[POINTS])] + [
        (question, SCANNED[kind], cases.scans[question]) for question, kind in _SCANS.items()
    ]
    for question, model, scans in frames:
        asked = {known.scan.name: list(known.person.rest) for known in scans}
        answers = Predictions(folder, question, asked)
        if answers:
            rows, _, _ = compare_frames(
                scans,
                partial(_answer, folder.name, answers),
                Stopwatch(),
                model=model,
                garments=params.garments,
                **about,
            )
            tables.append(rows)
    pictures = {one.picture.name: [*_seen(one).values()] for one in cases.pictures}
    answers = Predictions(folder, PICTURE, pictures)
    if answers:
        measured = [
            Measured(
                one.clip,
                name,
                rest_distances(answers.mesh(one.picture.name, name), one.rest[kind]),
                one.source,
            )
            for one in cases.pictures
            for kind, name in _seen(one).items()
            if name in answers.garments
        ]
        tables.append(summarise(measured, model=PICTURE, variant=folder.name, **about))
    if not tables:
        raise InputError(
            f"{folder}: has no answer, expected meshes such as {MOTION}/CASE/Skirt.obj, of the"
            " cases that snakemake protocol writes"
        )
    write_evaluation(job.output[0], join(tables))


def _by_case(pairs: Iterator[tuple[str, str]]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for case, garment in pairs:
        found.setdefault(case, []).append(garment)
    return found


def _answer(variant: str, answers: Predictions, known: KnownScan) -> Fits:
    """A method's garments in a frame, which are in the world of the sample."""
    root = known.person.trans[-1]
    return {
        variant: {
            name: Mesh((mesh.vertices - root).astype(np.float32), mesh.faces)
            for name in known.person.rest
            if name in answers.garments
            for mesh in [answers.mesh(known.scan.name, name)]
        }
    }
