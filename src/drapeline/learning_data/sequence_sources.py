"""Sources of sequences: simulated samples, and static outfits that were put into motion."""

from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from drapeline.bodies.model import load_bodies
from drapeline.dataset.point_clouds import load_clouds
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import clip_name, solver_name
from drapeline.dataset.shards import samples_named, samples_of
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.job import Job
from drapeline.learning_data.sequences import SKINNED, GarmentSequence, collect_sequences
from drapeline.learning_data.skinned import load_skinned
from drapeline.outfits.static import load_static
from drapeline.registration.to_template.garment_template import load_template
from drapeline.registration.to_template.remesh import RemeshTable, load_tables, remesh
from drapeline.rule_log import LOGGER


def simulated_sequences(
    garment: str,
    samples: Iterable[str | Path],
    clouds: Iterable[str | Path],
    tables: Mapping[str, RemeshTable],
) -> list[GarmentSequence]:
    """A type's garments among accepted simulated samples.

    Args:
        samples: folders as `write_sample` leaves them.
        clouds: folders of the same samples as `write_clouds` leaves them.
        tables: sample's id -> where the template lies on its garment.

    Raises:
        InputError: a file is unusable, or a garment has no table.
    """
    sequences = []
    for folder, clouds_folder in zip(samples, clouds, strict=True):
        cloud = load_clouds(clouds_folder)
        if not cloud.accepted or garment not in cloud.about["garments"]:
            continue
        sample = Sample(folder)
        table, mesh, info = _table(tables, sample.id, garment), sample.mesh(garment), sample.info
        meta = sample.meta or {}
        sequences.append(
            GarmentSequence(
                name=sample.id,
                source=solver_name(meta),
                split=cloud.about["split"],
                clip=clip_name(meta, sample.id),
                gender=info.gender,
                shape=np.asarray(info.shape),
                poses=np.asarray(info.poses),
                trans=np.asarray(info.trans),
                number=np.arange(sample.frame_count),
                points=cloud.points,
                labels=cloud.labels,
                canonical=remesh(mesh.vertices, table),
                original=Mesh(mesh.vertices, mesh.triangles),
                garment=partial(_posed_sample, sample, garment, table),
            )
        )
    return sequences


def _posed_sample(sample: Sample, garment: str, table: RemeshTable) -> np.ndarray:
    with sample:
        return remesh(sample.vertices(garment, frame="root"), table)


def skinned_sequences(
    garment: str,
    folders: Iterable[str | Path],
    shards: Iterable[str | Path],
    tables: Mapping[str, RemeshTable],
) -> list[GarmentSequence]:
    """A type's garments among static outfits put into motion.

    Args:
        folders: as `write_skinned` leaves them.
        shards: `.npz` of the static outfits of the same folders.
        tables: outfit's name -> where the template lies on its garment.

    Raises:
        InputError: a file is unusable, or a garment has no table.
    """
    sequences = []
    for folder, shard in zip(folders, shards, strict=True):
        rest = {
            static.name: worn
            for static in load_static(shard)
            for worn in static.outfit.garments
            if worn.name == garment
        }
        for one in load_skinned(folder):
            if garment not in one.garments:
                continue
            table, worn = _table(tables, one.name, garment), rest[one.name]
            sequences.append(
                GarmentSequence(
                    name=one.name,
                    source=SKINNED,
                    split=one.split,
                    clip=one.sample,
                    gender=one.gender,
                    shape=one.shape,
                    poses=one.poses,
                    # Nothing but its pose is known to skinning.
                    trans=np.zeros((len(one.poses), 3)),
                    number=one.number,
                    points=one.points,
                    labels=one.labels,
                    canonical=remesh(worn.vertices, table),
                    original=Mesh(worn.vertices, triangulate(worn.faces)),
                    garment=partial(remesh, one.garments[garment], table),
                )
            )
    return sequences


def _table(tables: Mapping[str, RemeshTable], name: str, garment: str) -> RemeshTable:
    if name not in tables:
        raise InputError(f"{name}: its {garment} is not registered, expected a remesh table")
    return tables[name]


def collect(job: Job) -> None:
    """Sequences of a garment type, and its space of shapes at rest."""
    given, params = job.input, job.params
    tables, clouds = load_tables(given.fits, params.garment), samples_of(given.clouds)
    samples = samples_named(given.samples, [path.name for path in clouds])
    frames = collect_sequences(
        job.output[0],
        params.garment,
        [
            *simulated_sequences(params.garment, samples, clouds, tables),
            *skinned_sequences(params.garment, given.skinned, given.outfits, tables),
        ],
        load_template(given.template).faces,
        params.components,
        load_bodies(given),
    )
    LOGGER.info("%d frames", frames)
