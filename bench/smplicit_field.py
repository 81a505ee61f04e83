"""SMPLicit's distance fields and meshes, beside the plain ways of computing them.

Fields: the network with its first layer folded, beside the same network that takes the offsets to
all clusters, as printed. Meshes: cells from coarse to fine, beside all points of a grid.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from side_by_side import Comparison, compare, cpu_seconds

from drapeline.bodies.rest_body import rest_body
from drapeline.frames import GENDERS
from drapeline.models.smplicit.model import SmplicitModel
from drapeline.models.smplicit.network import GarmentField
from drapeline.models.smplicit.surface.fields import NearBody, NetworkField
from drapeline.models.smplicit.surface.walls import Grid, extract_walls

POINTS, BATCH, CELLS, DENSE = 100_000, 10_000, 256, 2048


def plain_distances(
    model: GarmentField, points: torch.Tensor, places: torch.Tensor, z: torch.Tensor
) -> torch.Tensor:
    """(P,) metres: the layers one after another, for the offsets (P, 3K) to all clusters."""
    decoder, found = model.decoder, []
    z_cut, z_style = z.split([decoder.cut, decoder.style], 1)
    for part in points.split(BATCH):
        offsets = (part[:, None] - places).flatten(1)
        query = torch.relu(decoder.fc1_query(torch.relu(decoder.fc0_query(offsets))))
        style = torch.relu(decoder.fc1_cloth(torch.relu(decoder.fc0_cloth(z_style))))
        codes = [style.expand(len(part), -1), query, z_cut.expand(len(part), -1)]
        x = torch.cat(codes, 1)
        for index in range(4):
            x = torch.relu(getattr(decoder, f"fc{index}")(x))
        found.append(decoder.fc4(x)[:, 0])
    return torch.cat(found) * model.d_max_m


def dense_gflop_s() -> float:
    """What products of large square matrices reach."""
    square = torch.rand(DENSE, DENSE)
    return 2 * DENSE**3 / min(cpu_seconds(lambda: square @ square) for _ in range(5)) / 1e9


def rows(results: Path) -> Iterator[Comparison]:
    """Both comparisons, by the experiment's trousers."""
    model = SmplicitModel(str(results / "smplicit/trousers"))
    shape, z = np.zeros(10), model.codes.z[0]
    places = model.network.places(torch.zeros(1, 10), torch.zeros(1, dtype=torch.int8))[0]
    field = NetworkField(model.network, z, shape, 0)
    low, high = np.asarray(model.box)
    points = np.random.default_rng(0).uniform(low, high, (POINTS, 3)).astype(np.float32)
    code = torch.from_numpy(z)[None]

    def plain() -> np.ndarray:
        with torch.no_grad():
            return plain_distances(model.network, torch.from_numpy(points), places, code).numpy()

    np.testing.assert_allclose(field.distances(points), plain(), atol=1e-5)
    found = compare(
        f"SMPLicit's field at {POINTS:,} points",
        "offsets to all clusters",
        plain,
        lambda: field.distances(points),
        goal=5,
    )
    operations = POINTS * sum(2 * weight.numel() for weight, _ in field.layers)
    reached = operations / found.ours_ms / 1e6
    note = f"{reached:.0f} GFLOP/s, where dense products reach {dense_gflop_s():.0f} on this core"
    yield found._replace(note=note)
    cell_m = float((high - low).max() / CELLS)
    body = rest_body(model.bodies[GENDERS[0]], shape)
    grid = Grid(low, high, cell_m)
    sides = [np.arange(a, b + cell_m / 2, cell_m) for a, b in zip(low, high, strict=True)]
    dense = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 3).astype(np.float32)
    yield compare(
        f"SMPLicit's trousers at cells of {1000 * cell_m:.0f} mm, marching cubes included",
        f"our field at all {len(dense):,} points",
        lambda: field.distances(dense),
        lambda: extract_walls(NearBody(field, model.box, body), grid, 0.7 * cell_m),
        goal=20,
        repeats=1,
    )
