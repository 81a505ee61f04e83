"""The table of fabrics: measured values, and which garments may be made of them."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from drapeline.outfits.garment_types import GARMENTS

# The words of CLOTH3D's `info.mat` for fabrics; readers know no others.
CLOTH3D_FABRICS = ("cotton", "silk", "denim", "leather")


@dataclass(frozen=True)
class Fabric:
    """A fabric, whatever the mesh and the solver that it is simulated with.

    Warp runs along a garment or limb, weft around it. Of knits warp is along the wales. All values
    are per width or area of cloth, so that no thickness enters into them.

    Attributes:
        density_kg_m2: mass per area (ISO 3801, ASTM D3776: a cut of known area is weighed).
        stretch_warp_n_per_m, stretch_weft_n_per_m: tension per width and strain along the threads,
            at the loads of wear (KES-FB1 up to 490 N/m; FAST-3: 98.1 N/m over the extension E100).
        shear_n_per_m: force per width and radian by which the angle between the threads changes
            (KES-FB1: G in gf/(cm degree) times 56.2; FAST-3: 123 over the extension EB5 in per
            cent, of a strip cut on the bias).
        bending_warp_n_m, bending_weft_n_m: moment per width and curvature of cloth that is bent
            along the threads (KES-FB2: B in gf cm2/cm times 9.81e-5; FAST-2 and ASTM D1388: density
            times gravity times the cube of the bending length, half the length of a strip whose
            end has sunk by 41.5 degrees).
        compression_n_per_m: push per width and strain along the threads. No textile test has it:
            threads buckle under next to no load, between the vertices of a mesh, and what stands
            for it here is as much as keeps the mesh in order.
        damping_kg_s: tension per width and rate of strain, N/m over 1/s. No textile test has it:
            cloth loses energy by friction between its threads (KES 2HG, 2HB), which is seen as how
            fast it comes to rest.
        skin_friction, self_friction: coefficients of sliding friction on skin and on the fabric
            itself (ISO 8295, ASTM D1894: a sled with the fabric is drawn over it).
        thickness_m: at a pressure of .5 gf/cm2 (KES-FB3, 49 Pa) or 2 gf/cm2 (FAST-1). It is told
            with each sample; solvers keep layers further apart than that.
        cloth3d: the one of `CLOTH3D_FABRICS` that `info.mat` names in its place.
        drag_kg_m2_s: force of still air per area and speed, N/m2 over m/s.
        garments: types that may be made of it.
    """

    density_kg_m2: float
    stretch_warp_n_per_m: float
    stretch_weft_n_per_m: float
    shear_n_per_m: float
    bending_warp_n_m: float
    bending_weft_n_m: float
    damping_kg_s: float
    skin_friction: float
    self_friction: float
    thickness_m: float
    cloth3d: str
    compression_n_per_m: float = 80.0
    drag_kg_m2_s: float = 0.3
    garments: tuple[str, ...] = GARMENTS

    @property
    def stretch_n_per_m(self) -> float:
        """The geometric mean of both threads' stiffness."""
        return math.sqrt(self.stretch_warp_n_per_m * self.stretch_weft_n_per_m)

    @property
    def bending_n_m(self) -> float:
        """The geometric mean of both threads' bending stiffness."""
        return math.sqrt(self.bending_warp_n_m * self.bending_weft_n_m)


# CLOTH3D makes no t-shirts and tops of denim and leather (3.2).
_NO_SHIRTS = tuple(name for name in GARMENTS if name not in ("Tshirt", "Top"))

# Where values come from is in docs/background/fabrics.md. Garments draw from the names in the order
# of `outfits.fabrics`.
_MEASURED = {
    # Poplin: plain weave of fine yarns, for shirts and summer dresses.
    "cotton": Fabric(
        density_kg_m2=0.12,
        stretch_warp_n_per_m=5000,
        stretch_weft_n_per_m=2500,
        shear_n_per_m=70,
        bending_warp_n_m=1.5e-5,
        bending_weft_n_m=1.0e-5,
        damping_kg_s=0.05,
        skin_friction=0.4,
        self_friction=0.4,
        thickness_m=0.3e-3,
        cloth3d="cotton",
    ),
    "linen": Fabric(
        density_kg_m2=0.18,
        stretch_warp_n_per_m=6000,
        stretch_weft_n_per_m=4000,
        shear_n_per_m=60,
        bending_warp_n_m=2.4e-5,
        bending_weft_n_m=1.8e-5,
        damping_kg_s=0.05,
        skin_friction=0.4,
        self_friction=0.4,
        thickness_m=0.45e-3,
        cloth3d="cotton",
    ),
    # Twill of 12 ounces per square yard.
    "denim": Fabric(
        density_kg_m2=0.4,
        stretch_warp_n_per_m=8000,
        stretch_weft_n_per_m=4000,
        shear_n_per_m=150,
        bending_warp_n_m=1.3e-4,
        bending_weft_n_m=6.0e-5,
        damping_kg_s=0.1,
        skin_friction=0.45,
        self_friction=0.5,
        thickness_m=0.9e-3,
        cloth3d="denim",
        garments=_NO_SHIRTS,
    ),
    # Habotai of 10 momme: plain weave of filament yarns.
    "silk": Fabric(
        density_kg_m2=0.045,
        stretch_warp_n_per_m=4000,
        stretch_weft_n_per_m=2500,
        shear_n_per_m=25,
        bending_warp_n_m=6.0e-7,
        bending_weft_n_m=5.0e-7,
        damping_kg_s=0.02,
        skin_friction=0.3,
        self_friction=0.25,
        thickness_m=0.12e-3,
        cloth3d="silk",
    ),
    # Charmeuse of 19 momme.
    "satin": Fabric(
        density_kg_m2=0.085,
        stretch_warp_n_per_m=4000,
        stretch_weft_n_per_m=2000,
        shear_n_per_m=25,
        bending_warp_n_m=2.0e-6,
        bending_weft_n_m=1.2e-6,
        damping_kg_s=0.03,
        skin_friction=0.25,
        self_friction=0.2,
        thickness_m=0.2e-3,
        cloth3d="silk",
    ),
    "wool_suiting": Fabric(
        density_kg_m2=0.2,
        stretch_warp_n_per_m=3000,
        stretch_weft_n_per_m=2000,
        shear_n_per_m=45,
        bending_warp_n_m=1.1e-5,
        bending_weft_n_m=8.0e-6,
        damping_kg_s=0.05,
        skin_friction=0.45,
        self_friction=0.45,
        thickness_m=0.5e-3,
        cloth3d="cotton",
        garments=_NO_SHIRTS,
    ),
    # Single jersey of cotton.
    "jersey": Fabric(
        density_kg_m2=0.16,
        stretch_warp_n_per_m=600,
        stretch_weft_n_per_m=250,
        shear_n_per_m=40,
        bending_warp_n_m=2.5e-6,
        bending_weft_n_m=1.8e-6,
        damping_kg_s=0.05,
        skin_friction=0.4,
        self_friction=0.4,
        thickness_m=0.6e-3,
        cloth3d="cotton",
        compression_n_per_m=40,
    ),
    # Polyester, raised on both sides.
    "fleece": Fabric(
        density_kg_m2=0.25,
        stretch_warp_n_per_m=800,
        stretch_weft_n_per_m=350,
        shear_n_per_m=80,
        bending_warp_n_m=2.5e-5,
        bending_weft_n_m=1.6e-5,
        damping_kg_s=0.1,
        skin_friction=0.5,
        self_friction=0.6,
        thickness_m=2.5e-3,
        cloth3d="cotton",
        compression_n_per_m=40,
    ),
    # Sheep nappa for garments, .8 mm.
    "leather": Fabric(
        density_kg_m2=0.45,
        stretch_warp_n_per_m=3000,
        stretch_weft_n_per_m=3000,
        shear_n_per_m=1000,
        bending_warp_n_m=3.0e-5,
        bending_weft_n_m=3.0e-5,
        damping_kg_s=0.2,
        skin_friction=0.5,
        self_friction=0.5,
        thickness_m=0.8e-3,
        cloth3d="leather",
        garments=_NO_SHIRTS,
    ),
    # Coated taffeta, as of raincoats.
    "nylon_shell": Fabric(
        density_kg_m2=0.075,
        stretch_warp_n_per_m=8000,
        stretch_weft_n_per_m=5000,
        shear_n_per_m=200,
        bending_warp_n_m=8.0e-6,
        bending_weft_n_m=6.0e-6,
        damping_kg_s=0.03,
        skin_friction=0.3,
        self_friction=0.25,
        thickness_m=0.12e-3,
        cloth3d="silk",
    ),
}
MEASURED_FABRICS = tuple(_MEASURED)


def _blender_preset(
    cloth3d: str,
    density_kg_m2: float,
    threads_n_per_m: float,
    bending_n_m: float,
    damping_kg_s: float,
    garments: tuple[str, ...] = GARMENTS,
) -> Fabric:
    """What Blender's preset of a name is as a fabric, on quads of 1 cm.

    It has the same springs along edges and diagonals, those along the diagonals half as stiff.
    """
    return Fabric(
        density_kg_m2=density_kg_m2,
        stretch_warp_n_per_m=1.5 * threads_n_per_m,
        stretch_weft_n_per_m=1.5 * threads_n_per_m,
        shear_n_per_m=0.5 * threads_n_per_m,
        bending_warp_n_m=bending_n_m,
        bending_weft_n_m=bending_n_m,
        damping_kg_s=damping_kg_s,
        skin_friction=0.4,
        self_friction=0.3,
        thickness_m=0.5e-3,
        cloth3d=cloth3d,
        compression_n_per_m=1.5 * threads_n_per_m,
        garments=garments,
    )


# CLOTH3D was made with these presets; no cloth of their names is so heavy, and so limp.
FABRICS = {
    **_MEASURED,
    "blender_cotton": _blender_preset("cotton", 0.3, 135, 2.25e-7, 0.015),
    "blender_silk": _blender_preset("silk", 0.15, 45, 2.25e-8, 0.0),
    "blender_denim": _blender_preset("denim", 1.0, 360, 4.5e-6, 0.075, _NO_SHIRTS),
    "blender_leather": _blender_preset("leather", 0.4, 720, 6.75e-5, 0.075, _NO_SHIRTS),
}


def fabrics_of(garment: str, names: Iterable[str]) -> list[str]:
    """Those of some names that a type of garment may be made of."""
    return [name for name in names if garment in FABRICS[name].garments]


def cloth3d_name(fabric: str) -> str:
    """The one of `CLOTH3D_FABRICS` that stands for a fabric."""
    return FABRICS[fabric].cloth3d
