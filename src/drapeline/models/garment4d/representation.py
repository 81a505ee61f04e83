"""Garments as vertices of their type's template, without a code and as principal components."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.job import Job
from drapeline.models.compare import compare
from drapeline.models.contract import HeldOutGarment
from drapeline.models.registry import CODE_SIZES
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
    """Garment4D's coefficients alpha of its principal components.

    Args:
        count: of the components, the first ones; all if None.
    """

    def __init__(
        self,
        spaces: Mapping[str, GarmentSpace],
        tables: Mapping[str, Mapping[str, RemeshTable]],
        count: int | None = None,
    ) -> None:
        super().__init__(spaces, tables)
        self._count = count
        self.variant = "garment4d_pca" if count is None else f"garment4d_pca_{count}"

    def code_numbers(self, garment: str) -> int:
        """The number of the type's components."""
        return len(self.spaces[garment].components[: self._count])

    def predict(self, vertices: np.ndarray, space: GarmentSpace) -> np.ndarray:
        """The template's vertices (N, 3) from its coefficients."""
        alpha = space.coefficients(vertices)
        if self._count is not None:
            alpha[self._count :] = 0
        return space.vertices(alpha)


def compare_templates(job: Job) -> None:
    """Held-out garments as templates and as their principal components."""
    given, garments = job.input, job.params.garments
    spaces = {name: load_space(Path(given[name]) / "space.npz") for name in garments}
    tables = {name: load_tables(given[f"fits_{name}"]) for name in garments}
    most = max(len(space.components) for space in spaces.values())
    counts = [None, *(count for count in CODE_SIZES if count < most)]
    codes = [TemplatePca(spaces, tables, count) for count in counts]
    compare(job, [RegisteredTemplate(spaces, tables), *codes])
