"""Garments for pictures: reconstructions, transitions, and wrinkles on other garments.

CLOTH3D figures 7, 9 and 10.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from drapeline.bodies.model import BodyModel, load_bodies, load_body, posed_vertices
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.mesh import Mesh, triangulate
from drapeline.job import Job
from drapeline.learning_data.dynamic import HISTORY_FRAMES
from drapeline.learning_data.moving import MovingFiles, moving_files_test_first
from drapeline.learning_data.static import StaticData
from drapeline.metrics.garment import garment_mesh, surface_error_mm
from drapeline.metrics.predictions import GarmentCase, WornGarment
from drapeline.models.gcvae.codec import (
    CODES,
    Codes,
    GarmentCodec,
    decode_codes,
    encode_garments,
    load_codes,
)
from drapeline.models.gcvae.data import DynamicGarments, StaticGarments
from drapeline.models.gcvae.decode import decode_points_for_display, static_truth
from drapeline.models.gcvae.load import load_codec, load_dynamic_garments
from drapeline.models.gcvae.sample import (
    GarmentTypes,
    decode_by_type,
    load_samples,
    load_types,
    mend,
    smooth_bootstrap,
    wearer_mesh,
)
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS, SKIRTS, first_of_each
from drapeline.outfits.static import load_static
from drapeline.registration.to_body.topology import Topology, load_topology
from drapeline.rendering.raytracer import ray_share
from drapeline.report.models.gcvae.figures import (
    ERROR_COLUMNS,
    animate_views,
    error_views,
    plot_codes,
    plot_samples,
    walk_view,
    worn_view,
)
from drapeline.report.models.scene import GarmentPicture, plot_views
from drapeline.seeding import rng_for

_MEAN_FRAMES = 64  # whose mean wrinkle code stands for that of a type
_WRINKLE_BANDWIDTH = 0.4  # in deviations of the frames of a type


def static_cases(
    model: GarmentCodec,
    garments: StaticGarments,
    codes: Codes,
    shards: Iterable[str | Path],
    bodies: Mapping[str, BodyModel],
) -> list[GarmentCase]:
    """The first test garment of each type.

    Args:
        shards: files of the static outfits.
        bodies: whole bodies, by gender.

    Raises:
        InputError: a shard is missing or damaged.
    """
    rows = first_of_each((GARMENTS[garments.garment[r]], int(r)) for r in garments.rows("test"))
    wanted = {str(garments.outfit[row]) for row in rows}
    outfits = {
        static.name: static.outfit
        for shard in shards
        for static in load_static(shard)
        if static.name in wanted
    }
    truth = static_truth(model.body_template, garments)
    chosen = np.array(rows)
    decoded = decode_codes(
        model, codes.mean[chosen], garments.cvar(chosen), garments.topology(chosen)
    )
    cases = []
    for row, (offsets, mask) in zip(rows, decoded, strict=True):
        garment, outfit = GARMENTS[garments.garment[row]], outfits[str(garments.outfit[row])]
        original = next(g for g in outfit.garments if g.name == garment)
        body, true_mask = truth.body(row), np.asarray(truth.mask[row])
        true, predicted = body + truth.offsets[row], body + offsets
        cases.append(
            GarmentCase(
                label=f"{garment}\n{surface_error_mm(predicted, true, true_mask):.1f} mm",
                original=Mesh(original.vertices, triangulate(original.faces)),
                true=true,
                mask=true_mask,
                predicted=predicted,
                predicted_mask=true_mask if mask is None else mask,
                faces=truth.faces(row),
                wearer=_wearer(bodies[outfit.gender], outfit.shape, REST_POSE),
                root_rotation=REST_POSE[:3],
            )
        )
    return cases


def moving_cases(
    model: GarmentCodec,
    garments: DynamicGarments,
    files: Sequence[MovingFiles],
    super_bodies: Mapping[str, BodyModel],
    bodies: Mapping[str, BodyModel],
    topology: Topology,
) -> list[GarmentCase]:
    """The middle frame of the first garment of each type in motion; held-out files come first."""
    cases = []
    for first in first_of_each((file.name, file) for file in files):
        moving = first.load()
        rows = garments.data.rows_of(moving.sample, moving.name)
        row = rows[[len(rows) // 2]]
        z = encode_garments(model, garments, row).mean
        body = super_bodies[moving.gender]
        frame = garments.data.frame[row]
        points = decode_points_for_display(model, garments, row, moving, body, topology, z)
        (true,) = moving.points(frame)
        mask = moving.registered.mask
        true, predicted = moving.on_vertices(true), moving.on_vertices(points[0])
        pose = moving.poses[frame[0]]
        where = "in motion" if moving.split == "test" else f"in motion ({moving.split})"
        cases.append(
            GarmentCase(
                label=f"{moving.name}\n{where}\n{surface_error_mm(predicted, true, mask):.1f} mm",
                original=Mesh(moving.cloth[frame[0]], moving.faces),
                true=true,
                mask=mask,
                predicted=predicted,
                predicted_mask=mask,
                faces=topology.faces_of(moving.name),
                wearer=_wearer(bodies[moving.gender], moving.shape, pose),
                root_rotation=pose[:3],
            )
        )
    return cases


def wrinkle_rows(
    rng: np.random.Generator,
    model: GarmentCodec,
    garments: DynamicGarments,
    files: Sequence[MovingFiles],
    super_bodies: Mapping[str, BodyModel],
    bodies: Mapping[str, BodyModel],
    topology: Topology,
    columns: int,
) -> dict[str, list[WornGarment]]:
    """The rows of figure 10, all from one held-out frame.

    Args:
        files: held-out garments first; a skirt or dress among them, where there is one, gives
            frame, pose and wrinkle code.
        super_bodies, bodies: super-resolved and whole bodies, by gender.
        columns: pictures per row.

    Returns:
        Name -> garments: "pose" keeps code and garment, "garment" keeps code and pose, "codes,
        at rest" and "codes, in motion" keep garment and pose under codes near those of training
        frames.
    """
    data = garments.data
    rows_by = [data.rows_of(one.sample, one.name) for one in files]
    bend = [np.linalg.norm(data.poses[rows, 0, 3:], axis=1) for rows in rows_by]
    held_out = [k for k, one in enumerate(files) if one.split == files[0].split]
    loose = [k for k in held_out if files[k].name in SKIRTS] or held_out
    # Of the liveliest, cloth that flies would be put on bodies that stand.
    chosen = sorted(loose, key=lambda k: np.ptp(bend[k]))[(len(loose) - 1) // 2]
    rows = rows_by[chosen]
    lively = rows[[bend[chosen].argmax()]]
    z = encode_garments(model, garments, lively).mean
    first = first_of_each((one.name, k) for k, one in enumerate(files))
    shown = {k: files[k].load() for k in {chosen, *first}}

    def decode_worn(which: int, codes: np.ndarray, poses: np.ndarray) -> list[WornGarment]:
        other = shown[which]
        own = np.repeat(rows_by[which][:1], len(codes))
        body = super_bodies[other.gender]
        points = decode_points_for_display(
            model, garments, own, other, body, topology, codes, poses
        )
        faces, mask = topology.faces_of(other.name), other.registered.mask
        return [
            WornGarment(
                other.name,
                garment_mesh(other.on_vertices(p), faces, mask),
                _wearer(bodies[other.gender], other.shape, pose),
                pose[:3],
            )
            for p, pose in zip(points, poses[:, 0], strict=True)
        ]

    spread = rows[np.linspace(0, len(rows) - 1, columns).astype(int)]
    random_codes = _wrinkle_codes(rng, model, garments, files[chosen].name, columns)
    rest = np.tile(REST_POSE.astype(np.float32), (columns, HISTORY_FRAMES, 1))
    return {
        "pose": decode_worn(chosen, np.repeat(z, columns, 0), data.poses[spread]),
        "garment": [w for k in first for w in decode_worn(k, z, data.poses[lively])],
        "codes,\nat rest": decode_worn(chosen, random_codes, rest),
        "codes,\nin motion": decode_worn(
            chosen, random_codes, np.repeat(data.poses[lively], columns, 0)
        ),
    }


def _wrinkle_codes(
    rng: np.random.Generator, model: GarmentCodec, garments: DynamicGarments, name: str, count: int
) -> np.ndarray:
    """(count, Z) codes near those of training frames of a type, or of any if it has none.

    A smoothed bootstrap, since the prior mixes the wrinkles of all types.
    """
    data, rows = garments.data, garments.rows("train")
    of_type = rows[data.garment[data.garment_index[rows]] == GARMENTS.index(name)]
    chosen = rng.choice(of_type if len(of_type) else rows, max(2 * count, _MEAN_FRAMES))
    codes = encode_garments(model, garments, chosen).mean
    mean = codes.mean(axis=0)
    near, noise = codes[:count] - mean, codes[count : 2 * count] - mean
    return smooth_bootstrap(mean, near, noise, _WRINKLE_BANDWIDTH)


def _wearer(body: BodyModel, shape: np.ndarray, pose: np.ndarray) -> Mesh:
    return Mesh(posed_vertices(body, shape, pose[None])[0][0], body.faces)


_SHAPE_SPAN, _TIGHT, _LOOSE = 2.5, 0.5, -1.5


End: TypeAlias = tuple[np.ndarray, np.ndarray]  # code (Z,) and conditions (13,)


class Step(NamedTuple):
    """A garment on the way."""

    garment: str  # its likeliest type, one of `GARMENTS`
    mesh: Mesh  # in rest pose, mended
    cvar: np.ndarray  # (13,) conditions that it was decoded with


def interpolate(
    model: GarmentCodec, types: GarmentTypes, start: End, end: End, steps: int
) -> list[Step]:
    """Decode evenly spaced points between two ends.

    Each is decoded on the topology of its likeliest type, and mended like a sampled garment.
    """
    share = np.linspace(0, 1, steps)[:, None]
    z, cvar = (a + share * (b - a) for a, b in zip(start, end, strict=True))
    out = []
    template = model.body_template
    decoded = decode_by_type(model, types, z, cvar, [None] * steps)
    for (garment, offsets, mask), condition in zip(decoded, cvar, strict=True):
        mesh = mend(model, garment, template.rest_body(condition), offsets, mask)
        out.append(Step(garment, mesh, condition))
    return out


def ends_of_figure_9(
    garments: StaticGarments, rows: np.ndarray, codes: Codes
) -> dict[str, tuple[End, End]]:
    """Where the rows of figure 9 start and end, to `interpolate` between.

    They are shape, tightness, cloth, cloth across topologies, and all at once.

    Args:
        rows: (n,) garments; the first of each type is where a row starts or ends. A row that needs
            a type not among them is left out.
        codes: (n, Z) of these garments.

    Returns:
        What changes -> ends.
    """
    garment_indices = np.asarray(garments.garment)[rows]
    cvar = garments.cvar(rows)
    first: Mapping[str, int] = {
        name: int(np.flatnonzero(garment_indices == index)[0])
        for index, name in enumerate(GARMENTS)
        if (garment_indices == index).any()
    }

    def at(name: str, **changed: object) -> End:
        """A garment's code and conditions, with another shape or tightness."""
        condition = cvar[first[name]].copy()
        for part, value in changed.items():
            condition[_CVAR_PARTS[part]] = value
        return codes.mean[first[name]], condition

    def tightness(name: str, value: float) -> list[float]:
        female = cvar[first[name]][10] == 0
        return [-value if female else value, value]

    average = np.zeros(10)
    small, large = np.zeros((2, 10))
    small[:2], large[:2] = -_SHAPE_SPAN, _SHAPE_SPAN
    needed_types: dict[str, tuple[str, ...]] = {
        "shape": ("Dress",),
        "tightness": ("Tshirt",),
        "cloth": ("Top", "Jumpsuit"),
        "topology": ("Jumpsuit", "Dress"),
        "all": ("Skirt", "Tshirt"),
    }
    ends_of: dict[str, Callable[..., tuple[End, End]]] = {
        "shape": lambda a: (at(a, shape=small), at(a, shape=large)),
        "tightness": lambda a: (
            at(a, shape=average, tightness=tightness(a, _TIGHT)),
            at(a, shape=average, tightness=tightness(a, _LOOSE)),
        ),
        "cloth": lambda a, b: (at(a), (codes.mean[first[b]], at(a)[1])),
        "topology": lambda a, b: (at(a), (codes.mean[first[b]], at(a)[1])),
        "all": lambda a, b: (at(a), at(b)),
    }
    return {
        name: ends_of[name](*needed)
        for name, needed in needed_types.items()
        if all(garment in first for garment in needed)
    }


_CVAR_PARTS = {"shape": slice(0, 10), "tightness": slice(11, 13)}


def plot_sampled(job: Job) -> None:
    """Sampled garments on their wearers."""
    bodies, views = load_bodies(job.input), {}
    samples = load_samples(job.input.samples)[: job.params.shown]
    mixed = len({sample.asked for sample in samples}) > 1
    for sample in samples:
        caption = f"{sample.name} {sample.garment}" + " (asked)" * (mixed and sample.asked)
        views[caption] = walk_view(sample.hung, wearer_mesh(bodies, sample.cvar), sample.garment)
    with ray_share(job.params.rays):
        plot_samples(job.output[0], views)


def plot_evaluated_codes(job: Job) -> None:
    """Codes of static garments by type, as figure 8 of the paper."""
    codes, about = load_codes(Path(job.input.evaluated) / CODES)
    types = [GARMENTS[garment_index] for garment_index in about["garment"]]
    plot_codes(job.output[0], codes.mean, types, about["split"].tolist())


def plot_walks(job: Job) -> None:
    """Transitions between garments through their codes, as figure 9 of the paper."""
    given, params = job.input, job.params
    model, data = load_codec(Path(given.model) / BEST), StaticData(given.data)
    codes, _ = load_codes(Path(given.evaluated) / CODES)
    bodies, types = load_bodies(given), load_types(given.model)
    # Held-out garments where there is one of a type.
    rows = np.concatenate([data.rows(split) for split in ("test", "val", "train")])

    ends = ends_of_figure_9(data, rows, codes.of(rows))

    def views(name: str, steps: int) -> list[GarmentPicture]:
        way = interpolate(model, types, *ends[name], steps)
        return [walk_view(at.mesh, wearer_mesh(bodies, at.cvar), at.garment) for at in way]

    moving = next(name for name in ("topology", "cloth", "shape", *ends) if name in ends)
    with ray_share(params.rays):
        plot_views(job.output.sheet, {name: views(name, params.steps) for name in ends})
        animate_views(job.output.moving, views(moving, params.frames))


def plot_errors(job: Job) -> None:
    """Reconstructions and their errors, as figure 7 of the paper."""
    given = job.input
    bodies = load_bodies(given)
    cases = static_cases(
        load_codec(Path(given.svae) / BEST),
        StaticData(given.data),
        load_codes(Path(given.evaluated) / CODES)[0],
        given.outfits,
        bodies,
    )
    moving, refined, topology = _moving_files(job)
    cases += moving_cases(*moving, refined, bodies, topology)
    rows = {case.label: error_views(case) for case in cases}
    with ray_share(job.params.rays):
        plot_views(job.output[0], rows, columns=ERROR_COLUMNS, heat=True)


def plot_wrinkles(job: Job) -> None:
    """Wrinkle codes on other garments, as figure 10 of the paper."""
    moving, refined, topology = _moving_files(job)
    rows = wrinkle_rows(
        rng_for(job.params.seed, "wrinkle codes"),
        *moving,
        refined,
        load_bodies(job.input),
        topology,
        job.params.columns,
    )
    views = {name: [worn_view(worn) for worn in row] for name, row in rows.items()}
    with ray_share(job.params.rays):
        plot_views(job.output[0], views)


def _moving_files(
    job: Job,
) -> tuple[tuple[GarmentCodec, DynamicGarments, list[MovingFiles]], dict[str, BodyModel], Topology]:
    """The dynamic model, its garments and their files; refined bodies; topology."""
    given = job.input
    garments = load_dynamic_garments(given.dynamic, given.static, job.params.frames)
    files = moving_files_test_first(given.samples, given.registrations)
    refined = {gender: load_body(given[f"super_{gender}"]) for gender in GENDERS}
    codec = load_codec(Path(given.dvae) / BEST)
    return (codec, garments, files), refined, load_topology(given.topology)
