"""What takes minutes to make, made once: the real bodies, the tiny experiment."""

import hashlib
import os
from pathlib import Path

from filelock import FileLock

from drapeline.bodies.model import save_body
from drapeline.experiment.source_digest import Sources
from drapeline.frames import GENDERS

ROOT = Path(__file__).parents[2]
BODIES = [f"{gender}.npz" for gender in GENDERS]


def made_tiny() -> Path | None:
    """The folder in which `make run CONFIG=tests/data/tiny.yaml` was run, if the user names one."""
    folder = os.environ.get("DRAPELINE_TINY")
    return Path(folder).resolve() if folder else None


def baked_bodies() -> Path:
    """Folder of the bodies of rule `bake_body`; baked on first use and kept for later runs."""
    made = made_tiny()
    if made is not None:
        return made / "resources" / "body"
    rule = (ROOT / "workflow/rules/bodies.smk").read_text()
    code = Sources(ROOT / "src").digest(ROOT / "scripts" / "bake_body.py")
    key = hashlib.sha256((code + rule).encode()).hexdigest()[:12]
    folder = Path.home() / ".cache" / "drapeline" / key
    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / "baking.lock"):  # one worker bakes, the others wait
        if not all((folder / name).is_file() for name in BODIES):
            from drapeline.bodies.bake import bake_bodies

            for gender, body in bake_bodies(seed=0, samples=600).items():
                save_body(folder / f"{gender}.npz", body)
    return folder
