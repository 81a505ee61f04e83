"""The table of fabrics: physical values, and which garments may be made of them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Fabric:
    """A fabric, whatever the mesh and the solver that it is simulated with."""

    density_kg_m2: float  # mass per area
    # Tension per width and strain along the threads; also of threads laid along the diagonals, so
    # that cloth resists shear.
    stretch_n_per_m: float
    bending_n_m: float  # bending moment per width and curvature
    damping_kg_s: float  # tension per width and rate of strain, N/m over 1/s
    drag_kg_m2_s: float = 0.3  # force of still air per area and speed, N/m2 over m/s
    # Whether t-shirts and tops may be made of it; all other garments may.
    upper_garments: bool = True


# Blender's presets of these names, as its cloth realises them on quads of 1 cm. Garments draw
# from the names in this order: a fabric that is added, or moved, changes the outfits of a seed.
FABRICS = {
    "cotton": Fabric(
        density_kg_m2=0.3, stretch_n_per_m=135, bending_n_m=2.25e-7, damping_kg_s=0.015
    ),
    "silk": Fabric(density_kg_m2=0.15, stretch_n_per_m=45, bending_n_m=2.25e-8, damping_kg_s=0.0),
    "denim": Fabric(
        density_kg_m2=1.0,
        stretch_n_per_m=360,
        bending_n_m=4.5e-6,
        damping_kg_s=0.075,
        upper_garments=False,
    ),
    "leather": Fabric(
        density_kg_m2=0.4,
        stretch_n_per_m=720,
        bending_n_m=6.75e-5,
        damping_kg_s=0.075,
        upper_garments=False,
    ),
}


def fabric_names(*, upper: bool) -> tuple[str, ...]:
    """Fabrics of a t-shirt or top, or of other garments (CLOTH3D 3.2), in the table's order."""
    return tuple(name for name, fabric in FABRICS.items() if fabric.upper_garments or not upper)
