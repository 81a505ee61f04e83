"""What docs/how-to/extending.md promises: additions touch the places it lists, and nothing else."""

import json
import os
import re
import shutil
import subprocess
import sys
from importlib import import_module

import pytest
import yaml

from drapeline.blender.fabric_units import cloth_parameters
from drapeline.bodies.model import save_body
from drapeline.bodies.sequence import save_body_sequence
from drapeline.dataset.record import read_meta
from drapeline.experiment.groups import AT_REST
from drapeline.experiment.source_digest import Sources
from drapeline.frames import GENDERS
from drapeline.metrics.table import read_metrics, write_metrics
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.fabrics import FABRICS, Fabric
from drapeline.outfits.garment_types import GARMENTS, OUTFIT_TYPES
from drapeline.outfits.generate import sample_numbers
from drapeline.report.colours import FABRIC_COLOURS, GARMENT_COLOURS
from drapeline.seeding import rng_for
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import simulate_outfit
from toys.cloth import Follower, dress
from toys.cloth_solvers import cloth_solvers
from toys.imported_modules import imported_modules
from toys.metric_rows import metric_table
from toys.schema import SCHEMA
from toys.snakemake_run import PARTS, ROOT, copy_project, snakemake

CONFIG = "tests/data/tiny.yaml"

TOY_RULES = """
METRIC_TABLES["metrics"] += ["toy"]
METRIC_TABLES["representations"] += ["representations_toy"]
DEFAULT_TARGETS += [f"{RESULTS}/report/toy_metrics.html"]


rule train_toy:
    input:
        data=static_data("train", "val"),
    output:
        directory(f"{RESULTS}/toy/model"),
    log:
        f"{LOGS}/train_toy.log",
    params:
        size=lookup(dpath="toy/size", within=config),
        code=source_hash("train_toy"),
    script:
        "../../scripts/train_toy.py"


rule evaluate_toy:
    input:
        model=f"{RESULTS}/toy/model",
        data=static_data(*EVALUATED_SPLITS),
    output:
        f"{RESULTS}/metrics/toy.tsv",
    log:
        f"{LOGS}/evaluate_toy.log",
    params:
        code=source_hash("evaluate_toy"),
    script:
        "../../scripts/evaluate_toy.py"


rule compare_toy:
    input:
        data=static_data(*EVALUATED_SPLITS),
    output:
        f"{RESULTS}/metrics/representations_toy.tsv",
    log:
        f"{LOGS}/compare_toy.log",
    params:
        code=source_hash("compare_toy"),
    script:
        "../../scripts/compare_toy.py"


rule tabulate_toy:
    input:
        f"{RESULTS}/metrics.tsv",
    output:
        report(f"{RESULTS}/report/toy_metrics.html", caption="../report/toy.rst"),
    log:
        f"{LOGS}/tabulate_toy.log",
    params:
        code=source_hash("tabulate_toy"),
    script:
        "../../scripts/tabulate_toy.py"
"""
TOY_SETTINGS = """
from drapeline.settings import Field, Settings


class ToySettings(Settings):
    size: int = Field(3, ge=1, description="Numbers of the code.")
"""
TOY_MODEL = """
from drapeline.geometry.mesh import Mesh

MODEL = "toy"


class Flat:
    variant = "toy_flat"

    def code_numbers(self, garment):
        return 2

    def rebuild(self, garments):
        for garment in garments:
            yield Mesh(garment.mesh.vertices * [1, 1, 0], garment.mesh.faces)
"""
TOY_COMPARISON = """
import numpy as np

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.table import write_metrics
from drapeline.models.compare import compare_representations
from drapeline.models.contract import HeldOutGarment
from drapeline.models.toy.model import Flat

mesh = Mesh(np.float32([[0, 0, 0.01], [1, 0, 0.01], [0, 1, 0.01]]), np.int32([[0, 1, 2]]))
garments = [HeldOutGarment(0, "s00001", "Skirt", mesh)]
write_metrics(
    snakemake.output[0], compare_representations(garments, [Flat()], split="test", seed=0)
)
"""
TOY_EVALUATION = """
from drapeline.metrics.metric import Measured
from drapeline.metrics.table import summarise, write_metrics
from drapeline.models.toy.model import MODEL

measured = [Measured("s00001", "Skirt", {"surface_error_mm": 12.5})]
rows = summarise(measured, model=MODEL, variant=MODEL, split="test", seed=0)
write_metrics(snakemake.output[0], rows)
"""

TOY_SOLVER = """
from drapeline.simulation.solver import Attempt


class Toy:
    name = "toy"
    settings = {}

    def versions(self):
        return {}

    def simulate(self, garments, body, attempt: Attempt, scratch):
        for _ in range(len(body)):
            yield [garment.vertices for garment in garments]


def cloth_solver(threads, accelerator):
    return Toy()
"""


def append(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "a") as stream:
        stream.write(text)


def write_schema(project):
    """What `make docs` does to the schema."""
    script = project / "docs/make_settings.py"
    (script.parent / "reference").mkdir(parents=True, exist_ok=True)
    shutil.copy2(ROOT / "docs/make_settings.py", script)
    subprocess.run(
        [sys.executable, script],
        check=True,
        env={**os.environ, "PYTHONPATH": str(project / "src")},
    )


def add_toy_model(project):
    """A model in the places that a model may touch."""
    append(project / "src/drapeline/models/toy/__init__.py", "")
    append(project / "src/drapeline/models/toy/settings.py", TOY_SETTINGS)
    settings = project / "src/drapeline/experiment/settings.py"
    known = "from drapeline.models.smplicit.settings import SmplicitSettings\n"
    replace(settings, known, known + "from drapeline.models.toy.settings import ToySettings\n")
    known = '    "smplicit": SmplicitSettings,\n'
    replace(settings, known, known + '    "toy": ToySettings,\n')
    write_schema(project)
    append(project / "src/drapeline/models/toy/model.py", TOY_MODEL)
    append(project / "workflow/rules/toy.smk", TOY_RULES)
    append(project / "scripts/evaluate_toy.py", TOY_EVALUATION)
    append(project / "scripts/compare_toy.py", TOY_COMPARISON)
    append(project / "scripts/train_toy.py", "from drapeline.models.toy import model\n")
    append(project / "scripts/tabulate_toy.py", "from drapeline.report.models.toy import page\n")
    append(project / "src/drapeline/report/models/toy/__init__.py", "")
    append(project / "src/drapeline/report/models/toy/page.py", "TITLE = 'Toy'\n")
    append(project / "workflow/report/toy.rst", "A toy.\n")
    snakefile = project / "Snakefile"
    last = 'include: "workflow/rules/garment4d.smk"\n'
    text = snakefile.read_text()
    assert last in text
    snakefile.write_text(text.replace(last, last + 'include: "workflow/rules/toy.smk"\n'))


def replace(path, old, new):
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


def add_toy_solver(project):
    """A folder, a word among the settings and a line in the rule's table."""
    append(project / "src/drapeline/toy_cloth/__init__.py", "")
    append(project / "src/drapeline/toy_cloth/solver.py", TOY_SOLVER)
    replace(project / "src/drapeline/experiment/settings.py", '"xpbd"]', '"xpbd", "toy"]')
    write_schema(project)
    line = (
        '    "toy": Solver("drapeline.toy_cloth.solver", "../../envs/geometry.yaml", False, 50),\n'
    )
    table = "CLOTH_SOLVERS = {\n"
    replace(project / "workflow/rules/groups_common.smk", table, table + line)


TOY_TYPE = """
    "Overalls": GarmentType("whole"),
}
GARMENTS = tuple(GARMENT_TYPES)
"""
# What comes of the type, by code that has never heard of it.
TOY_TYPE_USE = """
import json
import sys

import numpy as np
import yaml

from drapeline.dataset.labels import LABELS
from drapeline.experiment.config import fill_settings
from drapeline.experiment.plan import Wardrobe, plan_at_rest
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.templates import build_templates
from drapeline.registration.to_body.topology import TOPOLOGIES, topology_codes
from drapeline.report.colours import garment_colour
from drapeline.seeding import rng_for
from toys.bodies import toy_body

with open("workflow/schemas/config.schema.yaml") as stream:
    schema = yaml.safe_load(stream)
wanted = {
    "outfits": {"types": ["Overalls"], "own_garments": {"Overalls": "mine.obj"}},
    "gcvae": {"sampling": {"garments": ["Overalls"]}},
}
types = fill_settings(wanted, schema, "toy.yaml")["outfits"]["types"]
(plan,) = plan_at_rest(1, "", {"val": 0.0, "test": 0.0}, Wardrobe(0.0, types, False))
body = toy_body()
outfit = sample_outfit(
    rng_for(1), build_templates(body), body,
    gender=plan.gender, shape=np.zeros(10), outfit_type=plan.outfit_type, edge_length_m=0.03,
)
(garment,) = outfit.garments
index = LABELS.index(garment.name) - 1
json.dump(
    {
        "parts": list(garment.attributes["parameters"]),
        "upper": list(garment.attributes["parameters"]["upper"]),
        "held": int(garment.pin.sum()),
        "index": index,
        "topology": TOPOLOGIES[topology_codes(np.array([index]))[0]],
        "removable": plan.removable,
        "colour": garment_colour(garment.name),
    },
    sys.stdout,
)
"""


def add_toy_garment_type(project):
    """A row in the table, an outfit, its words in the config, and a colour."""
    table = "}\nGARMENTS = tuple(GARMENT_TYPES)\n"
    types = project / "src/drapeline/outfits/garment_types.py"
    replace(types, table, TOY_TYPE.removeprefix("\n"))
    replace(types, '"Dress", "Jumpsuit")', '"Dress", "Jumpsuit", "Overalls")')
    write_schema(project)
    colours = project / "src/drapeline/report/colours.py"
    replace(colours, '    "Dress": SKY,\n', '    "Dress": SKY,\n    "Overalls": "#F0E442",\n')
    replace(project / "config.yaml", "\n  types: [", "\n  types: [Overalls, ")
    kinds = project / "src/drapeline/models/smplicit/garments.py"
    last = '        "dress with straps":'
    replace(kinds, last, '        "overalls": Kind("Overalls"),\n' + last)


def read_files(project):
    return {
        str(path.relative_to(project)): path.read_bytes()
        for part in PARTS
        for path in [project / part, *(project / part).rglob("*")]
        if path.is_file() and "__pycache__" not in path.parts
    }


def listed_places(title, **names):
    """Places in the first table of a section of the guide, with names for its placeholders."""
    guide = (ROOT / "docs/how-to/extending.md").read_text().partition(f"## {title}\n")[2]
    table = re.search(r"^\|.*?\n\n", guide, re.MULTILINE | re.DOTALL).group()
    places = [
        place
        for row in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
        for place in re.findall(r"`(.+?)`", row)
    ]
    for key, name in names.items():
        places = [place.replace(f"<{key}>", name) for place in places]
    assert places
    assert not [place for place in places if "<" in place]
    return places


def is_run(place):
    """Whether it is neither a test nor a page of the documentation."""
    return not place.startswith(("tests/", "docs/", "README"))


def touched_files(project, add):
    """Path -> content before and after an addition; None before if the file is new."""
    before = read_files(project)
    add(project)
    after = read_files(project)
    return {p: (before.get(p), after[p]) for p in after if before.get(p) != after[p]}


def in_place(path, place):
    return path.startswith(place) if place.endswith("/") else path == place


ADDITIONS = {
    "A new cloth solver": (add_toy_solver, {"room": "toy_cloth"}),
    "A new garment type": (add_toy_garment_type, {}),
    "A new model": (add_toy_model, {"model": "toy"}),
}


@pytest.mark.parametrize("title", ADDITIONS)
def test_an_addition_touches_the_places_listed_and_no_others(tmp_path, title):
    """But for tests and pages of the documentation, which a run does not read."""
    add, names = ADDITIONS[title]
    touched = touched_files(copy_project(tmp_path), add)
    listed = listed_places(title, **names)
    for path in touched:
        assert any(in_place(path, place) for place in listed), f"the guide does not list {path}"
    for place in listed:
        if is_run(place):
            assert any(in_place(path, place) for path in touched), f"{place} is not needed"


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    folder = copy_project(tmp_path_factory.mktemp("extended"))
    add_toy_model(folder)
    add_toy_solver(folder)
    return folder


@pytest.fixture(scope="module")
def inputs(extended):
    """Rule -> input files of all its jobs in the tiny experiment."""
    run = snakemake(extended, "all", "--dry-run", "--forceall", "--configfile", CONFIG)
    assert run.returncode == 0, run.stderr[-2000:]
    jobs = re.findall(r"^rule (\w+):\n(?:    input: (.*))?", run.stdout + run.stderr, re.MULTILINE)
    found: dict[str, list[str]] = {}
    for rule, files in jobs:
        found.setdefault(rule, []).extend(files.split(", "))
    return found


def test_a_models_own_files_and_one_line_plan_it_with_all_the_rest(inputs):
    assert {"train_toy", "evaluate_toy", "tabulate_toy"} <= set(inputs)
    assert "results/tiny/metrics/toy.tsv" in inputs["collect_metrics"]
    # Times are taken of every step.
    assert "results/tiny/report/toy_metrics.html" in inputs["plot_time"]


def test_a_models_metrics_come_into_the_table(extended, inputs):
    """Really evaluated and collected, beside empty tables of the other models."""
    results = extended / "results/tiny"
    for name in inputs["collect_metrics"]:
        if not name.endswith("toy.tsv"):
            write_metrics(extended / name, metric_table([]))
    for name in ("gcvae", "garment4d"):
        write_metrics(results / f"metrics/representations_{name}.tsv", metric_table([]))
    for name in ("toy/model", "static/data"):
        (results / name).mkdir(parents=True)
    run = snakemake(
        extended,
        *("--allowed-rules", "evaluate_toy", "compare_toy", "collect_metrics"),
        *("tabulate_representations", "--configfile", CONFIG),
        *("--", "results/tiny/metrics.tsv", "results/tiny/report/representations.html"),
    )
    assert run.returncode == 0, run.stderr[-2000:]
    rows = read_metrics(results / "metrics.tsv").itertuples()
    found = {(row.model, row.variant): row for row in rows}
    assert found["toy", "toy"].value == 12.5
    assert set(found) == {("toy", "toy"), ("representation", "toy_flat")}
    assert "toy_flat" in (results / "report/representations.html").read_text()


def obstacles_of_toy_model(project):
    """What would stop the toy model, as far as files tell without a run."""
    included = re.findall(r'^include: "(.*)"', (project / "Snakefile").read_text(), re.MULTILINE)
    file = project / "workflow/rules/toy.smk"
    if not file.is_file() or "workflow/rules/toy.smk" not in included:
        yield f"{file} is not there or not included"
        return
    rules = file.read_text()
    if "toy" not in (project / "src/drapeline/experiment/settings.py").read_text():
        yield "`make docs` would take its block out of the schema"
    schema = yaml.safe_load((project / "workflow/schemas/config.schema.yaml").read_text())
    for path in re.findall(r'dpath="(\w+)/', rules):
        if path not in schema["properties"]:
            yield f"{path} is not a setting"
    for name in re.findall(r'"(\.\./.*\.(?:py|rst))"', rules):
        path = file.parent / name
        if not path.is_file():
            yield f"{path} is not there"
        elif path.suffix == ".py":
            for module in imported_modules(path.read_text()):
                source = project / "src" / module.replace(".", "/")
                files = (source / "__init__.py", source.with_suffix(".py"))
                if module.startswith("drapeline") and not any(f.is_file() for f in files):
                    yield f"{path.name} imports {module}"


def test_a_model_needs_each_of_the_places_listed(tmp_path):
    project = copy_project(tmp_path)
    touched = touched_files(project, add_toy_model)
    assert not list(obstacles_of_toy_model(project))
    for place in filter(is_run, listed_places("A new model", model="toy")):
        own = [path for path in touched if in_place(path, place)]
        for path in own:
            before, _ = touched[path]
            if before is None:
                (project / path).unlink()
            else:
                (project / path).write_bytes(before)
        assert list(obstacles_of_toy_model(project)), f"{place} is not needed"
        for path in own:
            (project / path).write_bytes(touched[path][1])


def test_a_new_model_makes_no_other_rule_run_again(extended):
    before, after = Sources(ROOT / "src"), Sources(extended / "src")
    for script in sorted((ROOT / "scripts").glob("*.py")):
        assert before.digest(script) == after.digest(extended / "scripts" / script.name)


def test_a_cloth_solvers_folder_and_two_lines_simulate_with_it(extended, toy_body):
    dressed = dress(toy_body)
    results = extended / "results/tiny"
    for gender in GENDERS:
        save_body(extended / f"resources/body/{gender}.npz", toy_body)
    save_body_sequence(results / "bodies/dataset/00001/00001.npz", dressed.motion)
    outfit = results / "outfits/dataset/00001/00001"
    dressed.outfit.save(f"{outfit}.npz", f"{outfit}.json")
    settings = {"simulation": {"solver": "toy", "settings": {"attempts": 1}}}
    (extended / "toy.yaml").write_text(yaml.safe_dump(settings))
    run = snakemake(
        extended,
        *("--allowed-rules", "simulate_outfits", "write_samples"),
        *("--configfile", CONFIG, "toy.yaml", "--", "results/tiny/samples/dataset/00001"),
    )
    assert run.returncode == 0, run.stderr[-2000:]
    status = read_meta(results / "samples/dataset/00001/00001")["simulation"]
    assert status["solver"] == {"name": "toy", "settings": {}}
    # Cloth that hangs in the air where the body was is no good.
    assert status["status"] == "rejected"


def test_a_cloth_solvers_room_has_its_layer(extended):
    tests = [
        "tests/toys/cloth_solvers.py",
        "tests/toys/imported_modules.py",
        "tests/unit/test_layers.py",
    ]
    for name in [*tests, "docs/background/architecture.md", "pyproject.toml"]:
        (extended / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, extended / name)
    pytest_options = ["-v", "-p", "no:cacheprovider", "-k", "toy_cloth or documented"]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *pytest_options, "tests/unit/test_layers.py"],
        cwd=extended,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout[-2000:]
    assert "test_imports_go_one_way[toy_cloth]" in run.stdout


def test_a_cloth_solver_counts_where_it_is_chosen(extended):
    sources = Sources(extended / "src")
    script = extended / "scripts/simulate_outfits.py"
    module = extended / "src/drapeline/toy_cloth/solver.py"
    assert module not in sources.imported_files(script)
    assert module in sources.imported_files(script, "drapeline.toy_cloth.solver")
    rules = (ROOT / "workflow/rules/simulation.smk").read_text()
    for rule in ("simulate_outfits", "write_samples"):
        assert f'code=solver_hash("{rule}")' in rules


def test_the_schema_and_the_rule_name_the_same_cloth_solvers():
    solver = SCHEMA["properties"]["simulation"]["properties"]["solver"]
    assert solver["enum"] == [*cloth_solvers()]
    group = SCHEMA["properties"]["groups"]["additionalProperties"]["properties"]["solver"]
    assert group["enum"] == [*solver["enum"], AT_REST, None]
    for name, (module, environment) in cloth_solvers().items():
        assert import_module(module).cloth_solver(1).name == name
        assert (ROOT / "workflow/rules" / environment).is_file()


def project_files():
    yield ROOT / "Snakefile"
    for folder in ("src", "scripts", "workflow"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in {".py", ".smk", ".yaml", ".rst"}:
                yield path


def test_nothing_but_settings_and_rule_name_a_cloth_solver():
    """Blender renders and exports as well: these scripts and environments do not count.

    Nor do configs, which choose one, and the profile that says which simulations ask for a GPU.
    """
    other = re.compile(r"envs/blender\.yaml|drapeline\.blender\.(render|export)\b")
    names = re.compile(rf"\b({'|'.join(cloth_solvers())})\b")
    rooms = [ROOT.joinpath("src", *code.split(".")[:2]) for code, _ in cloth_solvers().values()]
    chosen = [ROOT / "workflow/config", ROOT / "workflow/profiles"]
    naming = {
        str(path.relative_to(ROOT))
        for path in project_files()
        if not any(path.is_relative_to(folder) for folder in [*rooms, *chosen])
        and names.search(other.sub("", path.read_text()))
    }
    assert naming == {
        "src/drapeline/experiment/settings.py",
        "workflow/schemas/config.schema.yaml",
        "workflow/rules/groups_common.smk",
    }


def test_a_row_of_the_table_makes_a_fabric(monkeypatch, toy_body, tmp_path):
    linen = Fabric(density_kg_m2=0.2, stretch_n_per_m=200, bending_n_m=1e-6, damping_kg_s=0.01)
    monkeypatch.setitem(FABRICS, "linen", linen)
    drawn = {
        garment
        for k in range(300)
        for garment, about in sample_numbers(
            rng_for(1, k), OUTFIT_TYPES[k % len(OUTFIT_TYPES)], OutfitRanges()
        )
        if about["fabric"] == "linen"
    }
    assert {"Tshirt", "Top", "Trousers", "Skirt", "Jumpsuit", "Dress"} == drawn
    dressed = dress(toy_body)
    dressed.outfit.garments[0].attributes["fabric"] = "linen"
    status = simulate_outfit(
        tmp_path / "00001",
        dressed,
        Follower(),
        settings=SimulationSettings(shape_frames=2, pose_frames=3),
        bounds=HealthBounds(stretch_low=0, stretch_high=9),
    )
    assert status["status"] == "accepted"
    assert status["fabrics"]["Skirt"]["stretch_n_per_m"] == 200
    assert cloth_parameters(linen, 0.01).mass == 0.2


def test_the_places_that_name_a_fabric_are_those_listed():
    assert set(FABRIC_COLOURS) == set(FABRICS)
    quoted = re.compile("|".join(f"[\"']{name}[\"']" for name in FABRICS))
    naming = {str(p.relative_to(ROOT)) for p in project_files() if quoted.search(p.read_text())}
    listed = set(listed_places("A new fabric"))
    assert naming == {path for path in listed if path.startswith("src/")}
    for page in sorted(listed - naming):
        text = (ROOT / page).read_text()
        assert all(name in text for name in FABRICS), f"{page} does not name every fabric"


def test_a_row_of_the_table_makes_a_garment_type(tmp_path):
    """Overalls: straps, separate legs, for males too; planned, made, labelled and coloured."""
    project = copy_project(tmp_path)
    add_toy_garment_type(project)
    paths = os.pathsep.join([str(project / "src"), str(ROOT / "tests")])
    run = subprocess.run(
        [sys.executable, "-c", TOY_TYPE_USE],
        cwd=project,
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    made = json.loads(run.stdout)
    assert {"upper", "trousers"} <= set(made["parts"])
    assert "strap_m" in made["upper"]
    assert made["held"] > 0
    assert (made["index"], made["topology"]) == (len(GARMENTS), "body")
    assert made["removable"] == "forearms"
    assert len(made["colour"]) == 3


def test_every_garment_type_is_in_the_places_listed():
    """So that a place which a new type lacks is named."""

    def lacking(path):
        words = set(re.findall(r"\w+", path.read_text()))
        return [name for name in GARMENTS if name not in words]

    listed = listed_places("A new garment type")
    for place in listed:
        missing = lacking(ROOT / place)
        assert not missing, f"{place} lacks {', '.join(missing)}"
    assert set(GARMENT_COLOURS) == set(GARMENTS)
    naming = {
        str(path.relative_to(ROOT))
        for path in [*project_files(), ROOT / "config.yaml"]
        if not lacking(path)
    }
    # The paper's own numbers are of its own types.
    naming.remove("src/drapeline/report/models/gcvae/tables.py")
    # Segmentation networks have classes of their own.
    naming.remove("src/drapeline/models/smplicit/pictures/read.py")
    assert naming == {place for place in listed if not place.startswith("docs/")}
