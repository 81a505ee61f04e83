"""Registration of simulated samples."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.bodies.weight_transfer import nearest_weights
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import read_record
from drapeline.geometry.mesh import faces_within
from drapeline.registration.error_table import FILE_NAME, error_rows, write_errors
from drapeline.registration.to_body.dynamic_offsets import SampleGarment
from drapeline.registration.to_body.registrar import Registrar
from drapeline.storage import atomic_folder, write_json


def register_sample(
    output: str | Path, sample: str | Path, registrar: Registrar, bodies: Mapping[str, BodyModel]
) -> str:
    """Register the garments of one sample in their rest pose.

    Args:
        output: folder for `{Garment}.npz`, `metrics.tsv` and `status.json`; of a rejected sample
            only the last is written.
        sample: folder as `write_sample` leaves it.
        registrar: on the topology of the super-resolved body.
        bodies: super-resolved, by gender.

    Returns:
        The sample's status, "accepted" or "rejected".

    Raises:
        InputError: a file of the sample is unusable, or a garment covers no part of the body.
    """
    record = read_record(sample)
    status = {key: record.meta[key] for key in ("id", "status", "reason", "split")}
    with atomic_folder(output) as scratch:
        write_json(scratch / "status.json", status)
        if record.accepted:
            _register(scratch, Path(sample), registrar, bodies)
    return status["status"]


def _register(
    folder: Path, sample: Path, registrar: Registrar, bodies: Mapping[str, BodyModel]
) -> None:
    errors, topology = [], registrar.topology
    with Sample(sample) as sequence:
        model = bodies[sequence.gender]
        body = rest_body(model, sequence.info.shape)
        for name in sequence.garments:
            mesh = sequence.mesh(name)
            done = registrar.register(name, mesh.vertices, mesh.faces, body)
            faces = faces_within(topology.faces_of(name), done.match.mask)
            vertex = np.flatnonzero(done.match.mask).astype(np.int32)
            points = body + done.offsets
            weights = nearest_weights(points, faces, body, topology.faces, model.weights)
            SampleGarment(
                mask=done.match.mask,
                vertex=vertex,
                corner=done.match.corner[vertex],
                bary=done.match.bary[vertex],
                offsets=done.offsets,
                weights=weights[vertex],
            ).save(folder / f"{name}.npz")
            errors += error_rows(name, sequence.id, done.measures)
    write_errors(folder / FILE_NAME, errors)
