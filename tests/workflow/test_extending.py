"""What docs/extending.md promises: additions touch the places it lists, and nothing else."""

import re
import shutil
import subprocess
import sys
from importlib import import_module

import pytest
import yaml

from cloth_solvers import cloth_solvers
from cloth_toys import Follower, dress
from drapeline.blender.fabric_units import cloth_parameters
from drapeline.bodies.model import save_body
from drapeline.bodies.sequence import save_body_sequence
from drapeline.experiment.source_digest import Sources
from drapeline.frames import GENDERS
from drapeline.metrics.table import read_metrics, write_metrics
from drapeline.outfits.distributions import OutfitRanges
from drapeline.outfits.fabrics import FABRICS, Fabric
from drapeline.outfits.garment_types import OUTFIT_TYPES
from drapeline.outfits.generate import sample_numbers
from drapeline.report.style import FABRIC_COLOURS
from drapeline.seeding import rng_for
from drapeline.simulation.attempts import SimulationSettings
from drapeline.simulation.health import HealthBounds
from drapeline.simulation.simulate import simulate_outfit
from drapeline.storage import read_json
from snakemake_run import ROOT, copy_project, snakemake

CONFIG = "tests/data/tiny.yaml"

TOY_RULES = """
METRIC_TABLES["metrics"] += ["toy"]
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


rule tabulate_toy:
    input:
        f"{RESULTS}/metrics.tsv",
    output:
        f"{RESULTS}/report/toy_metrics.html",
    log:
        f"{LOGS}/tabulate_toy.log",
    params:
        code=source_hash("tabulate_toy"),
    script:
        "../../scripts/tabulate_toy.py"
"""
TOY_SCHEMA = """
  toy:
    type: object
    additionalProperties: false
    default: {}
    properties:
      size: {type: integer, minimum: 1, default: 3, description: Numbers of the code.}
"""
TOY_EVALUATION = """
from drapeline.metrics.table import MetricRow, write_metrics
from drapeline.models.toy.model import MODEL

value = MetricRow(MODEL, MODEL, "test", "all", "surface_error_mm", 12.5, "mm", 1, 0)
write_metrics(snakemake.output[0], [value])
"""

TOY_SOLVER = """
from drapeline.simulation.attempts import Attempt


class Toy:
    name = "toy"
    settings = {}

    def versions(self):
        return {}

    def simulate(self, garments, body, attempt: Attempt, scratch):
        for _ in range(len(body)):
            yield [garment.vertices for garment in garments]


def cloth_solver(threads):
    return Toy()
"""


def append(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "a") as stream:
        stream.write(text)


def add_toy_model(project):
    """A model in the places that a model may touch."""
    append(project / "src/drapeline/models/toy/__init__.py", "")
    append(project / "src/drapeline/models/toy/model.py", 'MODEL = "toy"\n')
    append(project / "workflow/rules/toy.smk", TOY_RULES)
    append(project / "scripts/evaluate_toy.py", TOY_EVALUATION)
    for name in ("train_toy", "tabulate_toy"):
        append(project / f"scripts/{name}.py", "from drapeline.models.toy import model\n")
    append(project / "workflow/schemas/config.schema.yaml", TOY_SCHEMA)
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
    """A folder, a word in the schema and a line in the rule's table."""
    append(project / "src/drapeline/toy_cloth/__init__.py", "")
    append(project / "src/drapeline/toy_cloth/solver.py", TOY_SOLVER)
    replace(project / "workflow/schemas/config.schema.yaml", "[blender]", "[blender, toy]")
    line = '    "toy": ("drapeline.toy_cloth.solver", "../../envs/geometry.yaml"),\n'
    table = "CLOTH_SOLVERS = {\n"
    replace(project / "workflow/rules/simulation.smk", table, table + line)


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    folder = copy_project(tmp_path_factory.mktemp("extended"))
    add_toy_model(folder)
    add_toy_solver(folder)
    return folder


@pytest.fixture(scope="module")
def inputs(extended):
    """Rule -> input files, of one job of each rule that the tiny experiment has."""
    run = snakemake(extended, "all", "--dry-run", "--forceall", "--configfile", CONFIG)
    assert run.returncode == 0, run.stderr[-2000:]
    jobs = re.findall(r"^rule (\w+):\n(?:    input: (.*))?", run.stdout + run.stderr, re.MULTILINE)
    return {rule: files.split(", ") for rule, files in jobs}


def test_a_models_own_files_and_one_line_plan_it_with_all_the_rest(inputs):
    assert {"train_toy", "evaluate_toy", "tabulate_toy"} <= set(inputs)
    assert "results/tiny/metrics/toy.tsv" in inputs["collect_metrics"]
    # Times are taken of every step.
    assert "results/tiny/report/toy_metrics.html" in inputs["plot_time"]


def test_a_models_metrics_come_into_the_table(extended, inputs):
    """Really evaluated and collected, beside empty tables of the other models."""
    for name in inputs["collect_metrics"]:
        if not name.endswith("/toy.tsv"):
            write_metrics(extended / name, [])
    results = extended / "results/tiny"
    for name in ("toy/model", "static/data"):
        (results / name).mkdir(parents=True)
    run = snakemake(
        extended,
        *("--allowed-rules", "evaluate_toy", "collect_metrics", "--configfile", CONFIG),
        *("--", "results/tiny/metrics.tsv"),
    )
    assert run.returncode == 0, run.stderr[-2000:]
    (row,) = read_metrics(results / "metrics.tsv")
    assert (row.model, row.value) == ("toy", 12.5)


def test_a_new_model_makes_no_other_rule_run_again(extended):
    before, after = Sources(ROOT / "src"), Sources(extended / "src")
    for script in sorted((ROOT / "scripts").glob("*.py")):
        assert before.digest(script) == after.digest(extended / "scripts" / script.name)


def test_a_cloth_solvers_folder_and_two_lines_simulate_with_it(extended, toy_body):
    dressed = dress(toy_body)
    results = extended / "results/tiny"
    for gender in GENDERS:
        save_body(extended / f"resources/body/{gender}.npz", toy_body)
    save_body_sequence(results / "bodies/00001.npz", dressed.motion)
    dressed.outfit.save(results / "outfits/00001.npz", results / "outfits/00001.json")
    settings = {"simulation": {"solver": "toy", "settings": {"attempts": 1}}}
    (extended / "toy.yaml").write_text(yaml.safe_dump(settings))
    run = snakemake(
        extended,
        *("--allowed-rules", "simulate_outfit", "--configfile", CONFIG, "toy.yaml"),
        *("--", "results/tiny/simulation/00001"),
    )
    assert run.returncode == 0, run.stderr[-2000:]
    status = read_json(results / "simulation/00001/status.json")
    assert status["solver"] == {"name": "toy", "settings": {}}
    # Cloth that hangs in the air where the body was is no good.
    assert status["status"] == "rejected"


def test_a_cloth_solvers_room_has_its_layer(extended):
    tests = ["tests/cloth_solvers.py", "tests/imported_modules.py", "tests/unit/test_layers.py"]
    for name in [*tests, "docs/architecture.md", "pyproject.toml"]:
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
    assert "test_imports_go_one_way[toy_cloth/solver.py]" in run.stdout


def test_a_cloth_solver_counts_where_it_is_chosen(extended):
    sources = Sources(extended / "src")
    script = extended / "scripts/simulate_outfit.py"
    module = extended / "src/drapeline/toy_cloth/solver.py"
    assert module not in sources.imported_files(script)
    assert module in sources.imported_files(script, "drapeline.toy_cloth.solver")
    rules = (ROOT / "workflow/rules/simulation.smk").read_text()
    assert 'source_hash("simulate_outfit", SOLVER_MODULE)' in rules


def test_the_schema_and_the_rule_name_the_same_cloth_solvers():
    schema = yaml.safe_load((ROOT / "workflow/schemas/config.schema.yaml").read_text())
    solver = schema["properties"]["simulation"]["properties"]["solver"]
    assert solver["enum"] == [*cloth_solvers()]
    for name, (module, environment) in cloth_solvers().items():
        assert import_module(module).cloth_solver(1).name == name
        assert (ROOT / "workflow/rules" / environment).is_file()


def project_files():
    yield ROOT / "Snakefile"
    for folder in ("src", "scripts", "workflow"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in {".py", ".smk", ".yaml", ".rst"}:
                yield path


def test_nothing_but_schema_and_rule_names_a_cloth_solver():
    """Blender renders and exports as well: these scripts and environments do not count."""
    other = re.compile(r"envs/blender\.yaml|drapeline\.blender\.(render|export)\b")
    naming = {
        str(path.relative_to(ROOT))
        for path in project_files()
        if not path.is_relative_to(ROOT / "src/drapeline/blender")
        and re.search(r"\bblender\b", other.sub("", path.read_text()))
    }
    assert naming == {"workflow/schemas/config.schema.yaml", "workflow/rules/simulation.smk"}


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
    dressed.outfit.garments[0].about["fabric"] = "linen"
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
    guide = (ROOT / "docs/extending.md").read_text().partition("## A new fabric")[2]
    listed = set(re.findall(r"`((?:src|docs)/[\w/.-]+)`", guide.partition("\n## ")[0]))
    assert naming == {path for path in listed if path.startswith("src/")}
    for page in sorted(listed - naming):
        text = (ROOT / page).read_text()
        assert all(name in text for name in FABRICS), f"{page} does not name every fabric"
