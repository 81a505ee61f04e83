"""The network P(p, theta, z_theta) as it is trained: what poses do to cloth (SMPLicit 3.5).

It is the decoder of the distances with other inputs and outputs: z_theta takes the place of
z_style, the pose that of z_cut, and three numbers that of the distance. Of the pose, a point knows
all joints, and what its own skinning does to it, which carries over to other motions.

B frames of garments, P points, K clusters of the body. Displacements are in the T-pose.
"""

from collections.abc import Mapping
from typing import Any

import torch

from drapeline.learning_data.pose_displacements import POSE_NUMBERS
from drapeline.models.layers.precision import full_precision
from drapeline.models.smplicit.clusters import cluster_places
from drapeline.models.smplicit.decoder import Decoder
from drapeline.models.smplicit.displacement_settings import DisplacementSettings
from drapeline.models.training.batches import Batch
from drapeline.models.training.module import RATE_SHARE, TrainableModule
from drapeline.seeding import rng_for

TURN_NUMBERS = 12
_LEAST_EDGE_M = 1e-4
_UNIT_M = 0.03  # of the network's outputs and of the loss, about as far as cloth is displaced


@full_precision
def blend_motions(weights: torch.Tensor, motions: torch.Tensor) -> torch.Tensor:
    """(B, P, 3, 4) motions of points by their weights (B, P, 24) and the joints' (B, 24, 3, 4)."""
    return (weights @ motions.flatten(2)).unflatten(2, (3, 4))


@full_precision
def move(points: torch.Tensor, motions: torch.Tensor) -> torch.Tensor:
    """(B, P, 3) points in the pose, from those in the T-pose and motions of `blend_motions`."""
    return (motions[..., :3] @ points[..., None])[..., 0] + motions[..., 3]


@full_precision
def encode_turns(motions: torch.Tensor, joints: torch.Tensor) -> torch.Tensor:
    """The pose as points have it, about zero at rest.

    Args:
        motions: (B, P, 3, 4) of `blend_motions`.
        joints: (B, 24, 3, 4) motions of the joints from the T-pose.

    Returns:
        (B, P, `TURN_NUMBERS`): the direction of gravity in the T-pose, if a point was turned back
        there by its skinning, minus that of a body that stands upright; and how the skinning turns
        the point against the root joint, minus the identity.
    """
    turn, root = motions[..., :3], joints[:, 0, :, :3]
    down = -turn[..., 2, :]  # R^T (0, 0, -1)
    own = root.mT[:, None] @ turn
    upright = turn.new_tensor([0.0, -1.0, 0.0])
    return torch.cat([down - upright, (own - torch.eye(3).to(turn)).flatten(2)], 2)


class DisplacementField(TrainableModule):
    """The displacement of the garments of a model of SMPLicit.

    Args:
        name: of `FIELD_MODELS`.
        settings: sizes, losses and training.
        place_basis: (22, K, 3) of the clusters, see `cluster_basis`.
        garments: of the data, each of which has a code.
    """

    checkpoint_type = "smplicit_displacement"

    def __init__(
        self, name: str, settings: DisplacementSettings, place_basis: torch.Tensor, garments: int
    ) -> None:
        super().__init__()
        self.name, self.settings = name, settings
        sizes, seed = settings.network, settings.training.seed
        rng = torch.Generator().manual_seed(int(rng_for(seed, "weights").integers(2**62)))
        self.decoder = Decoder(
            place_basis.shape[1],
            TURN_NUMBERS + POSE_NUMBERS,
            sizes.code,
            width=sizes.width,
            outputs=3,
            rng=rng,
        )
        self.codes = torch.nn.Parameter(torch.zeros(garments, sizes.code))
        self.register_buffer("place_basis", place_basis)

    def checkpoint_metadata(self) -> dict[str, Any]:
        """Settings and sizes for the checkpoint."""
        return {
            "checkpoint_type": self.checkpoint_type,
            "name": self.name,
            "settings": self.settings.plain(),
            "clusters": self.decoder.clusters,
            "garments": len(self.codes),
        }

    def forward(
        self,
        points: torch.Tensor,
        turns: torch.Tensor,
        pose: torch.Tensor,
        shape: torch.Tensor,
        gender: torch.Tensor,
        z: torch.Tensor,
    ) -> torch.Tensor:
        """(B, P, 3) displacements, metres.

        Args:
            points: (B, P, 3) metres, at rest.
            turns: (B, P, `TURN_NUMBERS`) of `encode_turns`.
            pose: (B, `POSE_NUMBERS`) of `encode_poses`.
            shape, gender: (B, 10) and (B,) of the wearers; 0 female, 1 male.
            z: (B, code).
        """
        places = cluster_places(self.place_basis, shape, gender)
        query = self.decoder.query(points, *self.decoder.fold(places))
        pose, codes = (x[:, None].expand(-1, points.shape[1], -1) for x in (pose, z))
        theta = torch.cat([turns, pose], 2)
        base = self.decoder.base(theta.flatten(0, 1), codes.flatten(0, 1))
        return _UNIT_M * self.decoder.joint(query + base.unflatten(0, points.shape[:2]))

    def training_step(self, batch: Batch) -> torch.Tensor:
        """Distances of points in the pose, edge lengths there, and the prior of the codes."""
        own, weights = self.codes[batch["garment_index"]], self.settings.loss
        pose = batch["pose"] * self._keep("pose", batch["pose"], weights.pose_dropout)
        z = own * self._keep("unknown", own, weights.unknown)
        terms = self._terms({**batch, "pose": pose}, z)
        latent = own.square().mean()
        loss = self._loss(terms) + weights.latent * latent
        terms = {**terms, "latent": latent}
        self.stop_if_unfinite(loss, terms, batch["names"])
        self.log_means("train", terms, len(own))
        return loss

    def validation_step(self, batch: Batch) -> None:
        """The same for garments that have no code: theirs is zero."""
        zero = torch.zeros_like(self.codes[batch["garment_index"]])
        with torch.no_grad():
            terms = self._terms(batch, zero)
        self.log_means("val", {**terms, "loss": self._loss(terms)}, len(zero))

    def _terms(self, batch: Batch, z: torch.Tensor) -> dict[str, torch.Tensor]:
        motions = blend_motions(batch["weights"], batch["motions"])
        turns = encode_turns(motions, batch["motions"])
        given = (batch[name] for name in ("pose", "shape", "gender"))
        predicted = self(batch["points"], turns, *given, z)
        # Errors count as they are seen, in the pose: where the skinning turns cloth over itself,
        # undoing it makes a centimetre a metre.
        moved, true = (
            move(batch["straight"] + away, motions) for away in (predicted, batch["displacement"])
        )
        lengths, true_lengths = (
            (start - end).norm(dim=-1) for start, end in (x.chunk(2, 1) for x in (moved, true))
        )
        stretch = lengths / true_lengths.clamp(min=_LEAST_EDGE_M) - 1
        return {
            "vertex_error_mm": 1000 * (moved - true).norm(dim=-1).mean(),
            "edge": stretch.square().mean(),
        }

    def _loss(self, terms: Mapping[str, torch.Tensor]) -> torch.Tensor:
        vertex = terms["vertex_error_mm"] / (1000 * _UNIT_M)
        return vertex + self.settings.loss.edge * terms["edge"]

    def _keep(self, name: str, values: torch.Tensor, dropout: float) -> torch.Tensor:
        """(B, 1) factors of values (B, ...), zero for a share of them, drawn for each step anew."""
        rng = rng_for(self.settings.training.seed, name, self.at.step, self.at.rank)
        return torch.from_numpy(rng.random((len(values), 1)) >= dropout).to(values)

    def optimizer(self) -> torch.optim.Optimizer:
        """Adam, with larger steps for the codes."""
        training = self.settings.training
        network = [p for name, p in self.named_parameters() if name != "codes"]
        groups = [
            {"params": network, RATE_SHARE: 1.0},
            {"params": [self.codes], RATE_SHARE: training.code_rate},
        ]
        return torch.optim.Adam(groups, lr=training.learning_rate, fused=True)
