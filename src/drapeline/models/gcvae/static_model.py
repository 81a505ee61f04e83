"""A trained static model as users of the library take it: meshes in, meshes out.

Everything comes from the folder that the training left, see `load`. Meshes are in metres,
in the rest pose, with the root joint at the origin, Z up, facing -Y. n garments, Z numbers of a
code, V vertices of the body that garments are offsets from (no head, hands or feet).
"""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.garment import garment_mesh, largest_piece
from drapeline.models.gcvae.codec import Codes, GarmentCodec
from drapeline.models.gcvae.load import TOPOLOGY, load_codec
from drapeline.models.gcvae.ppca import StaticPpca
from drapeline.models.gcvae.sample import (
    PRIOR,
    Request,
    decode_by_type,
    draw_requests,
    load_types,
    push_out,
    sample_garments,
)
from drapeline.models.gcvae.vae import StaticVae
from drapeline.models.training.module import BEST
from drapeline.outfits.garment_types import GARMENTS
from drapeline.registration.to_body.registrar import Registrar
from drapeline.registration.to_body.topology import TOPOLOGIES, load_topology, topology_codes

# Where the default config draws bodies and outfits from.
SHAPE_RANGE, TIGHTNESS_RANGE = 3.0, (-1.5, 0.5)


class RestGarment(NamedTuple):
    """A garment on the body that it was made for.

    Attributes:
        garment: its type, one of `drapeline.outfits.garment_types.GARMENTS`.
        mesh: triangles; without faces if the code stands for no garment.
        body: the wearer, triangles, without head, hands and feet.
        gender: "female" or "male".
        shape: (10,) of the wearer.
        tightness: (2,).
        z: (Z,) the code.
    """

    garment: str
    mesh: Mesh
    body: Mesh
    gender: str
    shape: np.ndarray
    tightness: np.ndarray
    z: np.ndarray


class StaticModel:
    """A garment VAE of CLOTH3D, or masked PCA, of garments in the rest pose.

    Args:
        folder: of the training or the fit, such as `results/gcvae/svae`.

    Attributes:
        garments: the types that it was trained on.
        latent: Z.

    Raises:
        InputError: a file is missing or damaged, or holds a model of another kind.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        codec = load_codec(self.folder / BEST)
        if not isinstance(codec, StaticVae | StaticPpca):
            raise InputError(
                f"{folder}: a model of garments in motion, expected one of garments at rest, such"
                " as svae or static_ppca"
            )
        self._codec: GarmentCodec = codec
        self._types = load_types(folder)
        self.latent = codec.latent
        self.garments = tuple(np.array(GARMENTS)[self._types.share > 0].tolist())

    def sample(
        self,
        count: int,
        garment: str | None = None,
        *,
        gender: str | None = None,
        shape: Sequence[float] | np.ndarray | None = None,
        tightness: Sequence[float] | np.ndarray | None = None,
        seed: int = 0,
        settle: bool = True,
    ) -> list[RestGarment]:
        """New garments.

        A code that decodes to a torn garment, or to one inside the body, is replaced, up to four
        times.

        Args:
            count: of garments; a larger one leaves the first ones as they are.
            garment: a type, or None for codes from the standard normal, whatever type results.
            gender: "female" or "male" for all wearers, or None to draw one for each.
            shape: (10,) SMPL shape of all wearers, or None to draw uniformly from -3 to 3.
            tightness: (2,) of all garments, larger is tighter, or None to draw uniformly from -1.5
                to 0.5.
            settle: whether garments are smoothed and pushed out of the body in the end, which the
                paper does not do; otherwise no vertex is moved.

        Raises:
            InputError: no training garment is of that type, the model has no mask, or a condition
                is no such value.
        """
        one = _conditions(1, garment, gender or GENDERS[0], shape, tightness)[0]
        requests = draw_requests(
            seed,
            count,
            [one.garment],
            female_share={None: 0.5, "female": 1.0, "male": 0.0}[gender],
            shape=None if shape is None else one.shape,
            shape_range=SHAPE_RANGE,
            tightness=None if tightness is None else one.tightness,
            tightness_range=TIGHTNESS_RANGE,
        )
        sampled = sample_garments(self._codec, self._types, requests, seed, settle=settle)
        return [
            self._garment(sample.request, sample.garment, sample.mesh, sample.z)
            for sample in sampled
        ]

    def encode(
        self,
        meshes: Sequence[Mesh],
        garments: str | Sequence[str],
        *,
        gender: str | Sequence[str],
        shape: Sequence[float] | np.ndarray,
        tightness: Sequence[float] | np.ndarray = (0.0, 0.0),
    ) -> Codes:
        """Codes of garments in the rest pose.

        Each mesh is first registered to its wearer's body, which takes a second or so.

        Args:
            meshes: n garments of quads or triangles.
            garments: their types.
            gender: of the wearers.
            shape: (10,) or (n, 10) of the wearers.
            tightness: (2,) or (n, 2).

        Returns:
            Mean and log variance of each posterior, (n, Z) float32.

        Raises:
            InputError: a garment covers no part of its wearer's body, or a condition is no such
                value.
        """
        requests = _conditions(len(meshes), garments, gender, shape, tightness)
        offsets, masks = [], []
        for mesh, request in zip(meshes, requests, strict=True):
            body = self._codec.body_template.rest_body(request.cvar).astype(np.float64)
            done = self._registrar.register(request.garment, mesh.vertices, mesh.faces, body)
            offsets.append(done.offsets)
            masks.append(done.match.mask)
        index = np.array([GARMENTS.index(request.garment) for request in requests])
        batch = {
            "offsets": np.stack(offsets),
            "mask": np.stack(masks),
            "cvar": np.stack([request.cvar for request in requests]),
            "topology": topology_codes(index),
        }
        code = self._codec.encode({key: torch.from_numpy(value) for key, value in batch.items()})
        return Codes(code.mean.numpy(), code.log_variance.numpy())

    def decode(
        self,
        z: np.ndarray,
        garments: str | Sequence[str] | None = None,
        *,
        gender: str | Sequence[str],
        shape: Sequence[float] | np.ndarray,
        tightness: Sequence[float] | np.ndarray = (0.0, 0.0),
        settle: bool = False,
    ) -> list[RestGarment]:
        """Garments of codes on given bodies.

        Args:
            z: (n, Z) codes.
            garments: their types, or None for the likeliest type of each.
            gender: of the wearers.
            shape: (10,) or (n, 10) of the wearers.
            tightness: (2,) or (n, 2).
            settle: whether a garment's largest piece alone is kept, smoothed and pushed out of the
                body; otherwise it is as decoded.

        Raises:
            InputError: codes have another length, the model has no mask, or a condition is no such
                value.
        """
        z = np.asarray(z, dtype=np.float32)
        if z.ndim != 2 or z.shape[1] != self.latent:
            raise InputError(f"codes of shape {z.shape}, expected (n, {self.latent})")
        requests = _conditions(len(z), garments, gender, shape, tightness)
        types = [None if r.garment == PRIOR else r.garment for r in requests]
        cvar = np.stack([request.cvar for request in requests])
        template = self._codec.body_template
        made = []
        for request, code, decoded in zip(
            requests, z, decode_by_type(self._codec, self._types, z, cvar, types), strict=True
        ):
            body = template.rest_body(request.cvar)
            faces = template.faces_of(decoded.garment)
            mesh = garment_mesh(body + decoded.offsets, faces, decoded.mask)
            if settle:
                mesh = push_out(self._codec, largest_piece(mesh), body)
            made.append(self._garment(request, decoded.garment, mesh, code))
        return made

    @cached_property
    def _registrar(self) -> Registrar:
        return Registrar(load_topology(self.folder / TOPOLOGY))

    def _garment(self, request: Request, garment: str, mesh: Mesh, z: np.ndarray) -> RestGarment:
        template = self._codec.body_template
        body = Mesh(template.rest_body(request.cvar), template.faces[TOPOLOGIES[0]])
        return RestGarment(garment, mesh, body, request.gender, request.shape, request.tightness, z)


def _conditions(
    count: int,
    garments: str | Sequence[str] | None,
    gender: str | Sequence[str],
    shape: Sequence[float] | np.ndarray | None,
    tightness: Sequence[float] | np.ndarray | None,
) -> list[Request]:
    """The same conditions for all garments, or one of each for each; zeros for None.

    Raises:
        InputError: there is no such type or gender, or numbers of another shape are given.
    """
    return [
        Request(*one)
        for one in zip(
            _names("garment", garments or PRIOR, (*GARMENTS, PRIOR), count),
            _names("gender", gender, GENDERS, count),
            _numbers("shape", shape, count, 10),
            _numbers("tightness", tightness, count, 2),
            strict=True,
        )
    ]


def _names(
    name: str, values: str | Sequence[str], known: Sequence[str], count: int
) -> Sequence[str]:
    values = [values] * count if isinstance(values, str) else values
    if len(values) != count:
        raise InputError(f"{name}: {len(values)} values, expected one or {count}")
    for value in values:
        if value not in known:
            raise InputError(f"{name}: '{value}', expected one of {', '.join(known)}")
    return values


def _numbers(
    name: str, values: Sequence[float] | np.ndarray | None, count: int, size: int
) -> np.ndarray:
    array = np.zeros(size) if values is None else np.asarray(values, dtype=np.float64)
    if array.shape not in {(size,), (count, size)} or not np.isfinite(array).all():
        raise InputError(
            f"{name}: values of shape {array.shape}, expected ({size},) or ({count}, {size}) finite"
            " numbers"
        )
    return np.broadcast_to(array, (count, size))
