"""Garments as vertices of their type's template, without a code and as principal components."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.job import Job
from drapeline.models.compare import compare
from drapeline.models.contract import HeldOutGarment
from drapeline.registration.to_template.garment_space import GarmentSpace, load_space
from drapeline.registration.to_template.remesh import RemeshTable, load_tables, remesh


class RegisteredTemplate:
    """No code: the template as registered to the garment, by tables of its type and outfit."""

    variant = "template_registered"

    def __init__(
        self, spaces: Mapping[str, GarmentSpace], tables: Mapping[str, Mapping[str, RemeshTable]]
    ) -> None:
        self.spaces, self._tables = spaces, tables

    def code_numbers(self, garment: str) -> int | None:
        """None: there is no code."""

    def rebuild(self, garments: Sequence[HeldOutGarment]) -> Iterator[Mesh]:
        """The template's vertices on each garment."""
        for garment in garments:
            table = self._tables[garment.garment][garment.outfit]
            vertices = remesh(garment.mesh.vertices, table)
            space = self.spaces[garment.garment]
            yield Mesh(self.predict(vertices, space), space.faces)

    def predict(self, vertices: np.ndarray, space: GarmentSpace) -> np.ndarray:
        """The template's vertices (N, 3) as held."""
        return vertices


class TemplatePca(RegisteredTemplate):
    """Garment4D's coefficients alpha of its principal components."""

    variant = "garment4d_pca"

    def code_numbers(self, garment: str) -> int:
        """The number of the type's components."""
        return len(self.spaces[garment].components)

    def predict(self, vertices: np.ndarray, space: GarmentSpace) -> np.ndarray:
        """The template's vertices (N, 3) from its coefficients."""
        return space.vertices(space.coefficients(vertices))


def compare_templates(job: Job) -> None:
    """Held-out garments as templates and as their principal components."""
    given, garments = job.input, job.params.garments
    spaces = {name: load_space(Path(given[name]) / "space.npz") for name in garments}
    tables = {name: load_tables(given[f"fits_{name}"]) for name in garments}
    compare(job, [RegisteredTemplate(spaces, tables), TemplatePca(spaces, tables)])
