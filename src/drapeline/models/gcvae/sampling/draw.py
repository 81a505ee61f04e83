"""Draw codes and decode them: garments from the prior, or of a given type.

A code is decoded on both topologies. If no type was asked for, its type is the likeliest one by
the code and by the masks that it decodes to: the code alone tells skirts from trousers, and the
masks tell what a code far from all training codes looks like.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from drapeline.bodies.rest_body import signed_tightness
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.collision import resolve_penetration
from drapeline.geometry.mesh import Mesh
from drapeline.learning_data.static import static_cvar
from drapeline.metrics.garment import garment_mesh, inside_measures, largest_piece
from drapeline.models.gcvae.codec import GarmentCodec
from drapeline.models.gcvae.codes import decode_codes
from drapeline.models.gcvae.sampling.types import GarmentTypes
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.topology import TOPOLOGIES, topology_codes
from drapeline.seeding import rng_for

PRIOR = "prior"
_DRAWS_MAX = 5  # codes tried per garment
# A sound garment's vertices: in one piece, and deeper than 1 cm in the body.
_ONE_PIECE_SHARE_MIN, _DEEP_SHARE_MAX = 0.95, 0.01


class DecodedGarment(NamedTuple):
    """A decoded code.

    Attributes:
        garment_index: its type, an index into `GARMENTS`.
        offsets: (V, 3) metres.
        mask: (V,) bool.
    """

    garment_index: int
    offsets: np.ndarray
    mask: np.ndarray


def decode_by_type(
    model: GarmentCodec,
    types: GarmentTypes,
    z: np.ndarray,
    cvar: np.ndarray,
    garment_indices: Sequence[int | None],
) -> list[DecodedGarment]:
    """Decode codes (n, Z) under conditions (n, C) on the topology of their type.

    Args:
        garment_indices: (n,) indices into `GARMENTS`, or None for the likeliest type.

    Raises:
        InputError: the model predicts no mask.
    """
    topology_of = topology_codes(np.arange(len(GARMENTS)))
    decoded = [
        list(decode_codes(model, z, cvar, np.full(len(z), code))) for code in range(len(TOPOLOGIES))
    ]
    out = []
    for row, garment_index in enumerate(garment_indices):
        by_topology = [garments[row] for garments in decoded]
        if any(mask is None for _, mask in by_topology):
            raise InputError("a model without a mask branch cannot be sampled, expected another")
        if garment_index is None:
            masks = np.stack([by_topology[code][1] for code in topology_of])
            likelihood = types.log_likelihood(z[row : row + 1], masks[None])[0]
            garment_index = int(likelihood.argmax())
        out.append(DecodedGarment(garment_index, *by_topology[topology_of[garment_index]]))
    return out


@dataclass(frozen=True)
class Request:
    """A garment that is asked for.

    Attributes:
        garment: one of `GARMENTS`, or "prior" for whatever a code from the prior turns out to be.
        gender: "female" or "male".
        shape: (10,) of the wearer.
        tightness: (2,) without the gender's sign, which the conditions have.
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
        random_tightness = rng.uniform(*tightness_range, 2)
        requests[name] = Request(
            garments[index % len(garments)],
            gender,
            random_shape if shape is None else np.asarray(shape, dtype=float),
            random_tightness if tightness is None else np.asarray(tightness, dtype=float),
        )
    return requests


@dataclass(frozen=True)
class SampledGarment:
    """A sampled garment.

    Attributes:
        name: of the sample.
        request: what was asked for.
        garment: its type.
        z: (Z,) its code.
        decoded: the garment as decoded.
        piece: its largest connected piece.
        mesh: the piece, evened out and pushed out of the body if that was asked for.
        body: (V, 3) rest body that it was decoded on.
        draws: number of codes drawn for it; this garment is of the last one.
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
        settle: whether garments are evened out and pushed out of the body in the end, see
            `resolve_penetration`; otherwise no vertex is moved.
    """
    rngs = {name: rng_for(seed, "sampled garment", name, "code") for name in requests}
    found: dict[str, SampledGarment] = {}
    waiting = dict(requests)
    for draws in range(1, _DRAWS_MAX + 1):
        for sample in _draw_once(model, types, waiting, rngs, draws):
            found[sample.name] = sample
            if sample.is_sound(model.body_template.faces[TOPOLOGIES[0]]):
                del waiting[sample.name]
        if not waiting:
            break
    sampled = [found[name] for name in requests]
    if not settle:
        return sampled
    return [replace(one, mesh=push_out(model, one.piece, one.body)) for one in sampled]


def push_out(model: GarmentCodec, piece: Mesh, body: np.ndarray) -> Mesh:
    """A decoded garment, evened out and pushed out of the body (V, 3) that it was decoded on."""
    if not len(piece.faces):
        return piece
    body_faces = model.body_template.faces[TOPOLOGIES[0]]
    (vertices,) = resolve_penetration(piece.vertices[None], piece.faces, body[None], body_faces)
    return Mesh(vertices, piece.faces)


def _draw_once(
    model: GarmentCodec,
    types: GarmentTypes,
    requests: Mapping[str, Request],
    rngs: Mapping[str, np.random.Generator],
    draws: int,
) -> list[SampledGarment]:
    """Draw one more code for each of the requests and decode it."""
    codes: list[np.ndarray] = []
    garment_indices: list[int | None] = []
    for name, request in requests.items():
        prior, rng = request.garment == PRIOR, rngs[name]
        codes.append(
            rng.standard_normal(types.mean.shape[1]) if prior else types.draw(rng, request.garment)
        )
        garment_indices.append(None if prior else GARMENTS.index(request.garment))
    cvar = np.stack([request.cvar for request in requests.values()])
    decoded = decode_by_type(model, types, np.stack(codes), cvar, garment_indices)
    sampled = []
    for (name, request), z, (garment_index, offsets, mask) in zip(
        requests.items(), codes, decoded, strict=True
    ):
        body = model.body_template.rest_body(request.cvar)
        mesh = garment_mesh(body + offsets, model.body_template.faces_of(garment_index), mask)
        piece = largest_piece(mesh)
        sampled.append(
            SampledGarment(
                name, request, GARMENTS[garment_index], z, mesh, piece, piece, body, draws
            )
        )
    return sampled
