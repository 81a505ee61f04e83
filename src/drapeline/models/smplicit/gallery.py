"""What the gallery of a model shows: its codes, on whom, and what is measured (3.4, 4.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drapeline.bodies.rest_body import SHAPES
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.models.smplicit.files import TrainingCodes
from drapeline.models.smplicit.latent import (
    CodeGaussian,
    PropertyEdits,
    correlations,
    explained_share,
    group_means,
    interpolate,
    principal_gaussian,
    single_gaussian,
)
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.properties import (
    PROPERTIES,
    kind_members,
    measure_properties,
    properties_of,
)
from drapeline.outfits.garment_types import GARMENTS
from drapeline.outfits.static import StaticOutfit
from drapeline.rule_log import progress
from drapeline.seeding import rng_for

SHEETS = ("samples", "prototypes", "transitions", "axes", "bodies", "edits")
_AXES = 3
_STEPS = 5
_AXIS_SCORES = (-2.0, -1.0, 0.0, 1.0, 2.0)
_EDIT_DEVIATIONS = (-1.5, -0.75, 0.0, 0.75, 1.5)
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
        gender: of the wearer.
        shape: (10,) of the wearer.
        about: the property that is written below it; "" for none.
        asked: the value that it was asked to have; NaN if nothing was asked.
    """

    sheet: str
    row: str
    column: str
    z: np.ndarray
    gender: str = GENDERS[0]
    shape: np.ndarray | tuple[float, ...] = (0.0,) * SHAPES
    about: str = ""
    asked: float = np.nan


class CodeSpace(NamedTuple):
    """The training garments' codes, and what they say about properties.

    Attributes:
        cut: principal axes of z_cut; the property that an axis changes most rises along it.
        values: property -> (N,) of the training garments.
        correlation: (K, P) of axes with properties.
        explained: (P,) share of each property's variance that a code predicts.
        prototypes: kind -> (Z,) code.
        edits: of the properties that codes tell of; None if there is none.
    """

    cut: CodeGaussian
    values: dict[str, np.ndarray]
    correlation: np.ndarray
    explained: np.ndarray
    prototypes: dict[str, np.ndarray]
    edits: PropertyEdits | None


def training_properties(
    model: SmplicitModel, outfits: Sequence[StaticOutfit]
) -> dict[str, np.ndarray]:
    """Property -> (N,) of the garments that a model was trained on.

    Args:
        model: trained.
        outfits: with these garments, and others.

    Raises:
        InputError: a training garment is not among them.
    """
    meshes = {
        (name, garment.name): Mesh(garment.vertices, triangulate(garment.faces))
        for name, _, outfit in outfits
        for garment in outfit.garments
    }
    codes = model.codes
    rows = []
    for index in progress(range(len(codes.z)), total=len(codes.z), label="training garments"):
        key = str(codes.outfit[index]), GARMENTS[codes.garment[index]]
        if key not in meshes:
            raise InputError(
                f"{model.folder}: was trained on {'/'.join(key)}, expected it among the static"
                " outfits; train it anew"
            )
        body = model.bodies[GENDERS[codes.gender[index]]]
        rows.append(measure_properties(model.name, meshes[key], body, codes.shape[index]))
    return {name: np.array([row[name] for row in rows]) for name in properties_of(model.name)}


def code_space(
    name: str, codes: TrainingCodes, values: Mapping[str, np.ndarray], cut: int
) -> CodeSpace:
    """What codes say about properties.

    Args:
        name: of the model, in `FIELD_MODELS`.
        codes: of the training garments.
        values: property -> (N,) of these.
        cut: numbers of z_cut.

    Raises:
        InputError: fewer than two training garments, or a code that is not finite.
    """
    z = codes.z.astype(np.float64)
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
    return CodeSpace(
        CodeGaussian(axes.mean, sign * axes.directions, axes.deviations),
        dict(values),
        sign * correlation,
        explained,
        group_means(z, kind_members(name, codes.garment, values)),
        PropertyEdits(z, told) if told else None,
    )


def plan_gallery(
    codes: TrainingCodes, space: CodeSpace, *, seed: int, count: int
) -> list[Shown]:
    """Everything that the gallery of a model shows.

    Args:
        codes: of the training garments.
        space: of `code_space`.
        seed: the experiment's.
        count: samples of each distribution.
    """
    return [
        *_samples(codes, seed, count),
        *_prototypes(space),
        *_transitions(space),
        *_axes(space),
        *_bodies(space),
        *_edits(space),
    ]


def nearest_type(z: np.ndarray, codes: TrainingCodes) -> str:
    """The type of the training garment whose code is nearest to a code (Z,)."""
    return GARMENTS[codes.garment[np.linalg.norm(codes.z - z, axis=1).argmin()]]


def _samples(codes: TrainingCodes, seed: int, count: int) -> list[Shown]:
    """Codes of both distributions, on wearers of training garments."""
    wearers = rng_for(seed, "gallery", "wearers").integers(len(codes.z), size=count)
    distributions = {
        "as training\ncodes vary": principal_gaussian(codes.z),
        "one mean and\none deviation\n(the paper's)": single_gaussian(codes.z),
    }
    shown = []
    for row, (title, gaussian) in enumerate(distributions.items()):
        drawn = gaussian.draw(rng_for(seed, "gallery", "samples", row), count)
        shown += [
            Shown(
                *("samples", title, str(column + 1), z),
                GENDERS[codes.gender[wearer]],
                codes.shape[wearer],
            )
            for column, (z, wearer) in enumerate(zip(drawn, wearers, strict=True))
        ]
    return shown


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


def _axes(space: CodeSpace) -> list[Shown]:
    """Walks along the principal axes of z_cut, as in figure 3 (A)."""
    shown = []
    for axis, of_properties in enumerate(space.correlation[:_AXES]):
        most = int(np.abs(np.nan_to_num(of_properties)).argmax())
        about = list(space.values)[most]
        title = f"axis {axis + 1}\n{PROPERTIES[about].title}\nr = {of_properties[most]:.2f}"
        for score, z in zip(_AXIS_SCORES, space.cut.walk(axis, _AXIS_SCORES), strict=True):
            shown.append(Shown("axes", title, _signed(score, "dev."), z, about=about))
    return shown


def _bodies(space: CodeSpace) -> list[Shown]:
    """Prototypes on five bodies, as in figure 3 (C)."""
    return [
        Shown("bodies", name, f"{gender} {index + 1}", z, gender, (*start, *(0.0,) * (SHAPES - 2)))
        for name, z in list(space.prototypes.items())[:2]
        for index, (gender, start) in enumerate(_BODIES)
    ]


def _edits(space: CodeSpace) -> list[Shown]:
    """The first prototype with one property changed and the others kept."""
    if space.edits is None:
        return []
    start = next(iter(space.prototypes.values()))
    predicted = dict(zip(space.edits.names, space.edits.predict(start), strict=True))
    shown = []
    for about in space.edits.names:
        deviation = float(np.nanstd(space.values[about]))
        for times in _EDIT_DEVIATIONS:
            change = times * deviation
            shown.append(
                Shown(
                    *("edits", PROPERTIES[about].title, _signed(times, "dev.")),
                    space.edits.edit(start, {about: change}),
                    about=about,
                    asked=predicted[about] + change,
                )
            )
    return shown


def _signed(number: float, unit: str) -> str:
    return f"{number:+g} {unit}" if number else f"0 {unit}"
