"""The import directions and bans of docs/background/architecture.md, checked on the source."""

import ast
import re
from itertools import pairwise
from pathlib import Path

import pytest

from drapeline.experiment.cloth_solvers import CLOTH_SOLVERS
from toys.imported_modules import imported_modules

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "drapeline"
CORE = {
    *("errors", "seeding", "npy", "storage", "schema", "manifest", "rule_log", "frames"),
    *("settings", "job"),
}
# Each part may import itself and what stands to its right.
MAY_IMPORT = {
    part: CORE | {part, *others}
    for part, others in {
        **{name: [] for name in (*CORE, "preflight", "__main__")},
        "geometry": [],
        "bodies": ["geometry"],
        "motions": ["bodies"],
        "outfits": ["bodies", "geometry"],
        "simulation": ["outfits", "bodies", "geometry"],
        "dataset": ["outfits", "motions", "bodies", "geometry"],
        "experiment": ["dataset", "outfits", "motions", "bodies"],
        "generation": [
            *["experiment", "dataset", "simulation", "outfits", "motions", "bodies", "geometry"],
        ],
        "registration": ["dataset", "outfits", "bodies", "geometry"],
        "learning_data": ["registration", "dataset", "outfits", "bodies", "geometry"],
        "metrics": ["learning_data", "registration", "dataset", "outfits", "bodies", "geometry"],
        "models": [
            *["report", "metrics", "learning_data", "registration", "generation", "experiment"],
            *["simulation", "dataset", "outfits", "motions", "bodies", "rendering", "geometry"],
        ],
        "torch": ["dataset"],
        "rendering": ["geometry"],
        "report": [
            *["rendering", "metrics", "learning_data", "registration", "dataset", "outfits"],
            *["motions", "bodies", "geometry"],
        ],
        "blender": [
            *["simulation", "rendering", "dataset", "outfits", "motions", "bodies", "geometry"],
        ],
        "commands": [
            *["models", "report", "blender", "generation", "experiment", "dataset", "simulation"],
            *["outfits", "motions", "bodies", "geometry"],
        ],
    }.items()
}
# Each cloth solver has a room of its own, which simulation knows nothing of.
SOLVER_ROOMS = {solver.code.split(".")[1] for solver in CLOTH_SOLVERS.values()}
for room in SOLVER_ROOMS - set(MAY_IMPORT):
    MAY_IMPORT[room] = {room, "simulation"} | MAY_IMPORT["simulation"]
MODULES = sorted(SOURCE.rglob("*.py"))


def part_of(path):
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


PARTS = sorted({part_of(path) for path in MODULES} - {"__init__"})


@pytest.mark.parametrize("part", PARTS)
def test_imports_go_one_way(part):
    for path in MODULES:
        if part_of(path) != part:
            continue
        for name in imported_modules(path.read_text()):
            names = name.split(".")
            if names[0] == "drapeline" and len(names) > 1:
                # The whole config is put together from settings, which know nothing but tables.
                of_settings = part == "experiment" and names[-1] == "settings"
                assert names[1] in MAY_IMPORT[part] or of_settings, f"{path.name} imports {name}"
            if names[0] in {"bpy", "bmesh", "mathutils", "pxr"}:
                assert part == "blender", f"{path.name} imports {name} outside blender/"
            # These take seconds to import, which is why hardly any job does.
            if names[0] == "torch":
                assert part in {"models", "torch"}, f"{path.name} imports torch"
            if names[0] in {"pytorch_lightning", "lightning"}:
                assert path.name == "lightning.py", f"{path.name} imports Lightning"
            if names[0] == "pandas":
                allowed = part in {"schema", "report"} or path.parent.name == "metrics"
                assert allowed, f"{path.name} imports pandas, and not a table by its schema"
            assert names[0] != "snakemake", f"{path.name} knows Snakemake"


TABLES = {
    "experiment.cloth_solvers",
    "outfits.fabrics",
    "outfits.garment_types",
    "smplicit.garments",
}


@pytest.mark.parametrize(
    "path", sorted(SOURCE.glob("*/**/settings.py")), ids=lambda p: p.parent.name
)
def test_settings_import_settings_and_tables_alone(path):
    for name in imported_modules(path.read_text()):
        if name.startswith("drapeline."):
            place = ".".join(name.split(".")[-2:])
            known = name.split(".")[1] in CORE or name.endswith("settings") or place in TABLES
            assert known, f"{path.relative_to(SOURCE)} imports {name}"


# Inside models/ as well: what they share knows no model, and no model knows another.
SHARED_BY_MODELS = {
    name: {name, *others}
    for name, others in {"training": [], "layers": ["training"], "pictures": []}.items()
}
SHARED_BY_MODELS["contract"] = {"contract"}
SHARED_BY_MODELS["registry"] = {"registry"}
SHARED_BY_MODELS["start"] = {"start"}
SHARED_BY_MODELS["compare"] = {"contract", "compare"}
SHARED_BY_MODELS["protocol"] = {"contract", "compare", "pictures", "protocol"}
SHARED_BY_MODELS["load"] = {"registry", "training", "start"}
SHARED_BY_MODELS["package"] = {"registry", "training", "start", "package"}


def test_models_share_layers_and_training_and_nothing_else():
    for path in MODULES:
        if part_of(path) != "models":
            continue
        part = path.relative_to(SOURCE / "models").parts[0].removesuffix(".py")
        allowed = SHARED_BY_MODELS.get(
            part, {part, *SHARED_BY_MODELS} - {"load", "package", "protocol"}
        )
        for name in imported_modules(path.read_text()):
            names = name.split(".")
            if names[:2] == ["drapeline", "models"]:
                assert names[2] in allowed, f"{path.relative_to(SOURCE)} imports {name}"


BANNED_CALLS = {
    "np.random.seed",
    "np.random.rand",
    "np.random.randn",
    "np.random.default_rng",
    "random.seed",
    "random.random",
    "uuid.uuid4",
    "np.empty",
    "np.empty_like",
    "pickle.load",
    "pickle.loads",
    "torch.manual_seed",
    "eval",
    "exec",
}


def test_no_global_randomness_no_unset_memory_no_executing_loaders():
    for path in MODULES:
        if path.name == "seeding.py":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
                called = ast.unparse(node.func)
                assert called not in BANNED_CALLS, f"{path.name}:{node.lineno} {called}"


def test_rule_scripts_stay_thin_and_never_import_each_other():
    for path in sorted((ROOT / "scripts").glob("*.py")):
        code = [line for line in path.read_text().splitlines() if line.strip()]
        assert len(code) <= 60, f"{path.name} has {len(code)} lines"
        for name in imported_modules(path.read_text()):
            assert name.split(".")[0] not in {p.stem for p in (ROOT / "scripts").glob("*.py")}


def _described_rooms():
    """Rooms in the table of docs/background/architecture.md, and the arrows of its diagram."""
    text = (ROOT / "docs/background/architecture.md").read_text()
    rooms = re.findall(r"^\| `(\w+)/` \|", text, re.MULTILINE)
    arrows = {}
    for line in re.findall(r"^[\w, ]+(?: -> [\w, ]+)+$", text, re.MULTILINE):
        groups = [group.split(", ") for group in line.split(" -> ")]
        for lefts, rights in pairwise(groups):
            for left in lefts:
                arrows.setdefault(left, set()).update(rights)
    return rooms, arrows


def _reachable(arrows, room):
    found = set()
    stack = [room]
    while stack:
        new = arrows.get(stack.pop(), set()) - found
        found |= new
        stack += new
    return found


def test_the_documented_rooms_are_the_folders():
    rooms, arrows = _described_rooms()
    folders = {path.name for path in SOURCE.iterdir() if (path / "__init__.py").is_file()}
    assert len(rooms) == len(set(rooms))
    assert folders - SOLVER_ROOMS <= set(rooms) <= folders
    assert set(arrows) <= folders
    assert set().union(*arrows.values()) <= folders


@pytest.mark.parametrize("room", _described_rooms()[0])
def test_the_documented_arrows_show_every_import(room):
    _, arrows = _described_rooms()
    reachable = _reachable(arrows, room)
    assert room not in reachable
    assert MAY_IMPORT[room] - CORE - {room} <= reachable
