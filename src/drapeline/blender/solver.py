"""Where the rule `simulate_outfit` gets Blender's cloth."""

from drapeline.blender.threads import limit_visible_cores
from drapeline.simulation.solver import ClothSolver


def cloth_solver(threads: int, accelerator: str = "cpu") -> ClothSolver:
    """Blender's cloth, on so many cores and no GPU; nothing may have imported `bpy` before."""
    with limit_visible_cores(threads):
        from drapeline.blender.cloth import BlenderCloth
    return BlenderCloth()
