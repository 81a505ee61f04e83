"""Files of a gallery: meshes of its garments with a table, and what codes say about properties."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, loop_count
from drapeline.geometry.obj import load_obj, save_obj
from drapeline.job import Job
from drapeline.metrics.garment import shape_measures
from drapeline.metrics.predictions import GalleryGarment
from drapeline.metrics.properties import PROPERTIES, measure_properties, properties_of
from drapeline.models.smplicit.gallery.plan import (
    CodeSpace,
    Shown,
    code_space,
    nearest_type,
    plan_gallery,
    training_measures,
)
from drapeline.models.smplicit.garments import region_of
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.settings import Meshing
from drapeline.outfits.static import load_static
from drapeline.rule_log import LOGGER, progress
from drapeline.storage import atomic_folder, load_npz, save_npz, write_rows

GARMENTS_TABLE, CODES = "garments.tsv", "codes.npz"
CORRELATIONS, REGRESSIONS = "correlations.tsv", "regressions.tsv"
_PICTURED = ("sheet", "row", "column", "caption", "garment", "gender", "shape", "name")
_FORMS = {**dict.fromkeys(_PICTURED, "str n"), "shape": "float n 10", "z": "float n *"}
_BEYOND = 0.1  # of the span of the training garments' property
Row = dict[str, str | float]


def save_gallery(
    folder: str | Path,
    model: SmplicitModel,
    shown: Sequence[Shown],
    space: CodeSpace,
    meshing: Meshing,
) -> list[Row]:
    """Decode garments and write them with their tables.

    A garment that is shown several times is made once. It has `{name}.obj` and, with its wearer,
    `{name}.glb`; one of which nothing is left has only the latter.

    Args:
        folder: replaced as a whole.
        shown: what to make.
        space: of the model's codes.

    Returns:
        The rows of `garments.tsv`.
    """
    rows: list[Row] = []
    made: dict[bytes, Row] = {}
    with atomic_folder(folder) as scratch:
        for item in progress(shown, total=len(shown), label="garments"):
            shape = np.asarray(item.shape, dtype=np.float32)
            key = item.z.astype(np.float32).tobytes() + shape.tobytes() + item.gender.encode()
            if key not in made:
                made[key] = _make(scratch, f"{len(made) + 1:03d}", model, item, meshing)
            rows.append(_row(item, made[key], space))
        save_npz(
            scratch / CODES,
            z=np.stack([item.z for item in shown]).astype(np.float32),
            shape=np.stack([item.shape for item in shown]).astype(np.float32),
            gender=np.array([item.gender for item in shown]),
            sheet=np.array([item.sheet for item in shown]),
            row=np.array([item.row for item in shown]),
            column=np.array([item.column for item in shown]),
            caption=np.array([_caption(item, row) for item, row in zip(shown, rows, strict=True)]),
            garment=np.array([row["garment"] for row in rows]),
            name=np.array([row["name"] for row in rows]),
        )
        for file, table in (
            (GARMENTS_TABLE, rows),
            (CORRELATIONS, correlation_rows(model.name, space)),
            (REGRESSIONS, regression_rows(model.name, space)),
        ):
            write_rows(scratch / file, table)
    return rows


def correlation_rows(model: str, space: CodeSpace) -> list[Row]:
    """A row for each axis of z_cut and each property, with the deviation along the axis."""
    return [
        {
            "model": model,
            "axis": axis + 1,
            "deviation": float(deviation),
            "property": name,
            "title": PROPERTIES[name].title,
            "correlation": float(space.correlation[axis, column]),
            "garments": int(np.isfinite(value).sum()),
        }
        for axis, deviation in enumerate(space.cut.deviations)
        for column, (name, value) in enumerate(space.values.items())
    ]


def regression_rows(model: str, space: CodeSpace) -> list[Row]:
    """A row for each property: what whole codes tell of it, and how it varies, in its unit."""
    return [
        {
            "model": model,
            "property": name,
            "title": PROPERTIES[name].title,
            "about": PROPERTIES[name].about,
            "explained_share": float(space.explained[column]),
            "unit": PROPERTIES[name].unit,
            "mean": float(PROPERTIES[name].scale * np.nanmean(value)),
            "deviation": float(PROPERTIES[name].scale * np.nanstd(value)),
            "garments": int(np.isfinite(value).sum()),
        }
        for column, (name, value) in enumerate(space.values.items())
    ]


def load_gallery(folder: str | Path, bodies: Mapping[str, BodyModel]) -> list[GalleryGarment]:
    """Read the garments that `save_gallery` wrote, in its order.

    Args:
        folder: to read.
        bodies: by gender, those of the model.

    Raises:
        InputError: a file is missing or damaged.
    """
    folder = Path(folder)
    about = load_npz(folder / CODES, {key: _FORMS[key] for key in _PICTURED})
    return [
        GalleryGarment(
            str(row["sheet"]),
            str(row["row"]),
            str(row["column"]),
            str(row["caption"]),
            str(row["garment"]),
            _read(folder / f"{row['name']}.obj"),
            _wearer(bodies[str(row["gender"])], row["shape"]),
        )
        for row in (
            dict(zip(_PICTURED, values, strict=True))
            for values in zip(*(about[key] for key in _PICTURED), strict=True)
        )
    ]


def posed_prototype(folder: str | Path) -> tuple[str, np.ndarray]:
    """Name and code (Z,) of the prototype that is shown in motion, the second of a gallery's.

    The first ones are the shorter garments, of which motion shows less.

    Raises:
        InputError: the gallery's codes are missing or damaged.
    """
    about = load_npz(Path(folder) / CODES, {key: _FORMS[key] for key in ("sheet", "column", "z")})
    chosen = about["sheet"] == "prototypes"
    names = list(dict.fromkeys(about["column"][chosen].tolist()))
    name = names[min(1, len(names) - 1)]
    return name, about["z"][chosen & (about["column"] == name)][0]


def worn_prototype(
    folder: str | Path, model: SmplicitModel, meshing: Meshing, *, gender: str, shape: np.ndarray
) -> tuple[str, np.ndarray, Mesh]:
    """Name, code and sheet of the `posed_prototype` of a gallery, on a body.

    Raises:
        InputError: nothing is left of it on that body.
    """
    name, z = posed_prototype(folder)
    sheet = model.decode(z, gender=gender, shape=shape, meshing=meshing).sheet
    if not len(sheet.faces):
        raise InputError(
            f"{model.folder}: nothing is left of the prototype '{name}' on the wearer's body,"
            " expected cloth to pose; the model may need longer training"
        )
    return name, z, sheet


def _make(folder: Path, name: str, model: SmplicitModel, item: Shown, meshing: Meshing) -> Row:
    """Decode a garment and write its files."""
    shape = np.asarray(item.shape)
    mesh = model.decode(item.z, gender=item.gender, shape=shape, meshing=meshing).sheet
    body = _wearer(model.bodies[item.gender], shape)
    garment = nearest_type(item.z, model.codes)
    parts = [still_part("Body", body, BODY_COLOUR)]
    properties = dict.fromkeys(properties_of(region_of(model.name)), np.nan)
    if len(mesh.faces):
        save_obj(folder / f"{name}.obj", mesh)
        parts.append(still_part(garment, mesh, PLAIN_COLOUR))
        properties = measure_properties(
            region_of(model.name), mesh, model.bodies[item.gender], shape
        )
    write_glb(folder / f"{name}.glb", parts)
    measures = shape_measures(mesh, body.vertices, body.faces)
    return {
        "name": name,
        "garment": garment,
        "gender": item.gender,
        "vertices": len(mesh.vertices),
        "openings": loop_count(mesh.faces) if len(mesh.faces) else 0,
        **{key: float(value) for key, value in measures.items()},
        **{key: PROPERTIES[key].scale * value for key, value in properties.items()},
    }


def _row(item: Shown, made: Row, space: CodeSpace) -> Row:
    scale = PROPERTIES[item.about].scale if item.about else 1.0
    return {
        "sheet": item.sheet,
        "row": item.row,
        "column": item.column,
        "about": item.about,
        "score": item.score,
        "asked": scale * item.asked,
        "like_training": str(_like_training(made, space)).lower(),
        **made,
    }


def _like_training(made: Row, space: CodeSpace) -> bool:
    """Whether it has as many openings as its type, and all properties lie where theirs do.

    That is between those of training garments, or a tenth of the span beyond. A neckline may be
    absent, as with garments that are open in front.
    """
    if made["openings"] != space.openings[str(made["garment"])]:
        return False
    for name, value in space.values.items():
        low, high = np.nanmin(value), np.nanmax(value)
        measured, aside = float(made[name]) / PROPERTIES[name].scale, _BEYOND * (high - low)
        if np.isnan(measured) and name == "neckline":
            continue
        if not low - aside <= measured <= high + aside:
            return False
    return True


def _caption(item: Shown, row: Row) -> str:
    if not item.about:
        return ""
    value = row[item.about]
    unit = PROPERTIES[item.about].unit
    text = "nothing left" if np.isnan(value) else f"{value:.0f} {unit}"
    if np.isfinite(item.score):
        return f"{round(item.score, 1) + 0.0:+.1f} dev.: {text}"
    return f"{row['asked']:.0f} asked, {text}"


def _wearer(body: BodyModel, shape: np.ndarray) -> Mesh:
    return Mesh(rest_body(body, shape).astype(np.float32), body.faces)


def _read(path: Path) -> Mesh:
    """A mesh, or an empty one where nothing was left of the garment."""
    if path.is_file():
        return load_obj(path)
    return Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))


def still_part(name: str, mesh: Mesh, colour: tuple[float, float, float]) -> ScenePart:
    """A mesh of a scene that does not move."""
    return ScenePart(name, mesh, colour, lambda start, stop: mesh.vertices[None], 1)


def make_gallery(job: Job) -> None:
    """Garments sampled, interpolated and edited, as OBJ and glTF, with what codes say of them."""
    params, model = job.params, SmplicitModel(job.input.model)
    outfits = [outfit for path in job.input.outfits for outfit in load_static(path)]
    measures = training_measures(model, outfits)
    space = code_space(model.name, model.codes, measures, model.network.settings.network.cut)
    shown = plan_gallery(model.codes, space, model.bodies, seed=params.seed, count=params.samples)
    rows = save_gallery(job.output[0], model, shown, space, Meshing(**params.meshing))
    LOGGER.info(
        "%d pictures of %d garments, %d of which have nothing left",
        len(rows),
        len({row["name"] for row in rows}),
        len({row["name"] for row in rows if not row["vertices"]}),
    )
