"""A trained static model as users of the library take it: meshes in, meshes out.

Everything comes from the folder that the training left, see `load`. Meshes are in metres,
in the rest pose, with the root joint at the origin, Z up, facing -Y. n garments, Z numbers of a
code, V vertices of the body that garments are offsets from (no head, hands or feet).
"""

from collections.abc import Sequence
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from drapeline.bodies.model import BodyModel
from drapeline.errors import InputError
from drapeline.experiment.cloth_solvers import QUICK_SOLVER
from drapeline.frames import GENDERS
from drapeline.generation.moving_outfits import SimulatedOutfit, put_on, simulate, wearer
from drapeline.generation.moving_sheets import WORN, SolverDraper, make_draper
from drapeline.geometry.mesh import Mesh
from drapeline.metrics.garment import garment_mesh
from drapeline.models.gcvae.codec import Codes, GarmentCodec
from drapeline.models.gcvae.load import TOPOLOGY, load_codec
from drapeline.models.gcvae.movers import WornSheet, hang_at_rest, load_mover, move_by_model
from drapeline.models.gcvae.ppca import StaticPpca
from drapeline.models.gcvae.sample import (
    PRIOR,
    Request,
    decode_by_type,
    draw_requests,
    load_types,
    mend,
    sample_garments,
)
from drapeline.models.gcvae.settings import SOLVER
from drapeline.models.gcvae.vae import StaticVae
from drapeline.models.training.module import BEST
from drapeline.motions.motion import Motion
from drapeline.outfits.garment_types import GARMENTS, layered
from drapeline.registration.to_body.registrar import Registrar
from drapeline.registration.to_body.topology import TOPOLOGIES, load_topology, topology_codes

_EDGE_LENGTH_M = 0.02  # of cloth that hangs, at least
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
            settle: whether garments are mended in the end, which the paper does not do: small
                holes filled, dents spanned, bumps and hems smoothed, and cloth pushed out of the
                body; otherwise no vertex is moved.

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
            settle: whether a garment's largest piece alone is kept and mended, as `sample` does;
                otherwise it is as decoded.

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
                mesh = mend(self._codec, decoded.garment, body, decoded.offsets, decoded.mask)
            made.append(self._garment(request, decoded.garment, mesh, code))
        return made

    def animate(
        self,
        garments: Sequence[RestGarment],
        motion: Motion,
        body: BodyModel | str | Path | None = None,
        *,
        mover: str | Path = SOLVER,
        settle: bool = True,
        hang_frames: int = 12,
    ) -> SimulatedOutfit:
        """Garments of one wearer on a motion.

        Args:
            garments: one or several of different types, in any order, for the same wearer.
            motion: as `import_motion` gives it; one of another rate is resampled to 30 frames per
                second.
            body: the whole body that the model's garments are made for, in SMPL's format, or its
                file; the free one of the gender if None.
            mover: "solver", the fast cloth solver; or the folder of a model of garments in motion
                that was trained with this one's codes, such as `results/gcvae/wrinkle_mlp`,
                `results/gcvae/dynamic_ppca` or `results/gcvae/dvae_unposed_4`.
            settle: whether what a model has moved is then smoothed and pushed out of the body and
                of what is worn beneath, which the paper does not do.
            hang_frames: for which garments hang at rest before a model moves them.

        Returns:
            The wearer and every garment, frame by frame, which `save_outfit` writes to files.

        Raises:
            InputError: garments are of different wearers or of the same type, or one is empty; the
                mover is no such model; the body overlaps itself in the motion; or the simulation
                is out of bounds.
        """
        model = None if mover == SOLVER else load_mover(mover)
        first, given = _same_wearer(garments), {one.garment: one for one in garments}
        worn = {name: given[name].mesh for name in layered(given)}
        if model is None:
            return simulate(
                worn, motion, body, gender=first.gender, shape=first.shape, bounds=WORN.plain()
            )
        wearing = wearer(body, first.gender)
        record = put_on(wearing, motion, first.gender, first.shape, [*worn], made_for_it=True)
        hung = hang_at_rest(worn, wearing, first.gender, first.shape, _draper(hang_frames))
        sheets = {}
        for name, mesh in worn.items():
            cvar = Request(name, first.gender, first.shape, given[name].tightness).cvar
            rest = self._codec.body_template.rest_body(cvar).astype(np.float64)
            done = self._registrar.register(name, mesh.vertices, mesh.faces, rest)
            sheets[name] = WornSheet(
                hung[name].rest, hung[name].posed, done.offsets, done.match.mask, cvar
            )
        moved = move_by_model(model, self._codec, sheets, wearing, record, settle=settle)
        return SimulatedOutfit.of(moved, wearing, record)

    @cached_property
    def _registrar(self) -> Registrar:
        return Registrar(load_topology(self.folder / TOPOLOGY))

    def _garment(self, request: Request, garment: str, mesh: Mesh, z: np.ndarray) -> RestGarment:
        template = self._codec.body_template
        body = Mesh(template.rest_body(request.cvar), template.faces[TOPOLOGIES[0]])
        return RestGarment(garment, mesh, body, request.gender, request.shape, request.tightness, z)


def _same_wearer(garments: Sequence[RestGarment]) -> RestGarment:
    """The first garment, if all are worn together.

    Raises:
        InputError: they cannot be.
    """
    if not garments:
        raise InputError("garments: none, expected one or more")
    first, names = garments[0], [one.garment for one in garments]
    for one in garments:
        if not len(one.mesh.faces):
            raise InputError(f"garments: the {one.garment} has no faces, expected cloth")
        if one.gender != first.gender or not np.allclose(one.shape, first.shape):
            raise InputError(
                f"garments: the {one.garment} is made for another body than the {first.garment},"
                " expected garments of one wearer"
            )
    if len(set(names)) < len(names):
        raise InputError(f"garments: {', '.join(names)}, expected each type once")
    return first


def _draper(frames: int) -> SolverDraper | None:
    solver = import_module(QUICK_SOLVER.code).cloth_solver(1)
    return make_draper(solver, frames, edge_length_m=_EDGE_LENGTH_M, simulation={})


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
