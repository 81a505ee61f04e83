"""New garments: codes drawn from the prior or near those of a type, decoded, and their files.

A code has to be decoded on one of two topologies, so its type must be known first. Each type is a
Gaussian with the mean of its training codes and a covariance common to all types; the masks that
a code decodes to tell types apart where codes do not: the code alone tells skirts from trousers,
and the masks tell what a code far from all training codes looks like. New codes of a type come
from a smoothed bootstrap of its training codes (Silverman, "Density estimation", 1986, 6.4): a
Gaussian as wide as the type has most of its mass where hems of several lengths mix, and no garment
is like that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist
from scipy.special import logsumexp

from drapeline.bodies.model import BodyModel, load_bodies, posed_vertices
from drapeline.bodies.rest_body import signed_tightness
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.scene_part import BODY_COLOUR, PLAIN_COLOUR, ScenePart
from drapeline.errors import InputError
from drapeline.frames import GENDERS, REST_POSE
from drapeline.generation.moving_sheets import SolverDraper, job_draper
from drapeline.geometry.collision import PenetrationResolver
from drapeline.geometry.mesh import Mesh, boundary_edges, edge_graph, edges
from drapeline.geometry.obj import load_obj, save_obj
from drapeline.geometry.smoothing import averaging_matrix, fairing, fill_dents
from drapeline.job import Job
from drapeline.learning_data.static import static_cvar
from drapeline.metrics.garment import garment_mesh, inside_measures, largest_piece, shape_measures
from drapeline.metrics.likeness import cloth_measures, self_crossings
from drapeline.models.gcvae.codec import GarmentCodec, decode_codes
from drapeline.models.gcvae.load import TrainingCodes, load_codec, load_training_codes
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import TOPOLOGIES, topology_codes
from drapeline.rule_log import LOGGER, progress
from drapeline.seeding import rng_for
from drapeline.storage import atomic_folder, load_npz, save_npz, write_rows

_SHRINKAGE = 0.05  # of the covariance towards a multiple of the identity

_RIDGE = 30.0  # penalty of the regression of codes on conditions, counted in garments
_NEVER_VARIES = 1e-9
_LEAST_SHARE = 0.1  # of a garment that a regression without it leaves
_BANDWIDTHS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)

# What mends a decoded garment: strength of `fairing`, and waves and passes of `fill_dents`.
_FAIRING, _DENT_M, _DENT_PASSES = 50.0, 0.35, 3
_HOLE_SHARE = 0.02  # of the body's vertices; a larger hole is meant

_RATE_FLOOR = 0.01  # a vertex that no training garment covers is unlikely, not impossible


@dataclass(frozen=True)
class GarmentTypes:
    """What the training garments of each of K types say of a code: p(z | type, conditions)."""

    share: np.ndarray  # (K,) of the training garments, 0 for a type that none of them has
    mean: np.ndarray  # (K, Z) of the codes
    conditions: np.ndarray  # (K, C) mean conditions of a type
    slope: np.ndarray  # (K, C, Z) of a ridge regression of codes on conditions, both from the means
    factor: np.ndarray  # (Z, Z) lower Cholesky factor of what the regression leaves, in all types
    bandwidth: float  # of the smoothed bootstrap, in deviations of what the regression leaves
    # residual, garment: (n, Z) and (n,) of the training garments, indices into `GARMENTS`.
    residual: np.ndarray
    garment: np.ndarray
    mask_rate: np.ndarray  # (K, V) share of the type's garments that cover a vertex

    def expected(self, cvar: np.ndarray) -> np.ndarray:
        """(K, Z) mean code of each type on conditions (C,)."""
        return self.mean + np.einsum("kc,kcz->kz", cvar - self.conditions, self.slope)

    def draw(self, rng: np.random.Generator, garment: str, cvar: np.ndarray) -> np.ndarray:
        """Draw a code (Z,) for conditions (C,), by how garments of the type differ on theirs.

        Raises:
            InputError: no training garment is of that type.
        """
        garment_index = GARMENTS.index(garment)
        if not self.share[garment_index]:
            known = ", ".join(np.array(GARMENTS)[self.share > 0])
            raise InputError(f"no training garment is a {garment}, expected one of {known}")
        mean = self.expected(cvar)[garment_index]
        near = self.residual[rng.choice(np.flatnonzero(self.garment == garment_index))]
        noise = self.factor @ rng.standard_normal(len(mean))
        return smooth_bootstrap(mean, near, noise, self.bandwidth)

    def log_likelihood(self, z: np.ndarray, mask: np.ndarray, cvar: np.ndarray) -> np.ndarray:
        """(K,) of each type, given a code (Z,), masks (K, V) decoded for each, and conditions (C,).

        The vertices of a mask err alike, so all of them together count as much as the Z numbers.
        """
        away = np.linalg.solve(self.factor, (z - self.expected(cvar)).T)
        rate = np.clip(self.mask_rate, _RATE_FLOOR, 1 - _RATE_FLOOR)
        by_vertex = np.where(mask, np.log(rate), np.log(1 - rate))
        known = self.share > 0
        prior = np.where(known, np.log(np.where(known, self.share, 1)), -np.inf)
        return prior - (away**2).sum(axis=0) / 2 + len(z) * by_vertex.mean(axis=1)


def smooth_bootstrap(
    mean: np.ndarray, near: np.ndarray, noise: np.ndarray, bandwidth: float
) -> np.ndarray:
    """A smoothed bootstrap that keeps mean and covariance.

    Args:
        mean: (Z,) of the codes.
        near: (..., Z) deviation from the mean of a training code.
        noise: (..., Z) deviation of another code of the same distribution.
        bandwidth: 0 for training codes, 1 for noise alone.
    """
    return mean + np.sqrt(1 - bandwidth**2) * near + bandwidth * noise


def fit_types(training: TrainingCodes) -> GarmentTypes:
    """Estimate p(z | type, conditions) from the training garments of a model.

    Codes depend on the conditions too, though the networks' prior does not: by a ridge regression
    in each type. What it leaves is drawn by a smoothed bootstrap, whose bandwidth is the one by
    which each training garment is likeliest, given the others.
    """
    codes, garment, cvar, rate = training
    count = np.bincount(garment, minlength=len(GARMENTS))
    mean, conditions = (_type_means(x, garment, count) for x in (codes.mean, cvar))
    scale = (cvar - conditions[garment]).std(axis=0) + _NEVER_VARIES
    slope = np.zeros((len(GARMENTS), cvar.shape[1], codes.mean.shape[1]))
    residual = codes.mean - mean[garment]
    left_out = residual.copy()  # of each garment by a regression without it
    for index in np.flatnonzero(count):
        own = garment == index
        given = (cvar[own] - conditions[index]) / scale
        weights = np.linalg.solve(given.T @ given + _RIDGE * np.eye(given.shape[1]), given.T)
        slope[index] = weights @ residual[own] / scale[:, None]
        left = residual[own] - given @ (weights @ residual[own])
        leverage = np.einsum("nc,cn->n", given, weights) + 1 / count[index]
        residual[own] = left
        left_out[own] = left / np.maximum(1 - leverage, _LEAST_SHARE)[:, None]
    within = residual.T @ residual / len(residual)
    within += np.diag(np.exp(codes.log_variance).mean(axis=0))
    # With about as many garments as dimensions the covariance alone would be near singular.
    even = np.trace(within) / len(within) * np.eye(len(within))
    factor = np.linalg.cholesky((1 - _SHRINKAGE) * within + _SHRINKAGE * even)
    bandwidth = _likeliest_bandwidth(np.linalg.solve(factor, left_out.T).T, garment)
    return GarmentTypes(
        count / count.sum(), mean, conditions, slope, factor, bandwidth, residual, garment, rate
    )


def _type_means(values: np.ndarray, garment: np.ndarray, count: np.ndarray) -> np.ndarray:
    mean = np.zeros((len(count), values.shape[1]))
    np.add.at(mean, garment, values)
    return mean / np.maximum(count, 1)[:, None]


def _likeliest_bandwidth(whitened: np.ndarray, garment: np.ndarray) -> float:
    """Of `_BANDWIDTHS` the one by which garments are likeliest, each given the others of its type.

    Args:
        whitened: (n, Z) what the regression leaves of each garment, of unit covariance.
        garment: (n,) types.
    """

    def log_density(bandwidth: float) -> float:
        total = 0.0
        for index in np.unique(garment):
            own = whitened[garment == index]
            if len(own) == 1:
                continue
            square = cdist(own, np.sqrt(1 - bandwidth**2) * own, "sqeuclidean")
            np.fill_diagonal(square, np.inf)
            total += logsumexp(-square / (2 * bandwidth**2), axis=1).sum()
            total -= len(own) * own.shape[1] * np.log(bandwidth)
        return total

    return max(_BANDWIDTHS, key=log_density)


def load_types(folder: str | Path) -> GarmentTypes:
    """Types of the training garments of the static model in a folder.

    Raises:
        InputError: see `load_training_codes`.
    """
    return fit_types(load_training_codes(folder))


PRIOR = "prior"

_DRAWS_MAX = 5  # codes tried per garment

# A sound garment's vertices: in one piece, and deeper than 1 cm in the body.
_FALLEN_M = 0.1  # on average, of a garment that nothing carries
_ONE_PIECE_SHARE_MIN, _DEEP_SHARE_MAX = 0.95, 0.01


class DecodedGarment(NamedTuple):
    """A decoded code."""

    garment: str  # its type, one of `GARMENTS`
    offsets: np.ndarray  # (V, 3) metres
    mask: np.ndarray  # (V,) bool


def decode_by_type(
    model: GarmentCodec,
    types: GarmentTypes,
    z: np.ndarray,
    cvar: np.ndarray,
    garments: Sequence[str | None],
) -> list[DecodedGarment]:
    """Decode codes (n, Z) under conditions (n, C) on the topology of their type.

    Args:
        garments: (n,) their types, or None for the likeliest one.

    Raises:
        InputError: the model predicts no mask.
    """
    topology_of = topology_codes(np.arange(len(GARMENTS)))
    decoded = [
        list(decode_codes(model, z, cvar, np.full(len(z), code))) for code in range(len(TOPOLOGIES))
    ]
    out = []
    for row, garment in enumerate(garments):
        by_topology = [topology[row] for topology in decoded]
        if any(mask is None for _, mask in by_topology):
            raise InputError("a model without a mask branch cannot be sampled, expected another")
        if garment is None:
            masks = np.stack([by_topology[code][1] for code in topology_of])
            likelihood = types.log_likelihood(z[row], masks, cvar[row])
            garment = GARMENTS[int(likelihood.argmax())]
        code = topology_of[GARMENTS.index(garment)]
        out.append(DecodedGarment(garment, *by_topology[code]))
    return out


@dataclass(frozen=True)
class Request:
    """A garment that is asked for."""

    garment: str  # one of `GARMENTS`, or "prior" for whatever a code from the prior turns out to be
    gender: str  # "female" or "male"
    shape: np.ndarray  # (10,) of the wearer
    tightness: np.ndarray  # (2,) without the gender's sign, which the conditions have

    @property
    def cvar(self) -> np.ndarray:
        """(13,) float32 conditions of the static VAE."""
        signed = signed_tightness(self.tightness, self.gender)
        return static_cvar(self.shape[None], np.array([self.gender]), signed[None])[0]


def draw_requests(
    seed: int,
    count: int,
    garments: Sequence[str],
    *,
    female_share: float,
    shape: Sequence[float] | np.ndarray | None,
    shape_range: float,
    tightness: Sequence[float] | np.ndarray | None,
    tightness_range: Sequence[float],
) -> dict[str, Request]:
    """Name -> request, taking turns over the garment types.

    Args:
        seed: a sample depends on it and on its own name alone, so a larger count adds samples
            and changes none.
        count: of samples.
        garments: types, or "prior".
        female_share: probability of a female body.
        shape, tightness: the same for all samples, or None to draw them within the ranges.
        shape_range: largest absolute shape value.
        tightness_range: least and largest tightness.
    """
    requests = {}
    for index in range(count):
        name = f"{index + 1:05d}"
        rng = rng_for(seed, "sampled garment", name, "conditions")
        gender = GENDERS[int(rng.random() >= female_share)]
        random_shape = rng.uniform(-shape_range, shape_range, 10)
        low, high = tightness_range
        random_tightness = rng.uniform(low, high, 2)
        requests[name] = Request(
            garments[index % len(garments)],
            gender,
            random_shape if shape is None else np.asarray(shape, dtype=float),
            random_tightness if tightness is None else np.asarray(tightness, dtype=float),
        )
    return requests


@dataclass(frozen=True)
class SampledGarment:
    """A sampled garment."""

    name: str  # of the sample
    request: Request  # what was asked for
    garment: str  # its type
    z: np.ndarray  # (Z,) its code
    # offsets, mask: (V, 3) metres and (V,) bool, as decoded.
    offsets: np.ndarray
    mask: np.ndarray
    decoded: Mesh  # the garment as decoded
    piece: Mesh  # its largest connected piece
    mesh: Mesh  # the piece, mended if that was asked for
    body: np.ndarray  # (V, 3) rest body that it was decoded on
    draws: int  # number of codes drawn for it; this garment is of the last one

    @property
    def kept_share(self) -> float:
        """Share of the decoded vertices that are in the largest piece; 0 if none were decoded."""
        return len(self.piece.vertices) / max(len(self.decoded.vertices), 1)

    def is_sound(self, body_faces: np.ndarray) -> bool:
        """Whether nearly all of it is in one piece and hardly any of it deep in the body."""
        if self.kept_share < _ONE_PIECE_SHARE_MIN:
            return False
        inside = inside_measures(self.piece.vertices, self.body, body_faces)
        return inside["inside_1cm_share"] <= _DEEP_SHARE_MAX


def sample_garments(
    model: GarmentCodec,
    types: GarmentTypes,
    requests: Mapping[str, Request],
    seed: int,
    *,
    settle: bool,
) -> list[SampledGarment]:
    """Draw a code for every request and decode it.

    A code that decodes to a torn garment, or to one inside the body, is replaced, up to four
    times. Pieces other than the largest are removed.

    Args:
        model: with a mask branch.
        types: of its training garments.
        requests: by name.
        seed: with a sample's name it determines the codes.
        settle: whether garments are mended in the end, see `mend`; otherwise no vertex is moved.
    """
    rngs = {name: rng_for(seed, "sampled garment", name, "code") for name in requests}
    latest: dict[str, SampledGarment] = {}
    waiting = dict(requests)
    for draws in range(1, _DRAWS_MAX + 1):
        for sample in _draw_once(model, types, waiting, rngs, draws):
            latest[sample.name] = sample
            if sample.is_sound(model.body_template.faces[TOPOLOGIES[0]]):
                del waiting[sample.name]
        if not waiting:
            break
    sampled = [latest[name] for name in requests]
    if not settle:
        return sampled
    return [replace(s, mesh=mend(model, s.garment, s.body, s.offsets, s.mask)) for s in sampled]


def mend(
    model: GarmentCodec, garment: str, body: np.ndarray, offsets: np.ndarray, mask: np.ndarray
) -> Mesh:
    """The largest piece of a decoded garment, without what cannot be cloth.

    Decoded garments follow the body into the navel and between the legs, long hems are stacked
    folds, and boundaries are jagged: small holes are filled, what is narrower than a hand is
    smoothed, dents are spanned, and what is in the body then is pushed out.

    Args:
        garment: its type.
        body: (V, 3) that it was decoded on.
        offsets, mask: (V, 3) metres and (V,) bool, as decoded.
    """
    faces = model.body_template.faces_of(garment)
    piece = largest_piece(garment_mesh(body + offsets, faces, fill_holes(mask, faces)))
    if not len(piece.faces):
        return piece
    count = len(piece.vertices)
    fair = fairing(piece.faces, count, _FAIRING)
    points = fair(piece.vertices.astype(np.float64))
    points = fair(fill_dents(points, piece.faces, _DENT_M, _DENT_PASSES))
    average = averaging_matrix(piece.faces, count)
    resolver = PenetrationResolver(body, model.body_template.faces[TOPOLOGIES[0]])
    return Mesh(resolver.push_out(points.astype(np.float32), average), piece.faces)


def fill_holes(mask: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """A mask (V,) without small holes: what is beyond a hem reaches to an end of the body."""
    pairs = edges(faces)
    links = edge_graph(pairs[~mask[pairs].any(axis=1)], len(mask))
    _, piece = connected_components(links, directed=False)
    size = np.bincount(piece)
    size[piece[np.unique(boundary_edges(faces))]] = len(mask)
    return mask | (size[piece] <= _HOLE_SHARE * len(mask))


def _draw_once(
    model: GarmentCodec,
    types: GarmentTypes,
    requests: Mapping[str, Request],
    rngs: Mapping[str, np.random.Generator],
    draws: int,
) -> list[SampledGarment]:
    """Draw one more code for each of the requests and decode it."""
    codes: list[np.ndarray] = []
    garments: list[str | None] = []
    for name, request in requests.items():
        prior, rng = request.garment == PRIOR, rngs[name]
        codes.append(
            rng.standard_normal(types.mean.shape[1])
            if prior
            else types.draw(rng, request.garment, request.cvar)
        )
        garments.append(None if prior else request.garment)
    cvar = np.stack([request.cvar for request in requests.values()])
    decoded = decode_by_type(model, types, np.stack(codes), cvar, garments)
    sampled = []
    for (name, request), z, (garment, offsets, mask) in zip(
        requests.items(), codes, decoded, strict=True
    ):
        body = model.body_template.rest_body(request.cvar)
        faces = model.body_template.faces_of(garment)
        mesh = garment_mesh(body + offsets, faces, mask)
        piece = largest_piece(mesh)
        sampled.append(
            SampledGarment(
                name, request, garment, z, offsets, mask, mesh, piece, piece, body, draws
            )
        )
    return sampled


def sample_table(
    sampled: Sequence[SampledGarment], body_faces: np.ndarray, hung: Mapping[str, Mesh]
) -> list[dict[str, str | float]]:
    """A row per sample: what was asked for, what came of it, and measures.

    Those that end in `_before` are of the garment as decoded, the others of the mended one, and of
    the one that has hung, by name in `hung`, where it has.
    """
    rows: list[dict[str, str | float]] = []
    for sample in sampled:
        before = shape_measures(sample.decoded, sample.body, body_faces)
        after = shape_measures(sample.mesh, sample.body, body_faces)
        looks = cloth_measures(hung.get(sample.name, sample.mesh))
        crossed = self_crossings(sample.decoded)
        rows.append(
            {
                "name": sample.name,
                "asked": sample.request.garment,
                "garment": sample.garment,
                "gender": sample.request.gender,
                "draws": sample.draws,
                "vertices": len(sample.mesh.vertices),
                "pieces_before": int(before["pieces"]),
                "pieces": int(after["pieces"]),
                "kept_share": sample.kept_share,
                "inside_1cm_share_before": before["inside_1cm_share"],
                "inside_1cm_share": after["inside_1cm_share"],
                "inside_share": after["inside_share"],
                "inside_depth_mm": after["inside_depth_mm"],
                "hung": int(sample.name in hung),
                "self_crossings_before": crossed,
                **looks,
                "tightness_0": float(sample.request.tightness[0]),
                "tightness_1": float(sample.request.tightness[1]),
            }
        )
    return rows


def save_samples(
    folder: str | Path,
    sampled: Sequence[SampledGarment],
    bodies: Mapping[str, BodyModel],
    body_faces: np.ndarray,
    hung: Mapping[str, Mesh],
) -> list[dict[str, str | float]]:
    """Write `{name}.obj` and `{name}.glb` (with its wearer) per sample, `samples.tsv`, `codes.npz`.

    A code that decodes to nothing has no OBJ file, and its glTF file holds only the wearer. What
    hangs is in `hung/{name}.obj`, and in the glTF file in place of what was decoded.

    Args:
        folder: to write.
        hung: by name, garments as they hang on their wearers.
        bodies: gender -> the whole body.
        body_faces: (F, 3) of the body that garments were decoded on.

    Returns:
        The rows of `samples.tsv`.
    """
    rows = sample_table(sampled, body_faces, hung)
    with atomic_folder(folder) as scratch:
        (scratch / _HUNG).mkdir()
        for sample in sampled:
            parts = [_still_part("Body", wearer_mesh(bodies, sample.request.cvar), BODY_COLOUR)]
            if len(sample.mesh.faces):
                save_obj(scratch / f"{sample.name}.obj", sample.mesh)
                shown = hung.get(sample.name, sample.mesh)
                parts.append(_still_part(sample.garment, shown, PLAIN_COLOUR))
            if sample.name in hung:
                save_obj(scratch / _HUNG / f"{sample.name}.obj", hung[sample.name])
            write_glb(scratch / f"{sample.name}.glb", parts)
        save_npz(
            scratch / "codes.npz",
            name=np.array([s.name for s in sampled]),
            garment=np.array([s.garment for s in sampled]),
            asked=np.array([s.request.garment != PRIOR for s in sampled]),
            z=np.stack([s.z for s in sampled]).astype(np.float32),
            cvar=np.stack([s.request.cvar for s in sampled]),
        )
        write_rows(scratch / "samples.tsv", rows)
    return rows


class SavedSample(NamedTuple):
    """A sample as read from its files."""

    name: str  # of the sample
    garment: str  # its type
    asked: bool  # whether that type was asked for; if not, the code came from the prior
    mesh: Mesh  # the garment; without faces if nothing was decoded
    hung: Mesh  # as it hangs on its wearer; the same where it does not
    cvar: np.ndarray  # (13,) conditions
    z: np.ndarray  # (Z,) its code


_HUNG = "hung"
_ARRAYS = {
    **{"name": "str n", "garment": "str n", "asked": "bool n"},
    **{"cvar": "float n *", "z": "float n *"},
}


def load_samples(folder: str | Path) -> list[SavedSample]:
    """Read what `save_samples` wrote.

    Raises:
        InputError: a file is missing or damaged.
    """
    folder = Path(folder)
    about = load_npz(folder / "codes.npz", _ARRAYS)
    nothing = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    samples = []
    for name, garment, asked, cvar, z in zip(
        *(about[key] for key in ("name", "garment", "asked", "cvar", "z")), strict=True
    ):
        path, hanging = folder / f"{name}.obj", folder / _HUNG / f"{name}.obj"
        mesh = load_obj(path) if path.is_file() else nothing
        hung = load_obj(hanging) if hanging.is_file() else mesh
        samples.append(SavedSample(str(name), str(garment), bool(asked), mesh, hung, cvar, z))
    return samples


def _still_part(name: str, mesh: Mesh, colour: tuple[float, float, float]) -> ScenePart:
    return ScenePart(name, mesh, colour, lambda start, stop: mesh.vertices[None], 1)


def wearer_mesh(bodies: Mapping[str, BodyModel], cvar: np.ndarray) -> Mesh:
    """The whole rest body, with head, hands and feet, of static conditions (13,).

    A gender between 0 (female) and 1 (male) gives a body between the two.
    """
    female, male = (posed_vertices(bodies[g], cvar[:10], REST_POSE[None])[0][0] for g in GENDERS)
    return Mesh(female + cvar[10] * (male - female), bodies[GENDERS[0]].faces)


def sample_garments_of_codes(job: Job) -> None:
    """Garments from the prior or near those of a type, as OBJ and glTF."""
    given, params = job.input, job.params
    model, types = load_codec(Path(given.model) / BEST), load_types(given.model)
    requests = draw_requests(params.seed, **params.conditions)
    sampled = sample_garments(model, types, requests, params.seed, settle=params.settle)
    faces, bodies = model.body_template.faces["body"], load_bodies(given)
    draper = job_draper(job, params.hang_frames)
    hung = {} if draper is None else hang_samples(sampled, bodies, draper)
    rows = save_samples(job.output[0], sampled, bodies, faces, hung)
    good = sum(float(row["inside_1cm_share"]) <= 0.05 for row in rows)
    LOGGER.info(
        "%d of %d garments have at most 5 %% of their vertices deeper than 1 cm", good, len(rows)
    )


def hang_samples(
    sampled: Sequence[SampledGarment], bodies: Mapping[str, BodyModel], draper: SolverDraper
) -> dict[str, Mesh]:
    """Name -> a garment that has hung on its wearer at rest, where it stays on."""
    hung = {}
    for sample in progress(sampled, total=len(sampled), label="garments"):
        request = sample.request
        draped = draper(
            {sample.garment: sample.mesh},
            bodies[request.gender],
            request.gender,
            np.asarray(request.shape, dtype=np.float64),
            REST_POSE,
            np.zeros(3),
            np.array([0.0, 0.0, 1.0]),
        )
        if not draped:
            continue
        rest, posed = draped[sample.garment]
        if (rest.vertices - posed.vertices)[:, 2].mean() > _FALLEN_M:
            LOGGER.info("%s stays as it was decoded: it falls off", sample.name)
        else:
            hung[sample.name] = posed
    return hung
