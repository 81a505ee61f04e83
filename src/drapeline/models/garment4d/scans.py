"""Garment4D's garments in scans: in single segmented scans, and in a user's own sequence.

F frames, P points, N vertices and D components of a type's template.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial import KDTree

from drapeline.bodies import follow
from drapeline.bodies.model import BodyModel, load_bodies
from drapeline.bodies.moved_body import BodyState
from drapeline.dataset.scans import ScanSequence
from drapeline.dataset.segmented_scans import ScanWindow, SegmentedScan
from drapeline.geometry.closest import closest_points
from drapeline.geometry.least_squares import LeastSquares, absolute_weights
from drapeline.geometry.mesh import Mesh, barycentric, boundary_edges, face_normals, vertex_normals
from drapeline.job import Job
from drapeline.metrics import sequence as metrics
from drapeline.metrics.garment4d import MODEL
from drapeline.metrics.metric import Measured
from drapeline.metrics.predictions import Reconstruction
from drapeline.metrics.table import join, summarise, without_all
from drapeline.models.compare import fit_scans, move_garments
from drapeline.models.contract import MovingPerson, Stopwatch
from drapeline.models.garment4d.data import BodySet, Seen, propose_garment
from drapeline.models.garment4d.ours.model import OurModel
from drapeline.models.garment4d.reconstruct import (
    NetworksModel,
    ReconstructedGarment,
    ReconstructionModel,
    body_frames,
    build_reconstruction,
)
from drapeline.models.garment4d.settings import SkinningSettings
from drapeline.outfits.garment_types import LABELS
from drapeline.outfits.worn import SkinningOptions, pose_in_layers
from drapeline.registration.to_scan import move_to_scan
from drapeline.registration.to_template.garment_space import GarmentSpace
from drapeline.rule_log import LOGGER
from drapeline.schema import Table
from drapeline.seeding import rng_for

PCA, MOVED, POSED, OURS = (f"garment4d_scan_{name}" for name in ("pca", "moved", "posed", "ours"))
_FLOOR_M = 0.003  # below it, absolute distances are taken for squares
_CORNER = 1e-3  # share from which a corner takes part in a place on a face
_BEYOND = 3.0  # distances between points, from which a vertex is off the cloud
_SLIDE = 0.02  # weight of offsets along the cloth, where it is free to slide below the points
SPLIT = "scans"
INTERPOLATED = "moved_interpolated"
_SHOWN = 48  # frames of the sequence that pictures are made of, at most


@dataclass(frozen=True)
class FitTemplate:
    """Settings of the fit of a template's components to points."""

    steps: int = 20  # of least squares, after each of which points find new places on the garment
    points: int = 1500  # of the garment that count, and vertices of the template
    weight: float = 100.0  # of the points, as a number of independent ones
    points_m: float = 0.005  # how far garments are off the points, metres
    # How the template follows the body.
    skinning: SkinningOptions = field(default_factory=SkinningOptions)


class Garment4dScanFitter:
    """Fulfils `ScanFitter`.

    The components alone are fitted to the garment's points, and the garment moved to them. Our
    model and the paper's networks are given the scan's window, with its labels, or the scan as a
    body that stands still.

    Args:
        ours: our models by type.
        networks: the paper's of the same types.
    """

    def __init__(
        self,
        ours: Mapping[str, OurModel],
        networks: Mapping[str, NetworksModel],
        settings: FitTemplate,
        seed: int,
    ) -> None:
        self.watch = Stopwatch()
        self._ours, self._networks = ours, networks
        self._settings, self._seed = settings, seed

    def fit(self, scan: SegmentedScan, body: BodyState) -> dict[str, dict[str, Mesh]]:
        """The garments that models know, in four ways."""
        found: dict[str, dict[str, Mesh]] = {PCA: {}, POSED: {}, OURS: {}}
        at_rest: dict[str, Mesh] = {}
        for name in scan.garments:
            if name in self._ours:
                ours = self._ours[name]
                faces = ours.space.faces
                wearer = ours.bodies.models[scan.gender]
                rng = rng_for(self._seed, "template", scan.name, name)
                with self.watch.of(PCA, MOVED):
                    fitted = fit_template(ours.space, scan, name, wearer, body, self._settings, rng)
                at_rest[name] = Mesh(fitted, faces)
                with self.watch.of(POSED):
                    networks = self._networks[name]
                    seen = self._see(networks, networks.stage.settings.training.frames, scan, body)
                    found[POSED][name] = Mesh(_middle(networks.make(seen).final, body), faces)
                with self.watch.of(OURS):
                    seen, step = self._see(ours, ours.guesser.frames, scan, body), ours.final_step
                    if _is_still(scan, ours.guesser.frames):
                        # Nothing moves, so that nothing is to be simulated.
                        step = replace(step, simulated_error_m=None)
                    laid = step(ours.guesser.guess(seen).canonical, seen, ours.refining)
                    found[OURS][name] = Mesh(_middle(laid.final, body), faces)
        if at_rest:
            with self.watch.of(PCA, MOVED):
                person = follow.pose_body(wearer, body.shape, body.pose, body.trans)
                found[PCA] = pose_in_layers(at_rest, person, self._settings.skinning)
            with self.watch.of(MOVED):
                found[MOVED] = move_to_scan(found[PCA], at_rest, scan, person)
        return {variant: garments for variant, garments in found.items() if garments}

    def _see(
        self, model: ReconstructionModel, frames: int, scan: SegmentedScan, body: BodyState
    ) -> Seen:
        """A window of at least so many frames, or as many of a body that stands still.

        Of other points each.
        """
        window = scan.window
        if window is None or _is_still(scan, frames):
            window = ScanWindow(
                np.tile((scan.points - body.trans).astype(np.float32), (frames, 1, 1)),
                np.tile(scan.labels, (frames, 1)),
                np.tile(body.pose, (frames, 1)),
                np.tile(body.trans, (frames, 1)),
            )
        rng = rng_for(self._seed, "networks", scan.name, model.garment)
        total, count = window.points.shape[1], model.points
        chosen = np.stack([rng.choice(total, count, replace=total < count) for _ in window.points])
        return Seen(
            np.take_along_axis(window.points, chosen[..., None], axis=1),
            window.poses,
            window.trans,
            model.bodies.of(scan.gender, body.shape),
            np.take_along_axis(window.labels, chosen, axis=1),
        )


def _is_still(scan: SegmentedScan, frames: int) -> bool:
    """Whether a scan is shown as a body that stands still, to a model of so many frames."""
    return scan.window is None or len(scan.window.points) < frames


def _middle(garment: np.ndarray, body: BodyState) -> np.ndarray:
    """The middle one of frames (F, N, 3), in the scan's world."""
    return (garment[len(garment) // 2] + body.trans).astype(np.float32)


def fit_template(
    space: GarmentSpace,
    scan: SegmentedScan,
    garment: str,
    wearer: BodyModel,
    body: BodyState,
    settings: FitTemplate,
    rng: np.random.Generator,
) -> np.ndarray:
    """(N, 3) float32 at rest, of the components that fit the points of a garment.

    Points come to lie on the garment, and vertices on the points, but for those next to a garment
    that may hide them. Both may slide along the cloth, except where one of them ends before the
    other. Each component has a normal prior, with the variance of training garments.
    """
    posed_body = follow.pose_body(wearer, body.shape, body.pose, body.trans)
    own = scan.points_of(garment).astype(np.float64)
    over = scan.garments[scan.garments.index(garment) + 1 :]
    hiding = np.isin(scan.labels, [LABELS.index(name) for name in over])
    tree, own_tree = KDTree(scan.points), KDTree(own)
    spacing_m = _BEYOND * float(np.median(own_tree.query(own, k=2)[0][:, 1]))
    points = own[rng.choice(len(own), min(len(own), settings.points), replace=False)]
    size = len(space.components)
    vertices = rng.choice(len(space.mean), min(len(space.mean), settings.points), replace=False)
    alpha = np.zeros(size)
    edge = np.zeros(len(space.mean), dtype=bool)
    edge[boundary_edges(space.faces)] = True
    for _ in range(settings.steps):
        rest = space.vertices(alpha)
        motions = follow.garment_motions(
            Mesh(rest, space.faces),
            posed_body,
            neighbours=settings.skinning.neighbours,
            smoothing=settings.skinning.smoothing,
        )
        posed = follow.move(rest, motions)
        slopes = np.einsum("nab,dnb->nad", motions[:, 1:], space.components)
        place, face = closest_points(points, posed, space.faces)
        corners = space.faces[face]
        share = barycentric(place.astype(np.float64), posed[corners])
        equations = LeastSquares(size)
        _add_offsets(
            equations,
            place - points,
            np.einsum("pc,pcad->pad", share, slopes[corners]),
            face_normals(posed, corners),
            ((share > _CORNER) <= edge[corners]).all(axis=1),
            settings,
        )
        seen = vertices[~hiding[tree.query(posed[vertices])[1]]]
        if len(seen):
            distance, nearest = own_tree.query(posed[seen])
            normals = vertex_normals(posed, space.faces)[seen]
            # Within the cloud, the nearest point is somewhere between others.
            beyond = edge[seen] & (distance > spacing_m)
            to_points = posed[seen] - own[nearest]
            _add_offsets(equations, to_points, slopes[seen], normals, beyond, settings)
        equations.add_prior(slice(None), alpha, 1.0)
        alpha = alpha + equations.step()
    return space.vertices(alpha)


def _add_offsets(
    equations: LeastSquares,
    offsets: np.ndarray,
    slopes: np.ndarray,
    normals: np.ndarray,
    held: np.ndarray,
    settings: FitTemplate,
) -> None:
    """Offsets (P, 3) with derivatives (P, 3, D), along normals (P, 3) alone unless held (P,)."""
    height = np.einsum("pi,pi->p", offsets, normals)
    length = np.where(held, np.linalg.norm(offsets, axis=1), np.abs(height))
    total = settings.weight / settings.points_m / len(offsets)
    weight = total * absolute_weights(length, _FLOOR_M)
    equations.add(np.einsum("pi,pid->pd", normals, slopes), height, weight * ~held)
    along = np.repeat(weight * np.where(held, 1.0, _SLIDE), 3)
    equations.add(slopes.reshape(-1, slopes.shape[-1]), offsets.ravel(), along)


class ScannedGarment(NamedTuple):
    """A garment reconstructed from scans."""

    made: ReconstructedGarment
    rows: Table  # of the table of metrics
    shown: Reconstruction  # some frames with all steps, for figures


def reconstruct_scans(
    scans: ScanSequence, model: ReconstructionModel, *, name: str, seed: int
) -> ScannedGarment:
    """The garment of a model's type in scans.

    Args:
        scans: with the body.
        name: of the scans' file or folder, for errors and pictures.

    Raises:
        InputError: see `ReconstructionModel.reconstruct_scans`.
    """
    made = model.reconstruct_scans(scans, name=name, seed=seed)
    seen = model.seen_vertices(made)
    LOGGER.info(
        "%s: on average %.0f %% of the %s was seen in a frame, and %.0f %% in none",
        name,
        100 * seen.mean(),
        model.garment,
        100 * (~seen.any(axis=0)).mean(),
    )
    some = np.arange(0, len(made.final), -(-len(made.final) // _SHOWN))
    shown = build_reconstruction(
        made._replace(
            seen=made.seen.frames(some), proposal=made.proposal[some], final=made.final[some]
        ),
        name=Path(name).name,
        garment=model.garment,
        faces=model.space.faces,
        number=some,
    )
    return ScannedGarment(made, _measure(scans, model.garment, made, seed), shown)


def _measure(scans: ScanSequence, garment: str, made: ReconstructedGarment, seed: int) -> Table:
    """Table 5 before and after the garment is laid on the points, against the whole scans."""
    seen = made.seen
    moving = body_frames(seen.body, seen.poses)
    shift = seen.trans - scans.body.trans  # of the root joint, where the body was fitted
    whole = [
        (scan.points - away).astype(np.float32)
        for scan, away in zip(scans.scans, shift, strict=True)
    ]
    tables = []
    for variant, vertices in {"ours_proposals": made.proposal, "ours": made.final}.items():
        measures = metrics.sequence_measures(vertices, body=moving, points=whole)
        one = Measured(SPLIT, garment, measures)
        tables.append(summarise([one], model=MODEL, variant=variant, split=SPLIT, seed=seed))
    return without_all(join(tables))


class InterpolatedMover:
    """Fulfils `Mover` with the paper's skinning alone (equations 1 and 2).

    Args:
        bodies: of both genders.
        settings: of the weights.
    """

    def __init__(self, bodies: BodySet, settings: SkinningSettings) -> None:
        self.watch = Stopwatch()
        self._bodies, self._settings = bodies, settings

    def move(self, person: MovingPerson) -> dict[str, dict[str, Mesh]]:
        """All garments."""
        wearer, pose = self._bodies.of(person.gender, person.shape), person.poses[-1:]
        moved = {}
        with self.watch.of(INTERPOLATED):
            for name, rest in person.rest.items():
                settled = propose_garment(wearer, pose, rest.vertices, rest.faces, self._settings)
                moved[name] = Mesh(settled[0], rest.faces)
        return {INTERPOLATED: moved}


def move_garments_at_rest(job: Job) -> None:
    """True garments at rest, moved by the paper's skinning."""
    bodies = load_bodies(job.input)
    settings = SkinningSettings(**job.params.skinning)
    move_garments(job, InterpolatedMover(BodySet(bodies, job.params.body_points), settings), bodies)


def fit_to_scans(job: Job) -> None:
    """Garment4D's components, its networks and our model in held-out scans."""
    torch.set_num_threads(job.threads)
    ours = {model.garment: model for model in map(OurModel, job.input.ours)}
    networks = {model.garment: model for model in map(NetworksModel, job.input.networks)}
    fitter = Garment4dScanFitter(ours, networks, FitTemplate(), job.params.seed)
    fit_scans(job, fitter, load_bodies(job.input))
