"""Templates: what is made once per gender and shared by all outfits."""

from dataclasses import dataclass
from pathlib import Path

from drapeline.bodies.model import BodyModel
from drapeline.outfits.forms import Field, Form, Tube, build_form
from drapeline.storage import load_npz, save_npz

_TUBES = ("torso", "arm", "leg", "skirt")
_FIELDS = ("upper", "lower")


@dataclass(frozen=True)
class Templates:
    """One gender's dress form and which body it was taken from.

    Attributes:
        form: the dress form that garments are cut on.
        body_name: name of the body model.
    """

    form: Form
    body_name: str

    def save(self, path: str | Path) -> None:
        """Write one `.npz`."""
        arrays = {"body_name": self.body_name}
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
        save_npz(path, **arrays)


def build_templates(body: BodyModel) -> Templates:
    """Make one gender's templates (a few seconds)."""
    return Templates(build_form(body), body.name)


def load_templates(path: str | Path) -> Templates:
    """Read what `Templates.save` wrote.

    Raises:
        InputError: the file is missing or is not one of templates.
    """
    required = [f"{n}/{k}" for n in _TUBES for k in ("start_m", "centre", "radius")]
    required += [f"{n}/{k}" for n in _FIELDS for k in ("origin", "distance")]
    a = load_npz(path, "body_name", *required)
    tubes = {n: Tube(float(a[f"{n}/start_m"]), a[f"{n}/centre"], a[f"{n}/radius"]) for n in _TUBES}
    fields = {n: Field(a[f"{n}/origin"], a[f"{n}/distance"]) for n in _FIELDS}
    marks = {k.split("/")[1]: float(v) for k, v in a.items() if k.startswith("landmarks/")}
    return Templates(Form(**tubes, **fields, landmarks=marks), str(a["body_name"]))
