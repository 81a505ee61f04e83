"""What docs/how-to/extending.md promises: additions touch the places it lists, and nothing else."""

import dataclasses
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from importlib import import_module

import pytest
import yaml

from drapeline.blender.fabric_units import cloth_parameters
from drapeline.bodies.model import save_body
from drapeline.bodies.sequence import save_body_sequence
from drapeline.dataset.record import read_meta
from drapeline.experiment.cloth_solvers import CLOTH_SOLVERS
from drapeline.experiment.groups import AT_REST
from drapeline.experiment.source_digest import Sources
from drapeline.frames import GENDERS
from drapeline.metrics.table import read_metrics, write_metrics
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.fabrics import FABRICS
from drapeline.outfits.garment_types import GARMENTS, OUTFIT_TYPES
from drapeline.outfits.generate import sample_numbers
from drapeline.report.colours import FABRIC_COLOURS, GARMENT_COLOURS
from drapeline.seeding import rng_for
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import simulate_outfit
from toys.cloth import Follower, dress
from toys.metric_rows import metric_table
from toys.schema import SCHEMA
from toys.snakemake_run import PARTS, ROOT, copy_project, snakemake

CONFIG = "tests/data/tiny.yaml"

# A model in a package of its own.
STRANGER = {
    "settings.py": """
from drapeline.settings import Field, Settings


class ToySettings(Settings):
    size: int = Field(3, ge=1, description="Numbers of the code.")
""",
    "plan.py": """
from stranger.settings import ToySettings

from drapeline.models.registry import EvaluationTask, Figure, Model, ModelPlan, ReportFile, Task


def plan(files):
    size, cost = files.config["toy"]["size"], {"seconds": 1, "megabytes": 100}
    folder = f"{files.results}/toy"
    train = Task("stranger.train:train", {"data": files.static}, {"size": size}, **cost)
    evaluate = Task("stranger.evaluate:evaluate", {"model": f"{folder}/model"}, {}, **cost)
    compare = Task("stranger.evaluate:compare", {"data": files.static}, {}, **cost)
    show = Task("stranger.evaluate:show", {"metrics": files.metrics("metrics")}, {}, **cost)
    return ModelPlan(
        trainings={"model": train},
        evaluations={
            "evaluated/toy": EvaluationTask(evaluate, ["metrics"]),
            "evaluated/representations": EvaluationTask(compare, ["representations"]),
        },
        figures={"show_toy": Figure(show, {"page": ReportFile("toy.html", "errors", CAPTION)})},
        targets={"toy_model": [f"{folder}/model"]},
    )


CAPTION = __file__.replace("plan.py", "toy")
MODEL = Model("toy", "Toy", ToySettings, plan, loaders={"toy": "stranger.train:Toy"})
""",
    "toy.rst": "A toy.\n",
    "train.py": """
import json
from pathlib import Path


class Toy:
    def __init__(self, folder):
        self.size = json.loads((Path(folder) / "model.json").read_text())


def train(job):
    folder = Path(job.output[0])
    folder.mkdir()
    (folder / "model.json").write_text(json.dumps(job.params.size))
""",
    "evaluate.py": """
from pathlib import Path

import numpy as np
from stranger.train import Toy

from drapeline.geometry.mesh import Mesh
from drapeline.metrics.cost import write_costs
from drapeline.metrics.metric import Measured
from drapeline.metrics.table import summarise, write_evaluation
from drapeline.models.compare import compare_representations
from drapeline.models.contract import HeldOutGarment


class Flat:
    variant = "toy_flat"

    def code_numbers(self, garment):
        return 2

    def rebuild(self, garments):
        for garment in garments:
            yield Mesh(garment.mesh.vertices * [1, 1, 0], garment.mesh.faces)


def evaluate(job):
    size = Toy(job.input.model).size
    measured = [Measured("s00001", "Skirt", {"surface_error_mm": 12.5, "size": size})]
    rows = summarise(measured, model="toy", variant="toy", split="test", seed=0)
    write_evaluation(job.output[0], rows)


def compare(job):
    mesh = Mesh(np.float32([[0, 0, 0.01], [1, 0, 0.01], [0, 1, 0.01]]), np.int32([[0, 1, 2]]))
    garments = [HeldOutGarment(0, "s00001", "Skirt", mesh)]
    rows, costs = compare_representations(garments, [Flat()], split="test", seed=0)
    write_evaluation(job.output[0], rows, lambda made: write_costs(made, costs))


def show(job):
    Path(job.output.page).write_text(Path(job.input.metrics).read_text())
""",
}

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


def install_stranger(project):
    """What pip does with a package that names its model as an entry point."""
    for name, text in {"__init__.py": "", **STRANGER}.items():
        append(project / "src/stranger" / name, text)
    installed = project / "src/stranger-1.0.dist-info"
    append(installed / "METADATA", "Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    entry = "[drapeline.models]\ntoy = stranger.plan:MODEL\n"
    append(installed / "entry_points.txt", entry)


def replace(path, old, new):
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


def add_toy_solver(project):
    """A folder, and a line in the table."""
    append(project / "src/drapeline/toy_cloth/__init__.py", "")
    append(project / "src/drapeline/toy_cloth/solver.py", TOY_SOLVER)
    line = '    "toy": SolverEntry("drapeline.toy_cloth.solver", "geometry", False, 50),\n'
    table = "CLOTH_SOLVERS = {\n"
    replace(project / "src/drapeline/experiment/cloth_solvers.py", table, table + line)
    write_schema(project)


TOY_TYPE = """
    "Overalls": GarmentType("whole"),
}
GARMENTS = tuple(GARMENT_TYPES)
"""
# What comes of the type, by code that has never heard of it.
TOY_TYPE_USE = """
import json
import sys
import zipfile

import numpy as np
import yaml

from drapeline.outfits.garment_types import LABELS
from drapeline.experiment.config import fill_settings
from drapeline.experiment.plan import Wardrobe, plan_at_rest
from drapeline.outfits.generate import sample_outfit
from drapeline.outfits.templates import build_templates
from drapeline.registration.to_body.topology import TOPOLOGIES, topology_codes
from drapeline.registration.to_template.garment_template import make_template
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
forms = build_templates(body)
template = make_template("Overalls", {"female": forms}, {"female": body}, 0.035)
outfit = sample_outfit(
    rng_for(1), forms, body,
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
        "openings": sorted(set(template.loop.tolist())),
        "colour": garment_colour(garment.name),
    },
    sys.stdout,
)
"""


def add_toy_garment_type(project):
    """A row in the table, an outfit, its openings, its words in the config, and a colour."""
    table = "}\nGARMENTS = tuple(GARMENT_TYPES)\n"
    types = project / "src/drapeline/outfits/garment_types.py"
    replace(types, table, TOY_TYPE.removeprefix("\n"))
    replace(types, '"Dress", "Jumpsuit")', '"Dress", "Jumpsuit", "Overalls")')
    openings = project / "src/drapeline/registration/to_template/garment_template.py"
    last = '    "Jacket": ('
    own = '    "Overalls": ("neck", "left_cuff", "right_cuff", "left_leg", "right_leg"),\n'
    replace(openings, last, own + last)
    write_schema(project)
    colours = project / "src/drapeline/report/colours.py"
    replace(colours, '    "Dress": SKY,\n', '    "Dress": SKY,\n    "Overalls": "#F0E442",\n')
    for config in ("config.yaml", "workflow/config/reference.yaml"):
        replace(project / config, "\n  types: [", "\n  types: [Overalls, ")
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
    install_stranger(folder)
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


def test_a_model_of_another_package_is_planned_with_all_the_rest(inputs):
    assert {"show_toy", "train", "evaluate"} <= set(inputs)
    assert "results/tiny/toy/evaluated/toy" in inputs["collect_metrics"]
    # Times are taken of every step.
    assert "results/tiny/report/toy.html" in inputs["plot_time"]


def test_a_model_of_another_package_is_trained_evaluated_and_shown(extended, inputs):
    """Beside empty tables of the other models."""
    results = extended / "results/tiny"
    for name in inputs["collect_metrics"]:
        if "/toy/" not in name:
            write_metrics(extended / name / "metrics.tsv", metric_table([]))
    (results / "static").mkdir(parents=True)
    (extended / "mine.yaml").write_text("toy: {size: 5}\n")
    run = snakemake(
        extended,
        *("--allowed-rules", "train", "evaluate", "collect_metrics", "tabulate_representations"),
        *("show_toy", "toy_model", "--configfile", CONFIG, "mine.yaml", "--"),
        *("results/tiny/report/toy.html", "results/tiny/report/representations.html", "toy_model"),
    )
    assert run.returncode == 0, run.stderr[-2000:]
    rows = read_metrics(results / "metrics.tsv")
    found = {(row.model, row.variant, row.metric): row.value for row in rows.itertuples()}
    assert found["toy", "toy", "surface_error_mm"] == 12.5
    assert found["toy", "toy", "size"] == 5
    assert {key[:2] for key in found} == {("toy", "toy"), ("representation", "toy_flat")}
    assert "toy_flat" in (results / "report/representations.html").read_text()
    assert "12.5" in (results / "report/toy.html").read_text()
    told = ("--configfile", CONFIG, "mine.yaml", "--report", "toy.zip", "--")
    run = snakemake(extended, *told, "results/tiny/report/toy.html")
    assert run.returncode == 0, run.stderr[-2000:]
    with zipfile.ZipFile(extended / "toy.zip") as made:
        (page,) = (name for name in made.namelist() if name.endswith("report.html"))
        assert "A toy." in made.read(page).decode()


def test_a_setting_of_another_packages_model_is_checked(extended):
    (extended / "mine.yaml").write_text("toy: {size: 0}\n")
    run = snakemake(extended, "--dry-run", "--configfile", CONFIG, "mine.yaml")
    assert "toy.size is 0, expected an integer of at least 1" in run.stdout + run.stderr


def test_all_code_of_another_package_counts_for_its_tasks(extended, monkeypatch):
    monkeypatch.syspath_prepend(extended / "src")
    script = ROOT / "scripts/run_job.py"

    def digest():
        return Sources(ROOT / "src").digest(script, "stranger.train:train")

    before, file = digest(), extended / "src/stranger/evaluate.py"
    text = file.read_text()
    file.write_text(text.replace("12.5", "13.5"))
    assert digest() != before
    file.write_text(text)
    assert digest() == before


def test_a_new_model_makes_no_other_rule_run_again(extended):
    before, after = Sources(ROOT / "src"), Sources(extended / "src")
    for script in sorted((ROOT / "scripts").glob("*.py")):
        assert before.digest(script) == after.digest(extended / "scripts" / script.name)


def test_a_cloth_solvers_folder_and_a_line_simulate_with_it(extended, toy_body):
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


def test_the_schema_names_the_cloth_solvers():
    solver = SCHEMA["properties"]["simulation"]["properties"]["solver"]
    assert solver["enum"] == [*CLOTH_SOLVERS]
    group = SCHEMA["properties"]["groups"]["additionalProperties"]["properties"]["solver"]
    assert group["enum"] == [*CLOTH_SOLVERS, AT_REST, None]
    for name, entry in CLOTH_SOLVERS.items():
        assert import_module(entry.code).cloth_solver(1).name == name
        assert (ROOT / f"envs/{entry.environment}.yaml").is_file()


def project_files():
    yield ROOT / "Snakefile"
    for folder in ("src", "scripts", "workflow"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in {".py", ".smk", ".yaml", ".rst"}:
                yield path


def test_nothing_but_the_table_and_settings_name_a_cloth_solver():
    """Blender renders and exports as well: these scripts and environments do not count.

    Nor do configs, which choose one, and the profile that says which simulations ask for a GPU.
    """
    other = re.compile(r"envs/blender\.yaml|drapeline\.blender\.(render|export|usd|fbx)\b")
    names = re.compile(rf"\b({'|'.join(CLOTH_SOLVERS)})\b")
    rooms = [ROOT.joinpath("src", *one.code.split(".")[:2]) for one in CLOTH_SOLVERS.values()]
    chosen = [ROOT / "workflow/config", ROOT / "workflow/profiles"]
    naming = {
        str(path.relative_to(ROOT))
        for path in project_files()
        if not any(path.is_relative_to(folder) for folder in [*rooms, *chosen])
        and names.search(other.sub("", path.read_text()))
    }
    assert naming == {
        "src/drapeline/experiment/cloth_solvers.py",
        "src/drapeline/experiment/settings.py",
        "workflow/schemas/config.schema.yaml",
    }


def test_a_row_of_the_table_makes_a_fabric(monkeypatch, toy_body, tmp_path):
    values = {"density_kg_m2": 0.2, "shear_n_per_m": 500, "garments": GARMENTS}
    felt = dataclasses.replace(FABRICS["leather"], **values)
    monkeypatch.setitem(FABRICS, "felt", felt)
    drawn = {
        garment
        for k in range(300)
        for garment, about in sample_numbers(
            rng_for(1, k), OUTFIT_TYPES[k % len(OUTFIT_TYPES)], OutfitRanges(), ("silk", "felt")
        )
        if about["fabric"] == "felt"
    }
    assert drawn == set(GARMENTS)
    dressed = dress(toy_body)
    dressed.outfit.garments[0].attributes["fabric"] = "felt"
    status = simulate_outfit(
        tmp_path / "00001",
        dressed,
        Follower(),
        settings=SimulationSettings(shape_frames=2, pose_frames=3, settle_frames=0),
        bounds=HealthBounds(stretch_low=0, stretch_high=9),
    )
    assert status["status"] == "accepted"
    assert status["fabrics"]["Skirt"]["shear_n_per_m"] == 500
    assert cloth_parameters(felt, 0.01).mass == 0.2


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
    assert made["openings"] == [-1, 0, 1, 2, 3, 4]  # its template, and within the cloth
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
    naming.discard("src/drapeline/report/models/gcvae/tables.py")
    # Segmentation networks have classes of their own.
    naming.discard("src/drapeline/models/pictures/read.py")
    assert naming == {place for place in listed if not place.startswith("docs/")}
