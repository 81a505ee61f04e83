"""Fabrics as physical values, and what Blender's cloth must be told to give them on a mesh."""

from dataclasses import dataclass

# Blender's springs and masses belong to vertices, so that a preset means another fabric on every
# mesh. The presets are read as values on quads of this length, where they give sensible clothes:
# cotton of 0.3 kg/m2 with a bending stiffness of about 1e-5 N m, denim 1e-4, silk 1e-6.
PRESET_EDGE_M = 0.01
# Blender's own damping of bending, in all presets.
_BENDING_DAMPING = 0.5


@dataclass(frozen=True)
class Fabric:
    """One of Blender's cloth presets, read at edges of `PRESET_EDGE_M`.

    Attributes:
        density_kg_m2: mass per area.
        stretch: tension, compression and shear stiffness, in Blender's units.
        bending: bending stiffness, in Blender's units.
        damping: damping of tension, compression and shear, in Blender's units.
        air: drag of still air, in Blender's units.
    """

    density_kg_m2: float
    stretch: float
    bending: float
    damping: float
    air: float = 1.0


FABRICS = {
    "cotton": Fabric(density_kg_m2=0.3, stretch=15, bending=0.5, damping=5),
    "silk": Fabric(density_kg_m2=0.15, stretch=5, bending=0.05, damping=0),
    "denim": Fabric(density_kg_m2=1.0, stretch=40, bending=10, damping=25),
    "leather": Fabric(density_kg_m2=0.4, stretch=80, bending=150, damping=25),
}


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
    """Settings under which cloth of any resolution moves as the preset does at its own.

    With edges of length L, Blender's spring constant is tension / L, its hinge stiffness is
    proportional to bending * L, and mass, damping and drag are per vertex or per spring. Area
    density, membrane stiffness, bending stiffness and drag per area stay what they are when mass
    and drag grow with L^2, tension with L, and both bending terms with 1 / L.

    Args:
        edge_length_m: mean edge length of the mesh.
    """
    ratio = edge_length_m / PRESET_EDGE_M
    stretch = fabric.stretch * ratio
    return ClothParameters(
        mass=fabric.density_kg_m2 * ratio**2,
        tension_stiffness=stretch,
        compression_stiffness=stretch,
        shear_stiffness=stretch,
        bending_stiffness=fabric.bending / ratio,
        tension_damping=fabric.damping,
        compression_damping=fabric.damping,
        shear_damping=fabric.damping,
        bending_damping=_BENDING_DAMPING / ratio,
        air_damping=fabric.air * ratio**2,
    )
