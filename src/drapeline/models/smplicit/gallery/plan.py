"""The plan of a model's gallery: its codes, on whom, and what is measured (3.4, 4.1)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import SHAPES, rest_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import Mesh, loop_count, triangulate
from drapeline.metrics.properties import PROPERTIES, measure_properties, properties_of
from drapeline.models.smplicit.garments import kind_members, region_of
from drapeline.models.smplicit.latent import (
    CodeGaussian,
    PropertyEdits,
    correlations,
    draw_between,
    explained_share,
    group_means,
    interpolate,
    principal_gaussian,
    single_gaussian,
)
from drapeline.models.smplicit.model import GarmentCodes, SmplicitModel
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.static import StaticOutfit
from drapeline.rule_log import progress
from drapeline.seeding import rng_for

SHEETS = ("samples", "prototypes", "transitions", "axes", "bodies", "edits")
_AXES = 2  # as in the paper; another one only if it stands for a property
_PROPERTY_LEAST = 0.5  # correlation from which an axis stands for a property
_STEPS = 5
_FARTHEST = 2.0  # deviations off the mean, along an axis
_USUAL = (0.05, 0.95)  # shares of the training garments with less of a property than edits ask for
# A property that codes tell less of cannot be set by them, nor be told to stay.
_EXPLAINED_LEAST = 0.5
# The first two coefficients of a body's shape: height and, negative, corpulence.
_BODIES = (
    ("female", (-2.0, 1.5)),
    ("female", (0.0, 0.0)),
    ("female", (1.0, -2.5)),
    ("male", (1.5, -2.5)),
    ("male", (-1.5, 2.0)),
)


@dataclass(frozen=True)
class Shown:
    """A garment of the gallery.

    Attributes:
        sheet: of `SHEETS`.
        row, column: its place there, by their titles.
        z: (Z,) its code.
        shape: (10,) of the wearer.
        about: the property that is written below it; "" for none.
        score: deviations off the mean along the axis that it is on; NaN for none.
        asked: the value that it was asked to have; NaN if nothing was asked.
    """

    sheet: str
    row: str
    column: str
    z: np.ndarray
    gender: str = GENDERS[0]
    shape: np.ndarray | tuple[float, ...] = (0.0,) * SHAPES
    about: str = ""
    score: float = np.nan
    asked: float = np.nan


class CodeSpace(NamedTuple):
    """The training garments' codes, and what they say about properties."""

    # Principal axes of z_cut; the property that an axis changes most rises along it.
    cut: CodeGaussian
    values: dict[str, np.ndarray]  # property -> (N,) of the training garments
    openings: dict[str, int]  # type -> how many openings most of them have
    correlation: np.ndarray  # (K, P) of axes with properties
    explained: np.ndarray  # (P,) share of each property's variance that a code predicts
    prototypes: dict[str, np.ndarray]  # kind -> (Z,) code, or the mean garment's if there is none
    edits: PropertyEdits | None  # of the properties that codes tell of; None if there is none


class TrainingMeasures(NamedTuple):
    """Measures of the garments that a model was trained on."""

    values: dict[str, np.ndarray]  # property -> (N,)
    openings: np.ndarray  # (N,) number of their openings


def training_measures(model: SmplicitModel, outfits: Sequence[StaticOutfit]) -> TrainingMeasures:
    """Measures of the garments that a model was trained on.

    Args:
        outfits: with these garments, and others.

    Raises:
        InputError: a training garment is not among them.
    """
    meshes = {
        (name, garment.name): Mesh(garment.vertices, triangulate(garment.faces))
        for name, _, outfit in outfits
        for garment in outfit.garments
    }
    codes, region = model.codes, region_of(model.name)
    rows, openings = [], []
    for index in progress(range(len(codes.z)), total=len(codes.z), label="training garments"):
        key = str(codes.outfit[index]), GARMENTS[codes.garment[index]]
        if key not in meshes:
            raise InputError(
                f"{model.folder}: was trained on {'/'.join(key)}, expected it among the static"
                " outfits; train it anew"
            )
        body = model.bodies[codes.gender[index]]
        rows.append(measure_properties(region, meshes[key], body, codes.shape[index]))
        openings.append(loop_count(meshes[key].faces))
    return TrainingMeasures(
        {name: np.array([row[name] for row in rows]) for name in properties_of(region)},
        np.array(openings),
    )


def code_space(name: str, codes: GarmentCodes, measures: TrainingMeasures, cut: int) -> CodeSpace:
    """Relations of codes to properties.

    Args:
        name: of the model, in `FIELD_MODELS`.
        codes: of the training garments.
        measures: of these.
        cut: numbers of z_cut.

    Raises:
        InputError: fewer than two training garments, or a code that is not finite.
    """
    z, values = codes.z.astype(np.float64), measures.values
    table = np.stack(list(values.values()), axis=1)
    axes = principal_gaussian(z, cut)
    correlation = correlations(axes.scores(z), table)
    known = np.nan_to_num(correlation)
    strongest = known[np.arange(len(known)), np.abs(known).argmax(axis=1)]
    sign = np.where(strongest < 0, -1.0, 1.0)[:, None]
    explained = explained_share(z, table)
    told = {
        key: values[key]
        for key, share in zip(values, explained, strict=True)
        if share >= _EXPLAINED_LEAST
    }
    prototypes = group_means(z, kind_members(name, codes.garment, values))
    return CodeSpace(
        CodeGaussian(axes.mean, sign * axes.directions, axes.deviations),
        values,
        {
            GARMENTS[kind]: _most_frequent(measures.openings[codes.garment == kind])
            for kind in np.unique(codes.garment)
        },
        sign * correlation,
        explained,
        prototypes or {"mean garment": z.mean(axis=0)},
        PropertyEdits(z, told) if told else None,
    )


def _most_frequent(numbers: np.ndarray) -> int:
    found, counts = np.unique(numbers, return_counts=True)
    return int(found[counts.argmax()])


def plan_gallery(
    codes: GarmentCodes, space: CodeSpace, bodies: Mapping[str, BodyModel], *, seed: int, count: int
) -> list[Shown]:
    """Everything that the gallery of a model shows.

    Args:
        codes: of the training garments.
        space: of `code_space`.
        bodies: by gender.
        count: samples of each distribution.
    """
    return [
        *_samples(codes, seed, count),
        *_prototypes(space),
        *_transitions(space),
        *_axes(codes, space),
        *_bodies(space, bodies),
        *_edits(codes, space),
    ]


def nearest_type(z: np.ndarray, codes: GarmentCodes) -> str:
    """The type of the training garment whose code is nearest to a code (Z,)."""
    return GARMENTS[codes.garment[np.linalg.norm(codes.z - z, axis=1).argmin()]]


def _samples(codes: GarmentCodes, seed: int, count: int) -> list[Shown]:
    """Codes of three distributions, all on the same wearers, who are some of the training's."""
    wearers = rng_for(seed, "gallery", "wearers").integers(len(codes.z), size=count)
    rows: dict[str, Callable[..., np.ndarray]] = {
        "one mean and\none deviation\n(the paper's)": single_gaussian(codes.z).draw,
        "the codes'\nnormal distribution": principal_gaussian(codes.z).draw,
        "between similar\ntraining garments": partial(draw_between, codes.z, codes.garment),
    }
    return [
        Shown(
            *("samples", title, str(column + 1)),
            draw(rng_for(seed, "gallery", "samples", row, column), 1)[0],
            str(codes.gender[wearer]),
            codes.shape[wearer],
        )
        for row, (title, draw) in enumerate(rows.items())
        for column, wearer in enumerate(wearers)
    ]


def _prototypes(space: CodeSpace) -> list[Shown]:
    return [
        Shown("prototypes", gender, name, z, gender)
        for gender in GENDERS
        for name, z in space.prototypes.items()
    ]


def _transitions(space: CodeSpace) -> list[Shown]:
    """From the first prototype to each of the others, as in figure 3 (B)."""
    (first, start), *others = space.prototypes.items()
    columns = [f"{share:.0%}" for share in np.linspace(0, 1, _STEPS)]
    return [
        Shown("transitions", f"{first}\nto\n{name}", column, z)
        for name, end in others
        for column, z in zip(columns, interpolate(start, end, _STEPS), strict=True)
    ]


def _axes(codes: GarmentCodes, space: CodeSpace) -> list[Shown]:
    """Walks along the principal axes of z_cut, as in figure 3 (A), no farther than garments are."""
    scores = space.cut.scores(codes.z)
    shown = []
    for axis, of_properties in enumerate(np.nan_to_num(space.correlation)):
        most = int(of_properties.argmax())
        if axis >= _AXES and of_properties[most] < _PROPERTY_LEAST:
            continue
        about = list(space.values)[most]
        title = f"axis {axis + 1}\n{PROPERTIES[about].title}\nr = {of_properties[most]:.2f}"
        low, high = np.clip([scores[:, axis].min(), scores[:, axis].max()], -_FARTHEST, _FARTHEST)
        steps = np.linspace(low, high, _STEPS)
        for column, (score, z) in enumerate(zip(steps, space.cut.walk(axis, steps), strict=True)):
            place = ("axes", title, _between(column, "lowest", "highest"))
            shown.append(Shown(*place, z, about=about, score=float(score)))
    return shown


def _bodies(space: CodeSpace, bodies: Mapping[str, BodyModel]) -> list[Shown]:
    """Two prototypes on five bodies, as in figure 3 (C)."""
    shown = []
    for gender, start in _BODIES:
        shape = (*start, *(0.0,) * (SHAPES - len(start)))
        height = np.ptp(rest_body(bodies[gender], np.array(shape))[:, 2])
        shown += [
            Shown("bodies", name, f"{gender}, {height:.2f} m", z, gender, shape)
            for name, z in list(space.prototypes.items())[:2]
        ]
    return sorted(shown, key=lambda item: list(space.prototypes).index(item.row))


def _edits(codes: GarmentCodes, space: CodeSpace) -> list[Shown]:
    """The mean garment of the first prototype's type, with one property changed."""
    if space.edits is None:
        return []
    kind = GARMENTS.index(nearest_type(next(iter(space.prototypes.values())), codes))
    start = codes.z[codes.garment == kind].mean(axis=0, dtype=np.float64)
    predicted = dict(zip(space.edits.names, space.edits.predict(start), strict=True))
    return [
        Shown(
            *(
                "edits",
                PROPERTIES[about].title,
                _between(column, "5th percentile", "95th percentile"),
            ),
            space.edits.edit(start, {about: asked - predicted[about]}),
            about=about,
            asked=float(asked),
        )
        for about in space.edits.names
        for low, high in [np.nanquantile(space.values[about], _USUAL)]
        for column, asked in enumerate(np.linspace(low, high, _STEPS))
    ]


def _between(column: int, first: str, last: str) -> str:
    """Title of a column, of which only the outer ones have one."""
    return {0: first, _STEPS - 1: last}.get(column, "")
