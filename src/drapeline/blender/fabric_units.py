"""Settings of Blender's cloth for a mesh to move as a fabric of given physical values."""

from dataclasses import dataclass

from drapeline.outfits.fabrics import Fabric

# Blender's springs and masses belong to vertices and springs, so that one preset is another fabric
# on every mesh. Settings are worked out for edges of this length, and scaled from there.
UNIT_EDGE_M = 0.01
# Physical values of one unit of Blender's settings at that length. Blender's mass of a vertex is
# the density in kg/m2, which stands for 1e-4 kg there, and its unit of time is the frame of 1/30 s:
# a unit of force is 0.09 N. Its spring constant is tension over edge length; its hinges turn by
# a tenth of bending times edge length, half of it on the far corners of each quad; its drag is a
# hundredth of the setting. `tests/unit/blender/test_fabric_units.py` measures them.
_STRETCH_N_PER_M = 9.0
_BENDING_N_M = 4.5e-7
_DAMPING_KG_S = 3e-3
_DRAG_KG_M2_S = 0.3
# Blender's own damping of bending, in all presets.
_BENDING_DAMPING = 0.5


@dataclass(frozen=True)
class ClothParameters:
    """Blender's cloth settings of one fabric on one mesh; the names are Blender's."""

    mass: float
    tension_stiffness: float
    compression_stiffness: float
    shear_stiffness: float
    bending_stiffness: float
    tension_damping: float
    compression_damping: float
    shear_damping: float
    bending_damping: float
    air_damping: float


def cloth_parameters(fabric: Fabric, edge_length_m: float) -> ClothParameters:
    """Settings under which a mesh moves as the fabric does.

    Blender knows no warp and weft: threads and bending are the geometric means of both. Threads
    resist as much when they are pushed: Blender's would shorten by a sixth otherwise.

    With edges of length L, mass and drag per vertex grow with L^2, tension with L, and the bending
    terms with 1 / L^2, for the arm of a hinge's force is L as well as its angle; damping is per
    spring. Mass, stretch, bending, damping and drag are then the fabric's at every resolution.
    """
    ratio = edge_length_m / UNIT_EDGE_M
    shear = 2 * fabric.shear_n_per_m / _STRETCH_N_PER_M * ratio
    stretch = (fabric.stretch_n_per_m - fabric.shear_n_per_m) / _STRETCH_N_PER_M * ratio
    damping = fabric.damping_kg_s / _DAMPING_KG_S
    return ClothParameters(
        mass=fabric.density_kg_m2 * ratio**2,
        tension_stiffness=stretch,
        compression_stiffness=stretch,
        shear_stiffness=shear,
        bending_stiffness=fabric.bending_n_m / _BENDING_N_M / ratio**2,
        tension_damping=damping,
        compression_damping=damping,
        shear_damping=damping,
        bending_damping=_BENDING_DAMPING / ratio**2,
        air_damping=fabric.drag_kg_m2_s / _DRAG_KG_M2_S * ratio**2,
    )
