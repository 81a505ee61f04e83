"""Which rules run again when a file of the library changes: no more than need to.

An import too many makes hours of simulation or training run again for nothing. When a test here
fails, ask what the module needs of the new import; most often that fits a module of its own.
"""

import re
from pathlib import Path

import pytest

from cloth_solvers import cloth_solvers
from drapeline.experiment.source_digest import Sources
from snakemake_run import ROOT, copy_project, snakemake

CONFIG = "tests/data/tiny.yaml"
LIBRARY = ROOT / "src" / "drapeline"
SOURCES = Sources(ROOT / "src")


def scripts() -> dict[str, str]:
    """Rule -> its script."""
    text = "\n".join(path.read_text() for path in (ROOT / "workflow/rules").glob("*.smk"))
    rules = re.split(r"^rule (\w+):$", text, flags=re.MULTILINE)[1:]
    found = {
        rule: re.search(r'"../../scripts/(\w+)\.py"', body)
        for rule, body in zip(rules[::2], rules[1::2], strict=True)
    }
    return {rule: match[1] for rule, match in found.items() if match}


SCRIPTS = scripts()
NAMED = {"simulate_outfit": [cloth_solvers()["blender"][0]]}
FILES = {
    rule: {
        str(path.relative_to(LIBRARY))
        for path in SOURCES.imported_files(
            ROOT / "scripts" / f"{script}.py", *NAMED.get(script, [])
        )
    }
    for rule, script in SCRIPTS.items()
}
RERUN = {}


@pytest.mark.parametrize("file", RERUN)
def test_a_change_reaches_exactly_these_rules(file):
    assert (LIBRARY / file).is_file()
    assert {rule for rule, files in FILES.items() if file in files} == RERUN[file]


def test_packages_hold_nothing_but_a_docstring():
    """The digest does not follow them, because importing a module does not name its package."""
    for path in LIBRARY.rglob("__init__.py"):
        if path != LIBRARY / "__init__.py":
            assert re.fullmatch(r'("""[^"]*"""\n)?', path.read_text()), path


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A copy of the project in which Snakemake takes every job for done."""
    project = copy_project(tmp_path_factory.mktemp("finished"))
    plan = snakemake(project, "all", "--dry-run", "--forceall", "--configfile", CONFIG)
    assert plan.returncode == 0, plan.stderr[-2000:]
    for line in re.findall(r"^    output: (.*)$", plan.stdout + plan.stderr, re.MULTILINE):
        for output in map(project.joinpath, line.split(", ")):
            folder = output if not output.suffix else output.parent
            folder.mkdir(parents=True, exist_ok=True)
            if output.suffix:
                output.touch()
    done = snakemake(project, "all", "--touch", "--forceall", "--configfile", CONFIG)
    assert done.returncode == 0, done.stderr[-2000:]
    return project


@pytest.fixture
def planned(finished):
    """planned(file): the rules that run after a change of it, each with Snakemake's reason."""
    changed = []

    def plan(file: str) -> dict[str, str]:
        path = finished / "src/drapeline" / file
        changed.append((path, path.read_text()))
        path.write_text(path.read_text() + "\nADDED = 1\n")
        run = snakemake(finished, "all", "--dry-run", "--configfile", CONFIG)
        assert run.returncode == 0, run.stderr[-2000:]
        text = run.stdout + run.stderr
        jobs = re.findall(r"^(?:local)?rule (\w+):\n(?:    .*\n)*?    reason: (.*)$", text, re.M)
        return dict(jobs)

    yield plan
    for path, text in changed:
        path.write_text(text)


def rules_of(file: Path) -> set[str]:
    return set(re.findall(r"^rule (\w+):", file.read_text(), re.MULTILINE))


GARMENT4D = rules_of(ROOT / "workflow/rules/garment4d.smk")


@pytest.mark.parametrize(
    ("file", "never"),
    [
        ("models/gcvae/ppca_vae.py", GARMENT4D | {"train_svae", "register_static"}),
        ("registration/to_body/nicp.py", GARMENT4D | {"simulate_outfit", "build_super_body"}),
    ],
)
def test_what_follows_a_change_leaves_other_work_alone(planned, file, never):
    jobs = planned(file)
    direct = {rule for rule, reason in jobs.items() if reason.startswith("Params have changed")}
    assert direct == RERUN[file] & (direct | set(jobs))
    assert direct
    assert not jobs.keys() & never


def test_a_module_of_the_report_makes_its_page_alone(planned):
    assert planned("report/dataset/health.py").keys() == {"plot_health", "plot_time", "all"}
