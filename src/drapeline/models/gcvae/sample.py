"""New garments: codes drawn from the prior, or near those of one type, decoded on bodies.

A code has to be decoded on one of two topologies, so what type of garment it is must be known
first. It is decoded on both. Its type is the likeliest by the code, each type being a Gaussian
with the mean of its training codes and a covariance common to all, and by the mask that it gives
on the type's topology: the code alone tells skirts from trousers, and the mask shows what a code
in the middle of nowhere looks like. Where a type is asked for, codes come from a smoothed
bootstrap (Silverman, "Density estimation", 6.4) of its training codes: a Gaussian as wide as the
type has most of its mass where hems of several lengths mix, which is where no garment is.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel, posed_vertices
from drapeline.bodies.rest_body import signed_tightness
from drapeline.dataset.gltf import write_glb
from drapeline.dataset.sample_meshes import PLAIN_COLOUR, SKIN_COLOUR, ScenePart
from drapeline.errors import InputError
from drapeline.frames import GENDERS, REST_POSE
from drapeline.geometry.collision import resolve_penetration
from drapeline.geometry.mesh import Mesh, load_obj, save_obj
from drapeline.learning_data.static import static_cvar
from drapeline.metrics.garment import (
    garment_mesh,
    inside_measures,
    largest_piece,
    shape_measures,
)
from drapeline.metrics.static import StaticRows
from drapeline.models.gcvae.codes import Codes, decode_codes, rest_body
from drapeline.models.gcvae.vae import StaticVae
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import TOPOLOGIES, topology_codes
from drapeline.seeding import rng_for
from drapeline.storage import atomic_folder, load_npz, save_npz

PRIOR = "prior"
_SHRINKAGE = 0.05
_BANDWIDTH = 0.4  # of the smoothed bootstrap, in deviations of a type
_RATE_FLOOR = 0.01  # a vertex that no training garment covers is unlikely, not impossible
_DRAWS = 5  # codes tried per garment
_WHOLE_SHARE, _DEEP_SHARE = 0.95, 0.01  # a sound one's vertices: in one piece, deep in the body


@dataclass(frozen=True)
class GarmentTypes:
    """What the training garments of each type are like.

    Attributes:
        share: (K,) of the training garments, 0 for a type that none of them has.
        mean: (K, Z) of the codes.
        factor: (Z, Z) lower Cholesky factor of the codes' covariance within a type.
        codes, garment: (n, Z) and (n,) the training garments themselves, indices into `GARMENTS`.
        mask_rate: (K, V) share of the type's garments that cover a vertex.
    """

    share: np.ndarray
    mean: np.ndarray
    factor: np.ndarray
    codes: np.ndarray
    garment: np.ndarray
    mask_rate: np.ndarray

    def draw(self, rng: np.random.Generator, garment: str) -> np.ndarray:
        """(Z,) a code near one of a type's garments; the mean of such codes is the type's.

        Raises:
            InputError: no training garment is of that type.
        """
        kind = GARMENTS.index(garment)
        if not self.share[kind]:
            known = ", ".join(np.array(GARMENTS)[self.share > 0])
            raise InputError(f"no training garment is a {garment}, expected one of {known}")
        mean = self.mean[kind]
        near = self.codes[rng.choice(np.flatnonzero(self.garment == kind))] - mean
        noise = self.factor @ rng.standard_normal(len(mean))
        return smoothed(mean, near, noise)

    def log_likelihood(self, z: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """Of codes (n, Z) and of the masks (n, K, V) that they give for each type: (n, K).

        Vertices of a mask err alike, so that all of them count as much as the Z numbers do.
        """
        away = np.linalg.solve(self.factor, (z[:, None] - self.mean).reshape(-1, z.shape[1]).T)
        by_code = -(away**2).sum(axis=0).reshape(len(z), -1) / 2
        rate = np.clip(self.mask_rate, _RATE_FLOOR, 1 - _RATE_FLOOR)
        by_vertex = np.where(mask, np.log(rate), np.log(1 - rate))
        known = self.share > 0
        prior = np.where(known, np.log(np.where(known, self.share, 1)), -np.inf)
        return prior + by_code + z.shape[1] * by_vertex.mean(axis=2)


def smoothed(mean: np.ndarray, near: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """A smoothed bootstrap that keeps mean and covariance.

    Args:
        mean: (Z,) of the codes.
        near, noise: (..., Z) deviations from it, of a code that is known and of any other.
    """
    return mean + np.sqrt(1 - _BANDWIDTH**2) * near + _BANDWIDTH * noise


def fit_types(codes: Codes, garment: np.ndarray, mask: np.ndarray) -> GarmentTypes:
    """Learn the types from training garments.

    Args:
        codes: (n, Z).
        garment: (n,) indices into `GARMENTS`.
        mask: (n, V) bool.
    """
    count = np.bincount(garment, minlength=len(GARMENTS))
    mean = np.zeros((len(GARMENTS), codes.mean.shape[1]))
    np.add.at(mean, garment, codes.mean)
    mean /= np.maximum(count, 1)[:, None]
    away = codes.mean - mean[garment]
    within = away.T @ away / len(away) + np.diag(np.exp(codes.log_variance).mean(axis=0))
    # With about as many garments as dimensions the covariance alone would be near singular.
    even = np.trace(within) / len(within) * np.eye(len(within))
    factor = np.linalg.cholesky((1 - _SHRINKAGE) * within + _SHRINKAGE * even)
    rate = np.zeros((len(GARMENTS), mask.shape[1]))
    for kind, covered in zip(garment, mask, strict=True):
        rate[kind] += covered
    rate /= np.maximum(count, 1)[:, None]
    return GarmentTypes(count / count.sum(), mean, factor, codes.mean, garment, rate)


def train_types(codes: Codes, garments: StaticRows) -> GarmentTypes:
    """Learn the types from the training rows of a dataset and the codes (N, Z) of all its rows."""
    train = garments.rows("train")
    return fit_types(codes.of(train), garments.garment[train], garments.mask[train])


class Typed(NamedTuple):
    """A decoded code.

    Attributes:
        kind: index into `GARMENTS`.
        offsets: (V, 3) metres.
        mask: (V,) bool.
    """

    kind: int
    offsets: np.ndarray
    mask: np.ndarray


def decode_typed(
    model: StaticVae,
    types: GarmentTypes,
    z: np.ndarray,
    cvar: np.ndarray,
    kinds: Sequence[int | None],
) -> list[Typed]:
    """Decode codes (n, Z) under conditions (n, C) on the topology of their type.

    Args:
        kinds: (n,) index into `GARMENTS`, or None to find it out.

    Raises:
        InputError: the model predicts no mask.
    """
    of_kind = topology_codes(np.arange(len(GARMENTS)))
    decoded = [
        list(decode_codes(model, z, cvar, np.full(len(z), code))) for code in range(len(TOPOLOGIES))
    ]
    out = []
    for row, kind in enumerate(kinds):
        made = [garments[row] for garments in decoded]
        if any(mask is None for _, mask in made):
            raise InputError("a model without a mask branch cannot be sampled, expected another")
        if kind is None:
            masks = np.stack([made[code][1] for code in of_kind])
            kind = int(types.log_likelihood(z[row : row + 1], masks[None])[0].argmax())
        out.append(Typed(kind, *made[of_kind[kind]]))
    return out


@dataclass(frozen=True)
class Request:
    """A garment that is asked for.

    Attributes:
        garment: one of `GARMENTS`, or "prior": whatever the code turns out to be.
        gender: "female" or "male".
        shape: (10,) of the wearer.
        tightness: (2,) as drawn; the sign of the gender is put on when it is used.
    """

    garment: str
    gender: str
    shape: np.ndarray
    tightness: np.ndarray

    @property
    def cvar(self) -> np.ndarray:
        """(13,) float32 conditions of the static VAE."""
        gender = GENDERS.index(self.gender)
        signed = signed_tightness(self.tightness, self.gender)
        return static_cvar(self.shape[None], np.array([gender]), signed[None])[0]


def draw_requests(
    seed: int,
    count: int,
    garments: Sequence[str],
    *,
    female_share: float,
    shape: Sequence[float] | None,
    shape_range: float,
    tightness: Sequence[float] | None,
    tightness_range: Sequence[float],
) -> dict[str, Request]:
    """Name -> request, as many as asked for, turn by turn over the garments.

    Args:
        seed: with a sample's name it fixes the sample; another count leaves the first ones alone.
        count: of samples.
        garments: types, or "prior".
        female_share: chance of a female body.
        shape, tightness: the same for all samples, or None to draw them in the ranges.
    """
    requests = {}
    for index in range(count):
        name = f"{index + 1:05d}"
        rng = rng_for(seed, "sampled garment", name, "conditions")
        gender = GENDERS[int(rng.random() >= female_share)]
        drawn = rng.uniform(-shape_range, shape_range, 10), rng.uniform(*tightness_range, 2)
        requests[name] = Request(
            garments[index % len(garments)],
            gender,
            drawn[0] if shape is None else np.asarray(shape, dtype=float),
            drawn[1] if tightness is None else np.asarray(tightness, dtype=float),
        )
    return requests


@dataclass(frozen=True)
class Sampled:
    """A sampled garment.

    Attributes:
        name: of the sample.
        request: what was asked for.
        garment: its type.
        z: (Z,) its code.
        decoded: the garment as decoded.
        piece: its largest connected piece.
        mesh: that, settled if it was asked for.
        body: (V, 3) rest body that it was decoded on.
        draws: codes that were drawn for it, of which this is the last.
    """

    name: str
    request: Request
    garment: str
    z: np.ndarray
    decoded: Mesh
    piece: Mesh
    mesh: Mesh
    body: np.ndarray
    draws: int

    @property
    def kept_share(self) -> float:
        """Share of the decoded vertices that are in the largest piece; 0 where nothing was."""
        return len(self.piece.vertices) / max(len(self.decoded.vertices), 1)

    def sound(self, body_faces: np.ndarray) -> bool:
        """Whether it was decoded nearly all in one piece and hardly reaches into the body."""
        if self.kept_share < _WHOLE_SHARE:
            return False
        inside = inside_measures(self.piece.vertices, self.body, body_faces)
        return inside["inside_1cm_share"] <= _DEEP_SHARE


def sample_garments(
    model: StaticVae,
    types: GarmentTypes,
    requests: Mapping[str, Request],
    seed: int,
    *,
    settle: bool,
) -> list[Sampled]:
    """Draw a code for every request and decode it.

    Codes that decode to a torn garment, or to one inside the body, are drawn again, a few times.
    Pieces other than the largest are taken off.

    Args:
        model: with a mask branch.
        types: of its training garments.
        requests: by name.
        seed: with a sample's name it fixes the codes.
        settle: whether garments are evened out and pushed out of the body in the end, see
            `settled`; else no vertex is moved.
    """
    rngs = {name: rng_for(seed, "sampled garment", name, "code") for name in requests}
    found: dict[str, Sampled] = {}
    waiting = dict(requests)
    for draws in range(1, _DRAWS + 1):
        for sample in _drawn(model, types, waiting, rngs, draws):
            found[sample.name] = sample
            if sample.sound(model.body_template.faces[TOPOLOGIES[0]]):
                del waiting[sample.name]
        if not waiting:
            break
    sampled = [found[name] for name in requests]
    return [_settled(one, model) for one in sampled] if settle else sampled


def _settled(sample: Sampled, model: StaticVae) -> Sampled:
    piece = sample.piece
    if not len(piece.faces):
        return sample
    body_faces = model.body_template.faces[TOPOLOGIES[0]]
    (vertices,) = resolve_penetration(
        piece.vertices[None], piece.faces, sample.body[None], body_faces
    )
    return replace(sample, mesh=Mesh(vertices, piece.faces))


def _drawn(
    model: StaticVae,
    types: GarmentTypes,
    requests: Mapping[str, Request],
    rngs: Mapping[str, np.random.Generator],
    draws: int,
) -> list[Sampled]:
    """One more code for each of the requests, decoded."""
    codes: list[np.ndarray] = []
    kinds: list[int | None] = []
    for name, request in requests.items():
        prior, rng = request.garment == PRIOR, rngs[name]
        codes.append(
            rng.standard_normal(types.mean.shape[1]) if prior else types.draw(rng, request.garment)
        )
        kinds.append(None if prior else GARMENTS.index(request.garment))
    cvar = np.stack([request.cvar for request in requests.values()])
    typed = decode_typed(model, types, np.stack(codes), cvar, kinds)
    sampled = []
    for (name, request), z, (kind, offsets, mask) in zip(
        requests.items(), codes, typed, strict=True
    ):
        body = rest_body(model, request.cvar)
        mesh = garment_mesh(body + offsets, faces_of(model, kind), mask)
        piece = largest_piece(mesh)
        sampled.append(Sampled(name, request, GARMENTS[kind], z, mesh, piece, piece, body, draws))
    return sampled


def faces_of(model: StaticVae, kind: int) -> np.ndarray:
    """(F, 3) of the topology of a type."""
    return model.body_template.faces[TOPOLOGIES[int(topology_codes(np.array([kind]))[0])]]


def sample_table(
    sampled: Sequence[Sampled], body_faces: np.ndarray
) -> list[dict[str, str | float]]:
    """A row per sample: what was asked for, what came, and its measures before and after."""
    rows = []
    for sample in sampled:
        before = shape_measures(sample.decoded, sample.body, body_faces)
        after = shape_measures(sample.mesh, sample.body, body_faces)
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
                "tightness_0": float(sample.request.tightness[0]),
                "tightness_1": float(sample.request.tightness[1]),
            }
        )
    return rows


def wearer_mesh(bodies: Mapping[str, BodyModel], cvar: np.ndarray) -> Mesh:
    """The whole rest body, head, hands and feet included, of conditions (13,).

    Genders between 0 (female) and 1 (male) are between the two bodies.
    """
    female, male = (posed_vertices(bodies[g], cvar[:10], REST_POSE[None])[0][0] for g in GENDERS)
    return Mesh(female + cvar[10] * (male - female), bodies[GENDERS[0]].faces)


def save_samples(
    folder: str | Path,
    sampled: Sequence[Sampled],
    bodies: Mapping[str, BodyModel],
    body_faces: np.ndarray,
) -> list[dict[str, str | float]]:
    """Write `{name}.obj` and `{name}.glb` (with its wearer) per sample, `samples.tsv`, `codes.npz`.

    A code that decodes to nothing has no OBJ, and its glTF file holds the wearer alone.

    Args:
        folder: to write.
        bodies: gender -> the whole body.
        body_faces: (F, 3) of the body that garments were decoded on.

    Returns:
        The rows of `samples.tsv`.
    """
    rows = sample_table(sampled, body_faces)
    with atomic_folder(folder) as scratch:
        for sample in sampled:
            parts = [_still("Body", wearer_mesh(bodies, sample.request.cvar), SKIN_COLOUR)]
            if len(sample.mesh.faces):
                save_obj(scratch / f"{sample.name}.obj", sample.mesh)
                parts.append(_still(sample.garment, sample.mesh, PLAIN_COLOUR))
            write_glb(scratch / f"{sample.name}.glb", parts)
        save_npz(
            scratch / "codes.npz",
            name=np.array([s.name for s in sampled]),
            garment=np.array([s.garment for s in sampled]),
            asked=np.array([s.request.garment != PRIOR for s in sampled]),
            z=np.stack([s.z for s in sampled]).astype(np.float32),
            cvar=np.stack([s.request.cvar for s in sampled]),
        )
        with open(scratch / "samples.tsv", "w", newline="") as stream:
            writer = csv.DictWriter(stream, rows[0], delimiter="\t", lineterminator="\n")
            writer.writeheader()
            for row in rows:
                writer.writerow(
                    {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()}
                )
    return rows


class SavedSample(NamedTuple):
    """A sample as read from its files.

    Attributes:
        name: of the sample.
        garment: its type; `asked` says whether it was asked for or the prior's choice.
        mesh: the garment; no faces where nothing was decoded.
        cvar: (13,) conditions.
    """

    name: str
    garment: str
    asked: bool
    mesh: Mesh
    cvar: np.ndarray


def load_samples(folder: str | Path) -> list[SavedSample]:
    """Read what `save_samples` wrote.

    Raises:
        InputError: a file is missing or damaged.
    """
    folder = Path(folder)
    about = load_npz(folder / "codes.npz", "name", "cvar", "garment", "asked")
    nothing = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    samples = []
    for name, garment, asked, cvar in zip(
        *(about[key] for key in ("name", "garment", "asked", "cvar")), strict=True
    ):
        path = folder / f"{name}.obj"
        mesh = load_obj(path) if path.is_file() else nothing
        samples.append(SavedSample(str(name), str(garment), bool(asked), mesh, cvar))
    return samples


def _still(name: str, mesh: Mesh, colour: tuple[float, float, float]) -> ScenePart:
    return ScenePart(name, mesh, colour, lambda start, stop: mesh.vertices[None], 1)
