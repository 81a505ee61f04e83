"""Templates: what is made once per gender and shared by all outfits."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drapeline.bodies.model import BodyModel
from drapeline.geometry.mesh import Mesh
from drapeline.outfits.dress_form import DressForm, Field, Tube, build_dress_form
from drapeline.outfits.patterns.cutting import cut_garment
from drapeline.storage import load_npz, save_npz

_TUBES = ("torso", "arm", "leg", "skirt")
_FIELDS = ("upper", "lower")
_MESH = ("vertices", "faces", "uv", "uv_faces")
TEMPLATE_EDGE_M = 0.01
# The four templates before anything is cut: long sleeves, long legs, a skirt to the ankles.
_UPPER = {
    "hem": 1.0,
    "ease_m": 0.01,
    "flare": 0.02,
    "shaping": 0.12,
    "neckline": "crew",
    "neck_depth_m": 0.06,
    "neck_depth_back_m": 0.015,
    "front": "closed",
}
_SLEEVES = {
    "neck_width_m": 0.08,
    "drop_m": 0.025,
    "sleeve_length": 1.0,
    "sleeve_alpha1": -0.1,
    "sleeve_alpha2": 0.0,
    "sleeve_offset": 1.0,
    "sleeve_w0": 1.5,
}
_STRAPS = {"neck_width_m": 0.085, "strap_m": 0.05, "drop_m": 0.005, "scye_m": 0.01}
_LEGS = {
    "waist": 1.0,
    "leg_length": 1.0,
    "leg_alpha1": -0.1,
    "leg_alpha2": 0.0,
    "leg_offset": 1.0,
    "leg_w0": 1.2,
    "rise_m": 0.02,
    "hip_ease_m": 0.005,
}
_SKIRT = {
    "waist": 1.0,
    "skirt_length": 1.0,
    "skirt_alpha1": 0.3,
    "skirt_flutes": 6.0,
    "skirt_fullness": 0.0,
    "skirt_phase": 0.0,
    **{f"skirt_wander{k}": 0.0 for k in range(4)},
}
TEMPLATE_NUMBERS: dict[str, dict[str, dict[str, Any]]] = {
    "Tshirt": {"upper": _UPPER | _SLEEVES},
    "Top": {"upper": _UPPER | _STRAPS},
    "Trousers": {"trousers": _LEGS},
    "Skirt": {"skirt": _SKIRT},
}


@dataclass(frozen=True)
class Templates:
    """One gender's dress form, the uncut garments on it, and which body they were made for."""

    form: DressForm  # the dress form that garments are cut on
    # "Tshirt", "Top", "Trousers" and "Skirt" in full length, at 1 cm edges.
    garments: dict[str, Mesh]
    body_name: str  # name of the body model

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        arrays: dict[str, Any] = {"body_name": self.body_name}
        for name in _TUBES:
            tube = getattr(self.form, name)
            arrays |= {
                f"{name}/start_m": tube.start_m,
                f"{name}/centre": tube.centre,
                f"{name}/radius": tube.radius,
            }
        for name in _FIELDS:
            part = getattr(self.form, name)
            arrays |= {f"{name}/origin": part.origin, f"{name}/distance": part.distance}
        arrays |= {f"landmarks/{k}": v for k, v in self.form.landmarks.items()}
        for name, mesh in self.garments.items():
            arrays |= {f"garments/{name}/{key}": getattr(mesh, key) for key in _MESH}
        save_npz(path, **arrays)


def build_templates(body: BodyModel) -> Templates:
    """Make one gender's templates; takes a few seconds."""
    form = build_dress_form(body)
    return Templates(
        form, {name: _mesh(form, parts) for name, parts in TEMPLATE_NUMBERS.items()}, body.name
    )


def _mesh(form: DressForm, parts: dict[str, dict[str, Any]]) -> Mesh:
    pattern = cut_garment(form, TEMPLATE_EDGE_M, **parts)
    return Mesh(pattern.vertices.astype("float32"), pattern.faces(), *pattern.texture())


def load_templates(path: str | Path) -> Templates:
    """Read what `Templates.save` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    forms = {"body_name": "str", "landmarks/*": "number"}
    for name in _TUBES:
        forms |= {f"{name}/start_m": "number", f"{name}/centre": f"float {name} 2"}
        forms |= {f"{name}/radius": f"float {name} *"}
    for name in _FIELDS:
        forms |= {f"{name}/origin": "float 3", f"{name}/distance": "float * * *"}
    for name in TEMPLATE_NUMBERS:
        mesh = (f"float v{name} 3", f"int<v{name} * 4", f"float t{name} 2", f"int<t{name} * 4")
        forms |= {f"garments/{name}/{k}": form for k, form in zip(_MESH, mesh, strict=True)}
    a = load_npz(path, forms)
    parts: dict[str, Any] = {
        n: Tube(float(a[f"{n}/start_m"]), a[f"{n}/centre"], a[f"{n}/radius"]) for n in _TUBES
    }
    parts |= {n: Field(a[f"{n}/origin"], a[f"{n}/distance"]) for n in _FIELDS}
    marks = {k.split("/")[1]: float(v) for k, v in a.items() if k.startswith("landmarks/")}
    garments = {n: Mesh(*(a[f"garments/{n}/{k}"] for k in _MESH)) for n in TEMPLATE_NUMBERS}
    return Templates(DressForm(**parts, landmarks=marks), garments, str(a["body_name"]))
