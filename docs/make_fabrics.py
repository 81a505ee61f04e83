"""Write the tables of docs/background/fabrics.md, and with `--measure` its sheet as well.

PYTHONPATH=src:bench .venv/bin/python docs/make_fabrics.py [--measure]

The values are those of `drapeline.outfits.fabrics`. To measure, every fabric is hung by both
solvers (`bench/drape.py`), which takes a core a quarter of an hour.
"""

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drapeline.outfits.fabrics import FABRICS, MEASURED_FABRICS, Fabric

if TYPE_CHECKING:
    from drape import Sheet

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/background/fabrics.md"
SHEET = ROOT / "docs/images/fabrics.jpg"
# Name, edge length in metres and whether of triangles, of the meshes that fabrics are hung with.
MESHES = (("1 cm", 0.01, False), ("2 cm", 0.02, False), ("triangles of 1 cm", 0.01, True))
# Drape coefficients of real cloth, per cent; the page says where they come from.
PUBLISHED = {
    "cotton": (60, 76),
    "denim": (70, 90),
    "silk": (20, 40),
    "wool_suiting": (40, 70),
    "leather": (47, 70),
}


def replace_block(page: str, name: str, lines: list[str]) -> str:
    """The page with new lines between the comments that begin and end a block."""
    text = "\n".join(["", *lines, ""])
    return re.sub(
        rf"(<!-- {name} -->).*?(<!-- end -->)",
        lambda found: found[1] + text + found[2],
        page,
        flags=re.DOTALL,
    )


def value_rows() -> list[str]:
    """The table of values: a row for each fabric."""
    head = ["g/m²", "stretch, N/m", "shear, N/m", "bending, µN m", "bending length, cm"]
    head += ["damping, kg/s", "friction on skin / itself", "mm", "in `info.mat`", "not for"]
    rows = [_row(["fabric", *head]), _row(["---"] * (len(head) + 1))]
    for name in FABRICS:
        rows.append(_row([f"`{name}`", *_values(FABRICS[name])]))
    return rows


def _values(fabric: Fabric) -> list[str]:
    lengths = [
        100 * (bending / fabric.density_kg_m2 / 9.81) ** (1 / 3)
        for bending in (fabric.bending_warp_n_m, fabric.bending_weft_n_m)
    ]
    others = [name for name in FABRICS["cotton"].garments if name not in fabric.garments]
    return [
        f"{1000 * fabric.density_kg_m2:g}",
        f"{fabric.stretch_warp_n_per_m:g} / {fabric.stretch_weft_n_per_m:g}",
        f"{fabric.shear_n_per_m:g}",
        f"{1e6 * fabric.bending_warp_n_m:.3g} / {1e6 * fabric.bending_weft_n_m:.3g}",
        " / ".join(f"{length:.1f}" for length in lengths),
        f"{fabric.damping_kg_s:g}",
        f"{fabric.skin_friction:g} / {fabric.self_friction:g}",
        f"{1000 * fabric.thickness_m:g}",
        fabric.cloth3d,
        ", ".join(others),
    ]


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def measure() -> list[str]:
    """Hang every fabric, write the sheet, and return the table of what was measured."""
    from drape import PLATE_M, bending_length_m, drape_coefficient, hang_disc
    from PIL import Image

    from drapeline.blender.solver import cloth_solver as blender
    from drapeline.rendering.pictures import GridCell, save_grid
    from drapeline.report.colours import FABRIC_COLOURS
    from drapeline.xpbd.solver import cloth_solver as xpbd

    solvers = [xpbd(1), blender(1)]
    head = ["fabric", "real cloth, %"]
    head += [f"`{s.name}`, {mesh}, %" for s in solvers for mesh, *_ in MESHES]
    head += ["bending length, cm", *(f"`{s.name}`, 1 cm" for s in solvers)]
    lines = [_row(head), _row(["---"] * len(head))]
    sheet = []
    for name in MEASURED_FABRICS:
        fabric = FABRICS[name]
        low, high = PUBLISHED.get(name, (None, None))
        cells = [f"`{name}`", f"{low}-{high}" if low else ""]
        shade = bytes.fromhex(FABRIC_COLOURS[name].removeprefix("#"))
        colour = tuple(0.35 + 0.65 * part / 255 for part in shade)
        pictures = []
        for solver in solvers:
            for mesh, edge_m, triangles in MESHES:
                disc = hang_disc(solver, fabric, edge_m, triangles=triangles)
                percent = drape_coefficient(disc)
                cells.append(f"{percent:.0f}")
                if mesh == "1 cm":
                    pictures += [
                        GridCell(_picture(disc, colour, PLATE_M, above=above), caption)
                        for above, caption in ((True, f"{percent:.0f} %"), (False, ""))
                    ]
        expected_m = (fabric.bending_warp_n_m / fabric.density_kg_m2 / 9.81) ** (1 / 3)
        lengths = [bending_length_m(s, fabric, 0.01, triangles=False) for s in solvers]
        cells += [f"{100 * length:.1f}" for length in (expected_m, *lengths)]
        lines.append(_row(cells))
        sheet.append(pictures)
    titles = [f"{s.name},\n{view}" for s in solvers for view in ("from above", "from the side")]
    scratch = SHEET.with_suffix(".png")
    labels = [name.replace("_", "\n") for name in MEASURED_FABRICS]
    save_grid(scratch, sheet, columns=titles, labels=labels)
    Image.open(scratch).convert("RGB").save(SHEET, quality=88)
    scratch.unlink()
    return lines


def _picture(
    disc: "Sheet", colour: tuple[float, ...], plate_m: float, *, above: bool
) -> np.ndarray:
    """The disc on its stand, from above or from the side."""
    from drapeline.rendering.camera import look_at, view_direction
    from drapeline.rendering.raytracer import ColouredMesh, raytrace

    top = float(disc.flat[:, 2].max())
    middle = np.array([0, 0, top - (0.0 if above else 0.035)])
    away = np.array([0, -0.02, 1.0])
    if not above:
        away = view_direction((0.0, -1.0), turn_deg=20, rise=0.3)
    place = middle + 2.0 * away / np.linalg.norm(away)
    camera = look_at(place, middle, focal_px=1150, size=(190, 170))
    angle = np.linspace(0, 2 * np.pi, 49)[:-1]
    ring = plate_m * 0.97 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    heights = np.repeat([top - 0.004, top - 0.09], len(ring))
    stand = np.column_stack([np.tile(ring, (2, 1)), heights])
    number = np.arange(len(ring))
    after = np.roll(number, -1)
    sides = np.stack([number, after, after + len(ring), number + len(ring)], axis=1)
    meshes = [ColouredMesh(disc.hung, disc.faces, colour)]
    if not above:
        meshes.append(ColouredMesh(stand.astype(np.float32), sides, (0.8, 0.8, 0.8)))
    return raytrace(meshes, camera, floor_reach_m=0.01, samples=32)


if __name__ == "__main__":
    page = replace_block(PAGE.read_text(), "values", value_rows())
    if "--measure" in sys.argv:
        page = replace_block(page, "drape", measure())
    PAGE.write_text(page)
