"""drapeline: from motion capture to simulated, CLOTH3D-format clothed humans.

What programs import, beside `drapeline.torch`; docs/reference/api.md describes it. All that lies
deeper serves the pipeline and may move. Each name is imported when it is first asked for.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# Extra of the installation that brings what a name needs, or "" -> name -> its module. For type
# checkers they stand in `__init__.pyi` as well.
_HOMES = {
    "": {
        "BodyModel": "bodies.model",
        "Cloth3D": "dataset.reader",
        "InputError": "errors",
        "JOINT_NAMES": "frames",
        "Mesh": "geometry.mesh",
        "Motion": "motions.motion",
        "Sample": "dataset.reader",
        "load_body": "bodies.model",
        "load_obj": "geometry.obj",
        "open_dataset": "dataset.reader",
        "posed_vertices": "bodies.model",
        "save_motion": "motions.motion",
        "save_obj": "geometry.obj",
    },
    "dress": {
        "SimulatedOutfit": "generation.moving_outfits",
        "SimulatedSheet": "generation.moving_sheets",
        "floor_report": "motions.floor",
        "import_motion": "motions.importing",
        "measure": "metrics.measure",
        "save_outfit": "commands.outputs",
        "simulate": "generation.moving_outfits",
    },
    "torch": {
        "ReconstructionModel": "models.garment4d.reconstruct",
        "SmplicitModel": "models.smplicit.model",
        "StaticModel": "models.gcvae.static_model",
        "draw": "report.models.scene",
        "fit_image": "models.smplicit.pictures.drape",
        "fit_points": "models.smplicit.scans.garments",
        "load": "models.load",
        "repose": "models.smplicit.gallery.motion",
    },
}

__all__ = sorted(name for homes in _HOMES.values() for name in homes)


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for.

    Raises:
        ModuleNotFoundError: what it needs is not installed; names the extra that brings it.
    """
    for extra, homes in _HOMES.items():
        if name in homes:
            try:
                value = getattr(import_module(f"{__name__}.{homes[name]}"), name)
            except ModuleNotFoundError as error:
                if not extra:
                    raise
                raise ModuleNotFoundError(
                    f"drapeline.{name} needs {error.name}, which is not installed; expected"
                    f" drapeline with the extra [{extra}]: pip install 'drapeline[{extra}]'",
                    name=error.name,
                ) from error
            globals()[name] = value
            return value
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
