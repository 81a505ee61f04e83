"""Which rules run again when code changes: those that run the code, and no others.

`tests/unit/experiment/test_source_digest.py` says so of small packages, this of the real one.
"""

import ast
import inspect
import re
import shutil
from importlib import import_module
from pathlib import Path

import pytest
import yaml

from drapeline.experiment.cloth_solvers import CLOTH_SOLVERS
from drapeline.experiment.source_digest import Sources
from drapeline.models.registry import models
from drapeline.outfits.garment_types import GARMENTS
from toys.plans import files_of, tasks_of
from toys.snakemake_run import ROOT, copy_project, snakemake

CONFIG = "tests/data/tiny.yaml"
PACKAGE = ROOT / "src" / "drapeline"
PROFILES = [
    ROOT / "profiles/default/config.yaml",
    *sorted((ROOT / "workflow/profiles").glob("*/config.yaml")),
]
SCRIPTS = sorted((ROOT / "scripts").glob("*.py"))
SOLVER = CLOTH_SOLVERS["xpbd"].code
# Scripts that are told of the solver that the config names.
SIMULATE = {"simulate_outfits", "write_samples"}
HANG = {
    *("fit_own_scans", "fit_picture", "reconstruct_garment", "regress_picture"),
    *("gcvae/sampled", "gcvae/animated", "gcvae/compare_gcvae_samples"),
}
PLANS = {name: model.plan(files_of(ROOT / CONFIG)) for name, model in models().items()}
TASKS = {
    f"{name}/{folder}": task
    for name, plan in PLANS.items()
    for folder, task in tasks_of(plan).items()
}
PARTS = ("upper", "trousers", "skirt", "whole")
SCANS = ("scans", "clean_scans", "worse_scans")
# Whose garments hang, or are simulated.
SIMULATED = {
    *("smplicit/evaluated/images", "gcvae/evaluated/dynamic_floor", "gcvae/evaluated/moved_again"),
    *(f"{name}/evaluated/{scans}" for name in ("garment4d", "smplicit") for scans in SCANS),
    *(f"garment4d/{garment}/ours" for garment in GARMENTS),
    *(f"garment4d/evaluated/{name}" for name in ("Skirt", "Skirt_ablations", "floor")),
    *(f"smplicit/pose_smplicit_{name}" for name in PARTS),
}
EVALUATED = {name for name in TASKS if name.startswith("gcvae/evaluated/")}
TRAINED = {
    "gcvae": {name for name in TASKS if name.startswith(("gcvae/svae", "gcvae/dvae"))},
    "garment4d": {
        name
        for name, task in TASKS.items()
        if task.run.startswith("drapeline.models.garment4d.train:")
        and not task.run.endswith("train_canonical")
    },
}
# What reads whole samples, whose bodies may be ours.
READERS = {
    *("export_sample", "plot_group", "render_gallery", "render_modalities", "render_people"),
    *("sample_clouds", "scan_samples", "view_example", "view_sample", "smplicit/evaluated/images"),
    *(f"{name}/evaluated/{task}" for name in PLANS for task in (*SCANS, "moved")),
    *("gcvae/animated", "gcvae/show_gcvae_animated", "gcvae/evaluated/moved_again"),
    *("write_protocol", "score_predictions"),
}
# What leaves bodies beside a model, of free ones their version, and what loads such models.
KEEPERS = {
    *("fit_own_scans", "fit_picture", "reconstruct_garment", "smplicit/plot_smplicit"),
    # Also those whose codes are of another size.
    *(
        name
        for name in TASKS
        if re.fullmatch(rf"smplicit/(evaluated/)?({'|'.join(PARTS)})(_\d+)?", name)
    ),
    *(f"smplicit/gallery/{name}" for name in PARTS),
    *(f"smplicit/pose_smplicit_{name}" for name in PARTS),
    *("garment4d/labels", "garment4d/evaluated/Skirt", "garment4d/evaluated/Skirt_ablations"),
    *(f"garment4d/{garment}/ours" for garment in GARMENTS),
    *TRAINED["garment4d"],
}
# Function, method or constant -> the scripts and tasks that run it.
CASES = {
    "drapeline.bodies.model:free_body": READERS | KEEPERS | {"copy_body"},
    "drapeline.motions.retarget:retarget": {"import_motion"},
    "drapeline.outfits.fabrics:FABRICS": SIMULATE | HANG | SIMULATED | {"make_outfits"},
    "drapeline.xpbd.elasticity:make_hinges": SIMULATE | HANG | SIMULATED,
    "drapeline.dataset.card:dataset_card": {"collect_dataset"},
    "drapeline.registration.to_body.nicp:fit_to_surface": {
        *("plot_registration", "register_samples", "register_outfits")
    },
    # How networks are trained is nothing to those who use them.
    "drapeline.models.garment4d.losses:posed_loss": TRAINED["garment4d"],
    "drapeline.models.gcvae.train:train_vae": TRAINED["gcvae"],
    "drapeline.models.gcvae.movers:move_by_model": {"gcvae/animated", "gcvae/evaluated/moved"},
    "drapeline.dataset.segmented_scans:scan_sample": {"scan_samples"},
    "drapeline.models.protocol:write_protocol": {"write_protocol"},
    "drapeline.report.models.systems:write_systems_page": {"tabulate_systems"},
    "drapeline.report.dataset.viewer:write_viewer": {"view_sample", "view_example"},
    # Much imports this module, and a few call this.
    "drapeline.metrics.garment:normal_error_deg": EVALUATED
    - {f"gcvae/evaluated/{name}" for name in ("pictures", "representations", *SCANS)}
    - {f"gcvae/evaluated/{name}" for name in ("moved", "moved_again", "other_codes")},
}


def changed_text(where: str) -> tuple[Path, str]:
    """A file of the package, and its text with a statement more in a function."""
    module, name = where.split(":")
    path = Path(inspect.getfile(import_module(module)))
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if getattr(node, "name", None) == name:
            node.body.append(ast.parse("ADDED = 1").body[0])
        if isinstance(node, ast.Assign | ast.AnnAssign) and name in ast.unparse(node):
            node.value = ast.parse(f"({ast.unparse(node.value)}) or 1", mode="eval").body
    return path.relative_to(PACKAGE), ast.unparse(tree)


def digests(source: Path, memory: Path) -> dict[str, str]:
    """Digest of each script, and of each task of a model."""
    sources = Sources(source, memory)
    found = {
        script.stem: sources.digest(script, *([SOLVER] if script.stem in SIMULATE | HANG else []))
        for script in SCRIPTS
    }
    for name, task in TASKS.items():
        found[name] = sources.digest(ROOT / "scripts/run_job.py", task.run, *task.modules)
    sources.remember()
    return found


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the source, the digests of all scripts, and where they are remembered."""
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("__pycache__"))
    return folder / "src", digests(folder / "src", folder / "memory.json"), folder / "memory.json"


@pytest.mark.parametrize("where", CASES)
def test_a_change_reaches_exactly_what_runs_it(copy, where):
    source, before, memory = copy
    name, text = changed_text(where)
    path = source / "drapeline" / name
    original = path.read_text()
    path.write_text(text)
    after = digests(source, memory)
    path.write_text(original)
    assert {name for name in after if after[name] != before[name]} == CASES[where]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A copy of the project in which Snakemake takes every job for done."""
    project = copy_project(tmp_path_factory.mktemp("finished"))
    plan = snakemake(project, "all", "--summary", "--configfile", CONFIG)
    assert plan.returncode == 0, plan.stderr[-2000:]
    for line in plan.stdout.partition("output_file\t")[2].splitlines()[1:]:
        output = project / line.split("\t")[0]
        folder = output if not output.suffix else output.parent
        folder.mkdir(parents=True, exist_ok=True)
        if output.suffix:
            output.touch()
    done = snakemake(project, "all", "--touch", "--forceall", "--configfile", CONFIG)
    assert done.returncode == 0, done.stderr[-2000:]
    return project


def planned_jobs(project: Path, *configs: str) -> dict[str, str]:
    """The rules that run, or tasks such as `train/gcvae/svae`, each with Snakemake's reason."""
    run = snakemake(project, "all", "--dry-run", "--configfile", *configs)
    assert run.returncode == 0, run.stderr[-2000:]
    found: dict[str, str] = {}
    kinds = "collect_data|train|evaluate|sample_model"
    log = re.compile(rf"^    log: .*?/logs/((?:{kinds})/[\w/]+|\w+)|^(?:local)?rule (all):", re.M)
    for job in re.split(r"^(?=(?:local)?rule \w+:$)", run.stdout + run.stderr, flags=re.M)[1:]:
        name = log.search(job)
        reason = re.search(r"^    reason: (.*)$", job, re.M)
        found[name[1] or name[2]] = reason[1]
    return found


@pytest.fixture
def planned(finished):
    """planned(where): the rules that run after a change there, each with Snakemake's reason."""
    changed = []

    def plan(where: str) -> dict[str, str]:
        name, text = changed_text(where)
        path = finished / "src/drapeline" / name
        changed.append((path, path.read_text()))
        path.write_text(text)
        return planned_jobs(finished, CONFIG)

    yield plan
    for path, text in changed:
        path.write_text(text)


def as_without_flags(project: Path, *arguments: str) -> str:
    """What Snakemake says in a folder where it finds its default profile by itself."""
    flags = ["--configfile", CONFIG, "--workflow-profile", str(project / "profiles/default")]
    run = snakemake(project, "all", *flags, *arguments)
    assert run.returncode == 0, run.stderr[-2000:]
    return run.stdout + run.stderr


def test_a_project_that_was_copied_with_its_times_has_nothing_to_do(finished, tmp_path):
    project = shutil.copytree(finished, tmp_path / "copy")
    for folder in ("scripts", "src", "workflow/rules"):  # as another checkout of the same code
        for path in (project / folder).rglob("*"):
            path.touch()
    assert "Nothing to be done" in as_without_flags(project, "--dry-run")


def test_a_project_that_was_copied_without_its_times_is_told_that_it_is_finished(
    finished, tmp_path
):
    project = shutil.copytree(finished, tmp_path / "copy", copy_function=shutil.copyfile)
    for folder in (project / "results/tiny").rglob(".snakemake_timestamp"):
        folder.touch()
    assert "Nothing to be done" not in as_without_flags(project, "--dry-run")
    as_without_flags(project, "--touch", "--cores", "1")
    assert "Nothing to be done" in as_without_flags(project, "--dry-run")


@pytest.mark.parametrize("profile", PROFILES, ids=lambda path: path.parent.name)
def test_all_profiles_rerun_by_digests_of_the_code_and_not_by_times_of_scripts(profile):
    lines = profile.read_text().splitlines()
    assert "rerun-triggers: [input, mtime, params]" in lines
    assert "rerun-incomplete: true" in lines


def test_every_rule_that_makes_something_has_a_digest_of_its_code():
    text = "\n".join(path.read_text() for path in (ROOT / "workflow/rules").glob("*.smk"))
    for block in re.split(r"^(?= *rule(?: \w+)?:$)", text, flags=re.MULTILINE)[1:]:
        script = re.search(r'"../../scripts/(\w+)\.py"', block)
        if script and "    output:" in block:
            named = re.search(rf'code=(source|solver)_hash\(\s*"{script[1]}"', block)
            others = ("code=outfits_hash", "code=task_code", "code=task_digest(figure.task)")
            assert named or any(code in block for code in others), block.split(":")[0]


def test_what_follows_a_change_leaves_other_work_alone(planned):
    jobs = planned("drapeline.models.gcvae.ppca:StaticPpca")
    # Of a job that runs in any case since its input is new, Snakemake gives that reason alone.
    changed = {rule for rule, reason in jobs.items() if "Params have changed" in reason}
    assert changed
    assert all("Input files updated" in jobs[rule] for rule in jobs.keys() - changed)
    assert {"train/gcvae/static_ppca", "evaluate/gcvae/evaluated/static_ppca"} <= jobs.keys()
    assert jobs.keys().isdisjoint({"train/gcvae/svae", "simulate_outfits"})
    assert not any(name.startswith("train/garment4d/") for name in jobs)


def test_a_page_of_the_report_is_made_alone(planned):
    pages = {"plot_health", "plot_time", "all"}
    assert planned("drapeline.report.dataset.health:write_health_page").keys() == pages


@pytest.fixture
def planned_with(finished, tmp_path):
    """planned_with(settings): the rules that run with other settings, each with its reason."""

    def plan(**settings) -> dict[str, str]:
        (tmp_path / "mine.yaml").write_text(yaml.safe_dump(settings))
        return planned_jobs(finished, CONFIG, str(tmp_path / "mine.yaml"))

    return plan


def test_outfits_that_are_to_hang_are_made_anew(planned_with):
    jobs = planned_with(groups={"static": {"outfits": {"hang_frames": 3}}})
    assert "Params have changed" in jobs["make_outfits"]
    assert jobs.keys().isdisjoint({"animate_bodies", "simulate_outfits", "write_samples"})


def test_another_bound_judges_anew_and_simulates_nothing_that_is_there(planned_with):
    jobs = planned_with(simulation={"bounds": {"slip_m": 0.7}})
    assert "Params have changed" in jobs["write_samples"]
    assert jobs.keys().isdisjoint({"animate_bodies", "make_outfits", "simulate_outfits"})


def test_models_are_trained_once_more_on_the_same_samples(planned_with):
    jobs = planned_with(model_seed=2)
    for model in ("gcvae", "garment4d", "smplicit"):
        assert any(name.startswith(f"train/{model}/") for name in jobs)
    assert not any(name.startswith("collect_data/") for name in jobs)
    assert jobs.keys().isdisjoint(
        {"animate_bodies", "make_outfits", "simulate_outfits", "write_samples", "sample_clouds"}
    )


def jobs_of_samples(project: Path, *configs: str) -> dict[str, int]:
    """How many jobs of the steps of samples run."""
    run = snakemake(project, "all", "--dry-run", "--configfile", *configs)
    assert run.returncode == 0, run.stderr[-2000:]
    counts = dict(re.findall(r"^(\w+) +(\d+)$", run.stdout + run.stderr, re.MULTILINE))
    steps = ("animate_bodies", "make_outfits", "simulate_outfits", "write_samples", "sample_fields")
    return {step: int(counts[step]) for step in steps if step in counts}


def test_one_sample_more_makes_itself_alone(finished, tmp_path):
    more = {"dataset": {"count": 4}, "learning": {"count": 7}, "static": {"count": 25}}
    (tmp_path / "more.yaml").write_text(yaml.safe_dump({"groups": more}))
    # Their shards are full, so that each has a shard of its own.
    assert jobs_of_samples(finished, CONFIG, str(tmp_path / "more.yaml")) == {
        **dict.fromkeys(("animate_bodies", "simulate_outfits", "write_samples"), 2),
        "make_outfits": 3,
        "sample_fields": 1,
    }
