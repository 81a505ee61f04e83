"""Evaluation of a trained model: how well its codes hold held-out garments.

A garment's code starts at the encoder's z_cut and a style of zero and is fitted to samples of its
distance field. The surfaces of the fitted field are then compared with the garment itself.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.rest_body import SHAPES, rest_body
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, mean_edge_length, triangulate
from drapeline.geometry.smoothing import averaging_matrix
from drapeline.job import Job
from drapeline.learning_data.garment_fields import FieldData
from drapeline.metrics.cost import write_costs
from drapeline.metrics.garment import (
    area_distances_mm,
    mesh_measures,
    shape_measures,
)
from drapeline.metrics.predictions import RebuiltGarment
from drapeline.metrics.registered import measured_at_rest
from drapeline.metrics.shared import REPRESENTATION
from drapeline.metrics.table import join, summarise, write_evaluation
from drapeline.models.compare import cost_so_far
from drapeline.models.contract import Stopwatch
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.network import GarmentField, Points, fit_codes, new_field
from drapeline.models.smplicit.representation import HELD_OUT, HeldOut, save_held_out
from drapeline.models.smplicit.settings import FieldFitSettings, Meshing
from drapeline.models.smplicit.surface.fields import NetworkField
from drapeline.models.smplicit.surface.sheet import garment_of_field
from drapeline.outfits.fit import RESIZE_EDGE_M, RESIZE_PASSES, resize
from drapeline.outfits.garment_types import GARMENTS, first_of_each
from drapeline.outfits.static import StaticOutfit, load_static
from drapeline.rule_log import progress
from drapeline.schema import Table

MODEL = "smplicit"
Measures = dict[str, float]
# Steps with a part of the points come first: far from the solution, they are as good as all.
_FIRST_PART = 8
_FITTED_AT_ONCE = 2  # garments, whose activations stay in the processor's cache


def true_meshes(data: FieldData, outfits: Sequence[StaticOutfit]) -> dict[int, Mesh]:
    """Row of a model's data -> its garment as triangles, among those of all static outfits."""
    wanted = {
        (str(outfit), GARMENTS[garment]): row
        for row, (outfit, garment) in enumerate(zip(data.outfit, data.garment, strict=True))
    }
    return {
        wanted[name, garment.name]: Mesh(garment.vertices, triangulate(garment.faces))
        for name, _, outfit in outfits
        for garment in outfit.garments
        if (name, garment.name) in wanted
    }


def fit_held_out(
    network: GarmentField, data: FieldData, rows: np.ndarray, settings: FieldFitSettings
) -> np.ndarray:
    """(n, cut + style) codes of garments, fitted to points of the first half of their samples.

    Args:
        network: trained.
        data: of the garments.
        rows: n of them.
    """
    found = []
    for part in np.split(rows, range(_FITTED_AT_ONCE, len(rows), _FITTED_AT_ONCE)):
        batch = data.batch(part)
        places = network.places(torch.from_numpy(batch["shape"]), torch.from_numpy(batch["gender"]))
        with torch.no_grad():
            z_cut = network.encoder(torch.from_numpy(batch["occlusion"]))
        z = torch.cat([z_cut, torch.zeros(len(part), network.decoder.style)], 1)
        for share in (_FIRST_PART, 1):
            near, space = (
                slice(max(min(count, batch[name].shape[1] // 2) // share, 1))
                for name, count in (("near", settings.near), ("space", settings.space))
            )
            points = some_points(network, batch, near, space)
            z = fit_codes(network.decoder, points, places, z, settings.latent, settings.steps)
        found.append(z.numpy())
    return np.concatenate(found)


def some_points(
    network: GarmentField, batch: Mapping[str, np.ndarray], near: slice, space: slice
) -> Points:
    """Points of a batch of `FieldData`, the same indices for all garments."""
    places = np.concatenate([batch["near"][:, near], batch["space"][:, space]], axis=1)
    distances = [batch["near_distance"][:, near], batch["space_distance"][:, space]]
    clipped = np.minimum(np.concatenate(distances, axis=1) / network.d_max_m, 1.0)
    return Points(torch.from_numpy(places), torch.from_numpy(clipped))


def field_errors(
    network: GarmentField, data: FieldData, rows: np.ndarray, z: np.ndarray
) -> list[Measures]:
    """Errors of clipped distances at points that no code was fitted to, near and in the whole box.

    Args:
        network: trained or not.
        data: of the garments.
        rows, z: (n,) garments and (n, cut + style) their codes.
    """
    batch = data.batch(rows)
    found = []
    for index, code in enumerate(z):
        field = NetworkField(network, code, batch["shape"][index], data.gender[rows[index]])
        measured = {}
        for name in ("near", "space"):
            half = batch[name].shape[1] // 2
            predicted = field.distances(batch[name][index, half:])
            true = batch[f"{name}_distance"][index, half:]
            measured[f"field_{name}_mm"] = _clipped_error_mm(predicted, true, network.d_max_m)
        found.append(measured)
    return found


def constant_errors(data: FieldData, rows: np.ndarray, d_max_m: float) -> list[Measures]:
    """`field_errors` of the trivial answer, the median distance of all training points."""
    train = data.rows("train")
    found: list[Measures] = [{} for _ in rows]
    for name in ("near", "space"):
        distances = getattr(data, f"{name}_distance")
        middle = np.median(np.minimum(distances[train], d_max_m))
        half = distances.shape[1] // 2
        for measured, row in zip(found, rows, strict=True):
            error = _clipped_error_mm(middle, distances[row, half:], d_max_m)
            measured[f"field_{name}_mm"] = error
    return found


def _clipped_error_mm(predicted: np.ndarray, true: np.ndarray, d_max_m: float) -> float:
    difference = np.clip(predicted, 0, d_max_m) - np.minimum(true, d_max_m)
    return float(1000 * np.abs(difference).mean())


def surface_measures(sheet: Mesh, true: Mesh, body: Mesh) -> Measures:
    """`mesh_measures` of an open surface, its pieces, and how much is inside the body."""
    inside = shape_measures(sheet, body.vertices, body.faces)
    return {**mesh_measures(sheet, true), **inside}


class FieldEvaluation:
    """Measures of held-out garments through a trained model, and of what they are compared with.

    Attributes:
        cost: what fitting and decoding took, once it has run.
    """

    def __init__(
        self,
        model: SmplicitModel,
        data: FieldData,
        meshes: Mapping[int, Mesh],
        *,
        meshing: Meshing,
        fit: FieldFitSettings,
        seed: int,
    ) -> None:
        self._model, self._data, self._meshes = model, data, meshes
        self._meshing, self._fit, self._seed = meshing, fit, seed

    def run(self, split: str, untrained: GarmentField) -> tuple[Table, HeldOut]:
        """All rows of a split, and what was rebuilt.

        Args:
            split: "val" or "test".
            untrained: a model of the same settings before its first step.

        Raises:
            InputError: the split has no garment of the model's types.
        """
        network, rows = self._model.network, self._data.rows(split)
        if not len(rows):
            raise InputError(
                f"the {split} split holds no {' or '.join(self._model.garments)}, expected one or"
                " more; ask for more static outfits"
            )
        watch, name = Stopwatch(), self._model.name
        with watch.of(name):
            z = fit_held_out(network, self._data, rows, self._fit)
        measures, sheets = self._decoded(rows, z, "fitted", watch)
        self.cost = cost_so_far(REPRESENTATION, name, watch.seconds[name], len(rows))
        errors = field_errors(network, self._data, rows, z)
        found = {"fitted": [a | b for a, b in zip(errors, measures, strict=True)]}
        mean = np.repeat(self._model.mean_code[None], len(rows), axis=0)
        errors = field_errors(network, self._data, rows, mean)
        of_mean = self._mean_garments(rows)
        found["mean_code"] = [a | b for a, b in zip(errors, of_mean, strict=True)]
        cut = network.decoder.cut
        for name, part in (("cut", slice(0, cut)), ("style", slice(cut, None))):
            found[f"nearest_{name}"] = list(self._nearest(rows, z[:, part], part))
        random = fit_held_out(untrained, self._data, rows, self._fit)
        found["untrained"] = field_errors(untrained, self._data, rows, random)
        found["constant"] = constant_errors(self._data, rows, network.d_max_m)
        table = join(self._rows(name, part, rows, split) for name, part in found.items())
        return table, HeldOut(self._data.outfit[rows], self._data.garment[rows], z, sheets)

    def _body(self, row: int) -> Mesh:
        body = self._model.bodies[self._data.gender[row]]
        return Mesh(rest_body(body, self._data.shape[row]), body.faces)

    def _decoded(
        self, rows: np.ndarray, z: np.ndarray, label: str, watch: Stopwatch
    ) -> tuple[list[Measures], list[Mesh]]:
        measures, sheets = [], []
        pairs = zip(rows, z, strict=True)
        for row, code in progress(pairs, total=len(rows), label=label):
            shape, gender = self._data.shape[row], self._data.gender[row]
            with watch.of(self._model.name):
                field = NetworkField(self._model.network, code, shape, gender)
                body = self._body(row)
                sheet, walls = garment_of_field(field, self._model.box, body, self._meshing)
            true = self._meshes[int(row)]
            to_true, to_walls = area_distances_mm(walls, true)
            measures.append(
                {
                    **surface_measures(sheet, true, body),
                    "walls_to_true_mm": to_true,
                    "true_to_walls_mm": to_walls,
                }
            )
            sheets.append(sheet)
        return measures, sheets

    def _mean_garments(self, rows: np.ndarray) -> Iterator[Measures]:
        """The surface of the mean code on each gender's mean body, carried to the wearer's."""
        known: dict[str, tuple[Mesh, Mesh]] = {}
        for row in rows:
            gender = self._data.gender[row]
            if gender not in known:
                model, shape = self._model.bodies[gender], np.zeros(SHAPES)
                mean = Mesh(rest_body(model, shape), model.faces)
                field = NetworkField(self._model.network, self._model.mean_code, shape, gender)
                found = garment_of_field(field, self._model.box, mean, self._meshing)
                known[gender] = found.sheet, mean
            sheet, mean = known[gender]
            body = self._body(row)
            garment = (
                transfer_to_body(sheet, mean.vertices, body.vertices) if len(sheet.faces) else sheet
            )
            yield surface_measures(garment, self._meshes[int(row)], body)

    def _nearest(self, rows: np.ndarray, z: np.ndarray, part: slice) -> Iterator[Measures]:
        """The training garment with the nearest code, carried to the wearer's body."""
        codes = self._model.codes
        known = self._data.rows("train")
        for row, code in zip(rows, z, strict=True):
            near = int(np.linalg.norm(codes.z[:, part] - code, axis=1).argmin())
            body, other = self._body(row), self._body(known[near])
            garment = transfer_to_body(
                self._meshes[int(known[near])], other.vertices, body.vertices
            )
            yield surface_measures(garment, self._meshes[int(row)], body)

    def _rows(self, name: str, measures: Sequence[Measures], rows: np.ndarray, split: str) -> Table:
        variant = f"{MODEL}_{self._model.name}_{name}"
        measured = measured_at_rest(self._data, rows, measures)
        return summarise(
            measured,
            model=MODEL,
            variant=variant,
            split=split,
            seed=self._seed,
            stream=(variant, split),
            by_source=False,
        )


def transfer_to_body(garment: Mesh, body: np.ndarray, other: np.ndarray) -> Mesh:
    """A garment on a body (V, 3) moved to another one, as the body under it moves (6.1)."""
    average = averaging_matrix(garment.faces, len(garment.vertices))
    edge_m = mean_edge_length(garment.vertices, garment.faces)
    passes = round(RESIZE_PASSES * (RESIZE_EDGE_M / edge_m) ** 2)
    return Mesh(resize(garment.vertices, average, body, other, passes), garment.faces)


def rebuilt_garments(
    model: SmplicitModel,
    data: FieldData,
    meshes: Mapping[int, Mesh],
    held_out: Mapping[tuple[str, str], tuple[np.ndarray, Mesh]],
    meshing: Meshing,
) -> list[RebuiltGarment]:
    """The first held-out garment of each of a model's types, with `meshes` as they were made."""
    rows = {(str(data.outfit[row]), GARMENTS[data.garment[row]]): row for row in range(len(data))}
    return [
        _rebuilt(model, data, rows[key], meshes, *held_out[key], meshing)
        for key in first_of_each((key[1], key) for key in held_out)
    ]


def _rebuilt(
    model: SmplicitModel,
    data: FieldData,
    row: int,
    meshes: Mapping[int, Mesh],
    z: np.ndarray,
    sheet: Mesh,
    meshing: Meshing,
) -> RebuiltGarment:
    garment, gender = GARMENTS[data.garment[row]], data.gender[row]
    wearer = {"gender": gender, "shape": data.shape[row]}
    body = model.bodies[gender]
    return RebuiltGarment(
        f"{garment}\n{gender}",
        garment,
        meshes[row],
        sheet,
        model.decode(z, **wearer, meshing=meshing).walls,
        model.decode(model.mean_code, **wearer, meshing=meshing).sheet,
        Mesh(rest_body(body, data.shape[row]), body.faces),
    )


def evaluate(job: Job) -> None:
    """Codes and surfaces of held-out garments, with their metrics."""
    given, params = job.input, job.params
    torch.set_num_threads(job.threads)
    model, data = SmplicitModel(given.model), FieldData(given.data)
    outfits = [outfit for shard in given.outfits for outfit in load_static(shard)]
    evaluation = FieldEvaluation(
        model,
        data,
        true_meshes(data, outfits),
        meshing=Meshing(**params.meshing),
        fit=FieldFitSettings(**params.fit),
        seed=params.seed,
    )
    untrained = new_field(model.name, data, model.bodies, model.network.settings).eval()
    rows, held_out = evaluation.run(params.split, untrained)

    def complete(made: Path) -> None:
        save_held_out(made / HELD_OUT, held_out)
        write_costs(made, [evaluation.cost])

    write_evaluation(job.output[0], rows, complete)
