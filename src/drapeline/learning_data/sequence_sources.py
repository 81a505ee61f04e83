"""Sources of sequences: simulated samples, and static outfits that were put into motion."""

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from drapeline.bodies.model import load_bodies
from drapeline.dataset.point_clouds import load_clouds
from drapeline.dataset.reader import Sample
from drapeline.dataset.record import clip_name, solver_name
from drapeline.dataset.shards import samples_named, samples_of
from drapeline.errors import InputError
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.job import Job
from drapeline.learning_data.sequences import (
    SKINNED,
    GarmentSequence,
    SeenSequence,
    collect_clouds,
    collect_sequences,
)
from drapeline.learning_data.skinned import SkinnedSequence, load_skinned
from drapeline.outfits.static import load_static
from drapeline.registration.to_template.garment_template import load_template
from drapeline.registration.to_template.remesh import RemeshTable, load_tables, remesh
from drapeline.rule_log import LOGGER


def simulated_sequences(
    samples: Iterable[str | Path], clouds: Iterable[str | Path]
) -> Iterator[tuple[Sample, SeenSequence]]:
    """Accepted simulated samples.

    Args:
        samples: folders as `write_sample` leaves them.
        clouds: folders of the same samples as `write_clouds` leaves them.

    Raises:
        InputError: a file is unusable.
    """
    for folder, clouds_folder in zip(samples, clouds, strict=True):
        cloud = load_clouds(clouds_folder)
        if not cloud.accepted:
            continue
        sample = Sample(folder)
        info, meta = sample.info, sample.meta or {}
        yield (
            sample,
            SeenSequence(
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
            ),
        )


def skinned_sequences(
    folders: Iterable[str | Path],
) -> Iterator[tuple[SkinnedSequence, SeenSequence]]:
    """Static outfits put into motion.

    Args:
        folders: as `write_skinned` leaves them.

    Raises:
        InputError: a file is unusable.
    """
    for one in chain.from_iterable(map(load_skinned, folders)):
        yield (
            one,
            SeenSequence(
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
            ),
        )


def garments_in_samples(
    garment: str,
    samples: Iterable[str | Path],
    clouds: Iterable[str | Path],
    tables: Mapping[str, RemeshTable],
) -> Iterator[GarmentSequence]:
    """A type's garments among accepted simulated samples.

    Args:
        samples, clouds: see `simulated_sequences`.
        tables: sample's id -> where the template lies on its garment.

    Raises:
        InputError: a file is unusable, or a garment has no table.
    """
    for sample, seen in simulated_sequences(samples, clouds):
        if garment in sample.garments:
            table, mesh = _table(tables, sample.id, garment), sample.mesh(garment)
            yield GarmentSequence(
                **vars(seen),
                canonical=remesh(mesh.vertices, table),
                original=Mesh(mesh.vertices, mesh.triangles),
                garment=partial(_posed_sample, sample, garment, table),
            )


def _posed_sample(sample: Sample, garment: str, table: RemeshTable) -> np.ndarray:
    with sample:
        return remesh(sample.vertices(garment, frame="root"), table)


def garments_skinned(
    garment: str,
    folders: Iterable[str | Path],
    shards: Iterable[str | Path],
    tables: Mapping[str, RemeshTable],
) -> Iterator[GarmentSequence]:
    """A type's garments among static outfits put into motion.

    Args:
        folders: as `write_skinned` leaves them.
        shards: `.npz` of the static outfits of the same folders.
        tables: outfit's name -> where the template lies on its garment.

    Raises:
        InputError: a file is unusable, or a garment has no table.
    """
    for folder, shard in zip(folders, shards, strict=True):
        rest = {
            static.name: worn
            for static in load_static(shard)
            for worn in static.outfit.garments
            if worn.name == garment
        }
        for one, seen in skinned_sequences([folder]):
            if garment in one.garments:
                table, worn = _table(tables, one.name, garment), rest[one.name]
                yield GarmentSequence(
                    **vars(seen),
                    canonical=remesh(worn.vertices, table),
                    original=Mesh(worn.vertices, triangulate(worn.faces)),
                    garment=partial(remesh, one.garments[garment], table),
                )


def _table(tables: Mapping[str, RemeshTable], name: str, garment: str) -> RemeshTable:
    if name not in tables:
        raise InputError(f"{name}: its {garment} is not registered, expected a remesh table")
    return tables[name]


def collect(job: Job) -> None:
    """Sequences of a garment type, and its space of shapes at rest."""
    given, params = job.input, job.params
    tables = load_tables(given.fits)
    frames = collect_sequences(
        job.output[0],
        params.garment,
        [
            *garments_in_samples(params.garment, *_samples_and_clouds(given), tables),
            *garments_skinned(params.garment, given.skinned, given.outfits, tables),
        ],
        load_template(given.template).faces,
        params.components,
        load_bodies(given),
    )
    LOGGER.info("%d frames", frames)


def collect_all(job: Job) -> None:
    """Clouds of all sequences, whatever is worn in them."""
    given = job.input
    seen = [
        *(one for _, one in simulated_sequences(*_samples_and_clouds(given))),
        *(one for _, one in skinned_sequences(given.skinned)),
    ]
    LOGGER.info("%d frames", collect_clouds(job.output[0], seen, load_bodies(given)))


def _samples_and_clouds(given: Any) -> tuple[list[Path], list[Path]]:
    clouds = samples_of(given.clouds)
    return samples_named(given.samples, [path.name for path in clouds]), clouds
