"""Garments become offsets: laid onto the body, matched with it, and measured."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from drapeline.bodies.model import BodyModel
from drapeline.bodies.rest_body import rest_body
from drapeline.errors import InputError
from drapeline.frames import GENDERS
from drapeline.geometry.mesh import boundary_edges, triangulate
from drapeline.outfits.garment_types import GARMENTS, SKIRTS
from drapeline.outfits.static import StaticOutfit
from drapeline.registration.error_table import Measure, error_rows
from drapeline.registration.to_body.body_mesh import BodyMesh
from drapeline.registration.to_body.correspondence import Correspondence, correspond
from drapeline.registration.to_body.nicp import NicpSettings, Surface, lay_on
from drapeline.registration.to_body.round_trip import round_trip
from drapeline.registration.to_body.skirt_tube import SkirtTube
from drapeline.registration.to_body.topology import Topology
from drapeline.rule_log import progress


class Registration(NamedTuple):
    """One garment on one body.

    Attributes:
        laid: (C, 3) the garment deformed onto the body.
        match: body vertices and their points on the garment.
        offsets: (V, 3) float32 metres.
        measures: of the round trip.
    """

    laid: np.ndarray
    match: Correspondence
    offsets: np.ndarray
    measures: list[Measure]


class Registrar:
    """Registers garments of all types on bodies of all shapes.

    Args:
        topology: of the super-resolved bodies.

    Attributes:
        topology: as given.
    """

    def __init__(self, topology: Topology) -> None:
        self.topology = topology
        self._settings = NicpSettings()
        count = len(topology.rest)
        self._body = BodyMesh(topology.faces, count)
        self._skirt = BodyMesh(topology.skirt_faces, count)

    @cached_property
    def _tube(self) -> SkirtTube:
        return SkirtTube(self.topology)

    def register(
        self, name: str, vertices: np.ndarray, faces: np.ndarray, body: np.ndarray
    ) -> Registration:
        """Register one garment.

        Args:
            name: its type, one of `GARMENTS`.
            vertices: (C, 3) in the rest pose, metres.
            faces: (F, 3) or (F, 4).
            body: (V, 3) super-resolved body of the wearer's shape in the rest pose.

        Raises:
            InputError: no body vertex lies under the garment.
        """
        garment = np.asarray(vertices, dtype=np.float64)
        triangles = triangulate(faces)
        mesh, target = self._body, body
        if name in SKIRTS:
            mesh = self._skirt
            target = self._tube(body, garment, np.unique(boundary_edges(triangles)))
        surface = Surface(target, mesh.faces, self._settings.turn_m)
        laid = lay_on(garment, triangles, surface, self._settings)
        match = correspond(target, mesh, laid, triangles)
        if not match.mask.any():
            raise InputError(f"{name}: covers no part of the body, expected a garment in its place")
        measures = round_trip(garment, triangles, body, mesh.faces, match)
        return Registration(laid, match, match.offsets(garment, body), measures)


def register_shard(
    registrar: Registrar, outfits: Sequence[StaticOutfit], bodies: Mapping[str, BodyModel]
) -> tuple[dict[str, np.ndarray], list[dict[str, Any]]]:
    """Register all garments of static outfits.

    Args:
        registrar: of the bodies' topologies.
        outfits: as `load_static` reads them.
        bodies: super-resolved, by gender.

    Returns:
        Arrays with a row per garment (`offsets`, `mask`, `shape`, `gender`, `tightness`,
        `garment`, `outfit`, `split`), and rows of the table of errors.

    Raises:
        InputError: names the outfit whose garment cannot be registered.
    """
    rows: list[tuple] = []
    errors: list[dict[str, Any]] = []
    for name, split, outfit in progress(outfits, total=len(outfits), label="outfits"):
        body = rest_body(bodies[outfit.gender], outfit.shape)
        for garment in outfit.garments:
            try:
                done = registrar.register(garment.name, garment.vertices, garment.faces, body)
            except InputError as error:
                raise InputError(f"outfit {name}: {error}") from error
            rows.append(
                (
                    done.offsets,
                    done.match.mask,
                    outfit.shape.astype(np.float32),
                    np.int8(GENDERS.index(outfit.gender)),
                    outfit.signed_tightness.astype(np.float32),
                    np.int8(GARMENTS.index(garment.name)),
                    name,
                    split,
                )
            )
            errors += error_rows(garment.name, name, done.measures)
    keys = ("offsets", "mask", "shape", "gender", "tightness", "garment", "outfit", "split")
    columns = zip(*rows, strict=True)
    return {key: np.array(column) for key, column in zip(keys, columns, strict=True)}, errors
