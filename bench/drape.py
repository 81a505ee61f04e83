"""How fabrics drape by both cloth solvers: a table and a sheet of pictures.

.venv/bin/python bench/drape.py results drape.jpg

The folder is that of an experiment that has made its outfits, the first skirt of which is hung on
its wearer in the rest pose. Beside it hang a square of 24 cm, held by two corners that are brought
4 cm closer, and a strip of 20 cm that is clamped at one end. These have hung for ten seconds, the
skirt for three.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from PIL import Image

from drapeline.bodies.model import BodyModel, load_body
from drapeline.frames import FPS
from drapeline.generation.hung_outfits import Hanger
from drapeline.geometry.mesh import mean_edge_length
from drapeline.geometry.point_cache import PointCache, write_point_cache
from drapeline.outfits.fabrics import FABRICS
from drapeline.outfits.outfit import Garment, Outfit, load_outfit
from drapeline.rendering.camera import frame_points, look_at, view_direction
from drapeline.rendering.pictures import GridCell, save_grid
from drapeline.rendering.raytracer import ColouredMesh, raytrace
from drapeline.simulation.attachments import Pins
from drapeline.simulation.collider import MovingBody
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.solver import Attempt, ClothGarment, ClothSolver

_FRAMES, _SKIRT_FRAMES = 10 * FPS, 3 * FPS
_STEPS = 14
_EDGE_M, _GAP_M = 0.02, 0.004
_CLOSER_M = 0.04
_CLOSING_FRAMES = 15
_COLOURS = {
    "cotton": (0.42, 0.55, 0.72),
    "silk": (0.78, 0.62, 0.70),
    "denim": (0.30, 0.38, 0.52),
    "leather": (0.55, 0.40, 0.30),
}
_PICTURE = (230, 230)
_NO_BOUNDS = HealthBounds(
    inside_share_mean=1,
    inside_share_max=1,
    depth_m=1,
    stretch_low=0,
    stretch_high=9,
    slip_m=2,
    layer_share_mean=1,
)


class Cloth(NamedTuple):
    """Vertices (V, 3) in metres and faces (F, 4)."""

    vertices: np.ndarray
    faces: np.ndarray


class _Held(Pins):
    """Vertices that are held, and brought along a way (P, 3) in the first half second."""

    def __init__(self, held: np.ndarray, vertices: np.ndarray, way: np.ndarray) -> None:
        self.vertices, self.weights = held, np.ones(len(held))
        self._start, self._way = vertices[held].astype(np.float64), way

    def positions(self, frame: int) -> np.ndarray:
        return self._start + min(frame / _CLOSING_FRAMES, 1) * self._way


def _grid(rows: int, columns: int) -> np.ndarray:
    number = np.arange(rows * columns).reshape(rows, columns)
    corners = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
    return np.stack(corners, axis=-1).reshape(-1, 4)


def strip() -> tuple[Cloth, np.ndarray, np.ndarray]:
    """A level strip of 20 by 10 cm; the vertices at its clamp and their way, which is none."""
    x, y = np.meshgrid(np.arange(11) * _EDGE_M, np.arange(6) * _EDGE_M, indexing="ij")
    points = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    held = np.arange(12)  # two rows: the clamp keeps the strip level
    return Cloth(points, _grid(11, 6)), held, np.zeros((12, 3))


def square() -> tuple[Cloth, np.ndarray, np.ndarray]:
    """A hanging square, slightly bulged so that all fold to the same side, and its two corners.

    Four vertices are held at each: pins give way, and two would have to carry too much.
    """
    x, z = np.meshgrid(np.arange(13) * _EDGE_M, np.arange(13) * _EDGE_M, indexing="ij")
    bulge = 0.002 * np.sin(np.pi * x / x.max())
    points = np.stack([x, bulge, 1 - z], axis=-1).reshape(-1, 3)
    left, right = (row * 13 + np.array([0, 1, 13, 14]) for row in (0, 11))
    way = np.repeat([[_CLOSER_M / 2, 0, 0], [-_CLOSER_M / 2, 0, 0]], 4, axis=0)
    return Cloth(points, _grid(13, 13)), np.concatenate([left, right]), way


def hang(
    solver: ClothSolver, cloth: Cloth, held: np.ndarray, way: np.ndarray, fabric: str
) -> np.ndarray:
    """Vertices (V, 3) after a while, far from any body."""
    far = np.array([[0, 0, -9], [1, 0, -9], [0, 1, -9], [0, 0, -8]], dtype=np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    vertices = cloth.vertices.astype(np.float32)
    garment = ClothGarment(
        "cloth",
        vertices,
        cloth.faces,
        mean_edge_length(vertices, cloth.faces),
        FABRICS[fabric],
        np.zeros(len(vertices)),
        _Held(held, vertices, way),
    )
    attempt = Attempt(
        _STEPS, _GAP_M, collider_share=1.0, shape_frames=0, pose_frames=0, floor=False
    )
    with TemporaryDirectory() as name:
        write_point_cache(Path(name, "body.pc2"), [far] * _FRAMES)
        scratch = Path(name, "scratch")
        scratch.mkdir()
        with PointCache(Path(name, "body.pc2")) as frames:
            body = MovingBody(frames, faces, np.zeros(4, dtype=int))
            *_, last = solver.simulate([garment], body, attempt, scratch)
    return last[0]


def first_skirt(results: Path) -> tuple[BodyModel, Outfit]:
    """The first skirt of an experiment, without what is worn with it, and its wearer's body."""
    for path in sorted((results / "outfits").glob("*.npz")):
        outfit = load_outfit(path, path.with_suffix(".json"))
        skirts = tuple(g for g in outfit.garments if g.name == "Skirt")
        if skirts:
            body = load_body(results.parent / f"resources/body/{outfit.gender}.npz")
            return body, replace(outfit, garments=skirts)
    raise SystemExit(f"{results}/outfits has no skirt")


def worn(solver: ClothSolver, body: BodyModel, outfit: Outfit, fabric: str) -> Garment:
    """The skirt, made of a fabric, after it has hung on its wearer for a while."""
    (skirt,) = outfit.garments
    made = replace(skirt, attributes={**skirt.attributes, "fabric": fabric})
    settings = SimulationSettings(
        steps_min=_STEPS, steps_max=_STEPS, shape_frames=4, pose_frames=1, attempts=1
    )
    how = {"settings": settings.plain(), "bounds": _NO_BOUNDS.plain()}
    hanger = Hanger(solver, frames=_SKIRT_FRAMES, **how)
    hung, reason = hanger.hang(replace(outfit, garments=(made,)), body)
    if reason:
        raise SystemExit(f"{solver.name}, {fabric}: {reason}")
    return hung.garments[0]


def _picture(
    cloth: Cloth, colour: tuple[float, ...], turn_deg: float, hold: np.ndarray
) -> np.ndarray:
    """A view that shows all points of `hold` (P, 3) in the same place for both solvers."""
    centre = hold.mean(axis=0)
    away = view_direction((0.0, -1.0), turn_deg=turn_deg, rise=0.12)
    camera = look_at(centre + 2.5 * away, centre, focal_px=500, size=_PICTURE)
    (camera,) = frame_points([camera], [hold], 0.04)
    mesh = ColouredMesh(cloth.vertices, cloth.faces, colour)
    return raytrace([mesh], camera, floor_reach_m=0.01, samples=48)


def rows(results: Path, solvers: list[ClothSolver]) -> Iterator[tuple[list[str], list[GridCell]]]:
    """For each fabric the table's cells and the sheet's pictures."""
    body, outfit = first_skirt(results)
    for fabric in FABRICS:
        colour = _COLOURS[fabric]
        cells, pictures = [fabric], []
        for (cloth, held, way), turn in ((strip(), 25.0), (square(), 20.0)):
            found = [hang(solver, cloth, held, way, fabric) for solver in solvers]
            low = [1000 * (1 - f[:, 2].min()) for f in found]
            apart = 1000 * np.linalg.norm(found[0] - found[1], axis=1).mean()
            cells += [f"{low[0]:.0f} / {low[1]:.0f}", f"{apart:.1f}"]
            hold = np.concatenate(found)
            pictures += [_picture(Cloth(f, cloth.faces), colour, turn, hold) for f in found]
        skirts = [worn(solver, body, outfit, fabric) for solver in solvers]
        spans = [_hem(s.vertices, outfit.garments[0].vertices) for s in skirts]
        cells += [f"{a:.0f} / {b:.0f}" for a, b in zip(*spans, strict=True)]
        hold = np.concatenate([s.vertices for s in skirts])
        pictures += [_picture(Cloth(s.vertices, s.faces), colour, 25.0, hold) for s in skirts]
        yield cells, [GridCell(p) for p in pictures]


def _hem(skirt: np.ndarray, made: np.ndarray) -> tuple[float, float]:
    """How far a skirt's hem is below its waist, and its mean distance from the hem's middle, mm."""
    hem = np.flatnonzero(made[:, 2] < np.percentile(made[:, 2], 4))
    away = skirt[hem, :2] - skirt[hem, :2].mean(axis=0)
    drop = skirt[:, 2].max() - skirt[hem, 2].mean()
    return 1000 * drop, 1000 * float(np.linalg.norm(away, axis=1).mean())


def main(results: Path, sheet: Path) -> None:
    """Print the table and write the sheet."""
    from drapeline.blender.solver import cloth_solver as blender
    from drapeline.xpbd.solver import cloth_solver as xpbd

    solvers = [blender(1), xpbd(1)]
    print("| fabric | strip, lowest | apart | square, lowest | apart | hem, below | hem, radius |")
    pictures = []
    for cells, row in rows(results, solvers):
        print("| " + " | ".join(cells) + " |", flush=True)
        pictures.append(row)
    titles = [f"{what},\n{s.name}" for what in ("strip", "square", "skirt") for s in solvers]
    with TemporaryDirectory() as name:
        png = Path(name, "sheet.png")
        save_grid(png, pictures, columns=titles, labels=list(FABRICS))
        Image.open(png).convert("RGB").save(sheet, quality=88)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
