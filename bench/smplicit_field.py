"""Times of SMPLicit's distance fields and meshes, beside the plain ways of computing them.

.venv/bin/python bench/smplicit_field.py results/smplicit/trousers

Field: points per second of the network with its first layer folded, and of the same network that
takes the offsets to all clusters, as printed, both on one thread. Meshes: cells from coarse to fine
beside all cells of a grid that has 256 along its longest side. The ways take turns, so that a busy
machine slows all of them; ratios are of medians.
"""

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
import torch

from drapeline.bodies.rest_body import rest_body
from drapeline.frames import GENDERS
from drapeline.models.smplicit.model import NearBody, SmplicitModel
from drapeline.models.smplicit.network import GarmentField
from drapeline.models.smplicit.network_field import NetworkField
from drapeline.models.smplicit.walls import Grid, extract_walls

POINTS, BATCH, ROUNDS, CELLS = 100_000, 10_000, 5, 256


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


def seconds(way: Callable[[], object]) -> float:
    """Time of a call."""
    start = time.perf_counter()
    way()
    return time.perf_counter() - start


def main(folder: str) -> None:
    """Print both comparisons."""
    torch.set_num_threads(1)
    model = SmplicitModel(folder)
    shape, z = np.zeros(10), model.codes.z[0]
    places = model.network.places(torch.zeros(1, 10), torch.zeros(1, dtype=torch.int8))[0]
    field = NetworkField(model.network, z, shape, 0)
    low, high = np.asarray(model.box)
    points = np.random.default_rng(0).uniform(low, high, (POINTS, 3)).astype(np.float32)
    code = torch.from_numpy(z)[None]

    def plain() -> np.ndarray:
        with torch.no_grad():
            return plain_distances(model.network, torch.from_numpy(points), places, code).numpy()

    error_m = np.abs(plain() - field.distances(points)).max()
    times = [(seconds(plain), seconds(lambda: field.distances(points))) for _ in range(ROUNDS)]
    slow, fast = map(statistics.median, zip(*times, strict=True))
    print(
        f"field of {POINTS} points: plain {slow:.2f} s, folded {fast:.2f} s, {slow / fast:.1f}"
        f" times faster; largest difference {1000 * error_m:.1e} mm"
    )

    cell_m = float((high - low).max() / CELLS)
    threshold_m = 0.7 * cell_m
    body = rest_body(model.bodies[GENDERS[0]], shape)
    grid = Grid(low, high, cell_m)
    sides = [np.arange(a, b + cell_m / 2, cell_m) for a, b in zip(low, high, strict=True)]
    dense = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 3).astype(np.float32)
    whole = seconds(lambda: field.distances(dense))
    sparse = statistics.median(
        seconds(lambda: extract_walls(NearBody(field, model.box, body), grid, threshold_m))
        for _ in range(3)
    )
    print(
        f"walls at cells of {1000 * cell_m:.1f} mm: all {len(dense)} points of the grid"
        f" {whole:.1f} s, those near the walls with marching cubes {sparse:.2f} s,"
        f" {whole / sparse:.1f} times faster"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
