"""Toy garments and an untrained network as the files that rules read."""

from pathlib import Path

import numpy as np
import torch

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_basis, rest_body
from drapeline.frames import GENDERS, gender_codes
from drapeline.geometry.mesh import edges
from drapeline.models.gcvae.data import BodyTemplate
from drapeline.models.gcvae.load import save_static_files
from drapeline.models.gcvae.sample import draw_requests
from drapeline.models.gcvae.settings import GcvaeLoss, GcvaeNetwork, GcvaeTraining, VaeSettings
from drapeline.models.gcvae.vae import GarmentVae, StaticVae
from drapeline.models.training.checkpoints import write_checkpoint
from drapeline.models.training.module import BEST
from drapeline.registration.to_body.dynamic_offsets import SampleGarment
from drapeline.registration.to_body.topology import TOPOLOGIES, Topology, topology_codes
from drapeline.seeding import rng_for
from drapeline.storage import save_npz
from toys.gcvae import ToyGarments, toy_template, tube, tube_faces
from toys.paper import printed

SETTINGS = VaeSettings(
    network=GcvaeNetwork(widths=(6, 8, 8, 10), features=12, latent=5, condition=4),
    loss=GcvaeLoss(**printed("gcvae.loss")),
    training=GcvaeTraining(**printed("gcvae.svae.training"), normal_parts=2),
)


class TypedGarments(ToyGarments):
    """Toy garments with types that fit their topology; all types are among the held-out ones."""

    def __init__(self) -> None:
        super().__init__()
        skirted = np.flatnonzero(topology_codes(np.arange(6)))
        others = np.setdiff1d(np.arange(6), skirted)
        turn = np.arange(len(self.codes)) // 2
        self.codes = np.arange(len(self.codes)) % 2
        self.garment = np.where(
            self.codes == 1, skirted[turn % len(skirted)], others[turn % len(others)]
        )
        self.split[-12:] = "test"
        self.split[-18:-12] = "val"
        self.outfit = np.array([f"s{row:05d}" for row in range(len(self.codes))])


def save_static_data(folder: Path) -> TypedGarments:
    """What the rule `collect_static` leaves, of the toy garments."""
    garments = TypedGarments()
    folder.mkdir(parents=True)
    np.save(folder / "offsets.npy", garments.offsets)
    np.save(folder / "mask.npy", garments.mask)
    names = ("shape", "tightness", "garment", "outfit", "split")
    rows = {name: getattr(garments, name) for name in names}
    save_npz(folder / "rows.npz", **rows, gender=gender_codes(garments.gender))
    save_npz(
        folder / "statistics.npz",
        body_mean=tube().astype(np.float32),
        body_std=np.full(tube().shape, 0.02, dtype=np.float32),
    )
    return garments


def torso_registration(body: BodyModel, shape: np.ndarray) -> SampleGarment:
    """A garment 2 cm over the torso, whose simulated vertices are the torso's, in their order."""
    rest = rest_body(body, shape)
    mask = np.isin(body.segmentation, [0, 3, 6])
    vertex = np.flatnonzero(mask).astype(np.int32)
    away = rest[vertex] * [1, 1, 0]
    offsets = np.zeros_like(rest, dtype=np.float32)
    offsets[vertex] = 0.02 * away / np.linalg.norm(away, axis=1, keepdims=True)
    return SampleGarment(
        mask=mask,
        vertex=vertex,
        corner=np.repeat(np.arange(len(vertex))[:, None], 3, axis=1).astype(np.int32),
        bary=np.tile(np.float32([1, 0, 0]), (len(vertex), 1)),
        offsets=offsets,
        weights=body.weights[vertex],
    )


def template_on_body(body: BodyModel, cvar: int) -> BodyTemplate:
    """The body's mesh for both topologies, with a made-up hierarchy and plain statistics."""
    links, parents = [edges(body.faces)], []
    for count in (48, 12, 4):
        size = int(links[-1].max()) + 1
        parent = (np.arange(size) * count // size).astype(np.int32)
        pairs = np.unique(np.sort(parent[links[-1]], axis=1), axis=0)
        links.append(pairs[pairs[:, 0] < pairs[:, 1]])
        parents.append(parent)
    one = np.ones(body.v_template.shape, dtype=np.float32)
    rest = rest_body(body, np.zeros(10)).astype(np.float32)
    return BodyTemplate(
        edges=dict.fromkeys(TOPOLOGIES, links),
        parents=dict.fromkeys(TOPOLOGIES, parents),
        faces=dict.fromkeys(TOPOLOGIES, body.faces),
        offset_mean=np.stack([0 * one] * len(TOPOLOGIES)),
        offset_std=np.stack([0.01 * one] * len(TOPOLOGIES)),
        base_mean=rest,
        base_std=one,
        body_mean=rest,
        body_std=one,
        body_basis=rest_basis(dict.fromkeys(GENDERS, body)),
        cvar_mean=np.zeros(cvar, dtype=np.float32),
        cvar_std=np.ones(cvar, dtype=np.float32),
    )


def shaken(model: GarmentVae) -> GarmentVae:
    """The network with random numbers added to all weights, so that its garments are not empty."""
    rng = rng_for(0, "shaken")
    with torch.no_grad():
        for parameter in model.parameters():
            noise = 0.2 * rng.standard_normal(parameter.shape)
            parameter.add_(torch.from_numpy(noise.astype(np.float32)))
    return model.eval()


def save_model(
    folder: Path, model: GarmentVae | None = None, garments: TypedGarments | None = None
) -> GarmentVae:
    """What a training leaves: the best checkpoint, here of an untrained network.

    With garments, what their training would leave of them as well.
    """
    model = model or shaken(StaticVae(SETTINGS, toy_template()))
    folder.mkdir(parents=True)
    write_checkpoint(folder / BEST, model.state_dict(), model.checkpoint_metadata())
    if garments is not None:
        save_static_files(folder, model, garments, toy_topology())
    return model


def toy_topology() -> Topology:
    """The tube's two meshes; everything else is zero."""
    return plain_topology(tube().astype(np.float32), tube_faces(False), tube_faces(True))


def plain_topology(rest: np.ndarray, faces: np.ndarray, skirt_faces: np.ndarray) -> Topology:
    """Two meshes on vertices (V, 3); everything else is zero."""
    count = len(rest)
    return Topology(
        faces=faces,
        skirt_faces=skirt_faces,
        joining=np.int32(0),
        inner_leg=np.zeros(count, dtype=bool),
        segments=np.zeros(count, dtype=np.int32),
        corners=np.zeros((count, 3), dtype=np.int32),
        shares=np.zeros((count, 3)),
        rest=rest,
    )


def requests(count=4, garments=("prior", "Dress"), **changed):
    """Requests of sampled garments, by name."""
    settings = {
        "female_share": 0.5,
        "shape": None,
        "shape_range": 1.0,
        "tightness": None,
        "tightness_range": (-1.5, 0.5),
    }
    return draw_requests(0, count, garments, **{**settings, **changed})
