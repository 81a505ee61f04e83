"""Which rules run again when a file of the library changes: no more than need to.

An import too many makes hours of simulation or training run again for nothing. When a test here
fails, ask what the module needs of the new import; most often that fits a module of its own.
"""

import re
import shutil
from pathlib import Path

import pytest

from drapeline.experiment.source_digest import Sources
from toys.cloth_solvers import cloth_solvers
from toys.snakemake_run import ROOT, copy_project, snakemake

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
PROFILES = [
    ROOT / "profiles/default/config.yaml",
    *sorted((ROOT / "workflow/profiles").glob("*/config.yaml")),
]
NAMED = {
    "simulate_outfit": [cloth_solvers()["blender"][0]],
    "simulate_learning": [cloth_solvers()["xpbd"][0]],
}
# What a trained garment VAE of either kind decodes garments for, and what Garment4D trains.
USE_SVAE = {
    *("compare_gcvae", "evaluate_static", "plot_gcvae_errors", "plot_gcvae_walks"),
    *("plot_gcvae_wrinkles", "sample_garments", "evaluate_scans_gcvae"),
}
TRAIN_DVAE = {"train_dvae_conditioning", "train_dvae"}
TRAIN_GARMENT4D = {"train_garment4d_canonical", "train_garment4d_posed"}
GALLERY = {"make_smplicit_gallery", "plot_smplicit_gallery", "pose_smplicit_garment"}
FIT_IMAGES = {"fit_picture", "evaluate_images"}
TRAIN_DISPLACEMENT = {"train_displacement", "evaluate_displacement"}
USE_DISPLACEMENT = {"evaluate_displacement", "pose_smplicit_garment"}
USE_GARMENT4D = {"evaluate_garment4d", "reconstruct_garment", "evaluate_scans_garment4d"}
FIT_SCANS = {"evaluate_scans_smplicit", "fit_own_scans"}
USE_SMPLICIT = {"evaluate_smplicit", "plot_smplicit"} | GALLERY | FIT_IMAGES | FIT_SCANS
SIMULATE = {"simulate_outfit", "simulate_learning"}
MAKE_GARMENTS = {
    *("make_garment_template", "make_outfit", "make_static_outfits", "simulate_learning"),
}
REGISTER_SAMPLES = {"register_sample", "register_learning"}
REGISTER_TO_BODY = REGISTER_SAMPLES | {"register_static", "plot_registration"}
FIT_TEMPLATES = {"fit_sample_templates", "fit_static_templates", "fit_learning_templates"}
IMPORT_MOTIONS = {"import_motion", "import_learning_motions"}
ANIMATE = {"animate_body", "simulate_learning"}
HANG = FIT_IMAGES | FIT_SCANS | {"pose_smplicit_garment"}
# File -> the rules whose code it is part of. Rules that read their results follow.
RERUN = {
    "motions/retarget.py": IMPORT_MOTIONS,
    "motions/motion.py": IMPORT_MOTIONS | ANIMATE,
    "motions/variation.py": ANIMATE,
    "generation/sample.py": {"simulate_learning"},
    "bodies/bake.py": {"bake_body"},
    "bodies/self_collision.py": ANIMATE | HANG,
    "generation/moving_sheets.py": HANG,
    "bodies/sampling.py": ANIMATE | {"make_static_outfits"},
    "bodies/weight_transfer.py": {
        *("collect_garment4d", "evaluate_garment4d", "plot_skinning", "reconstruct_garment"),
        *(
            "register_learning",
            "register_sample",
            "skin_static",
            "train_garment4d_posed",
            "evaluate_scans_garment4d",
        ),
    }
    | {"pose_smplicit_garment", "collect_displacements"}
    | TRAIN_DISPLACEMENT,
    "outfits/patterns/upper.py": {"build_templates"} | MAKE_GARMENTS,
    "outfits/generate.py": MAKE_GARMENTS,
    "outfits/fabrics.py": MAKE_GARMENTS | SIMULATE | HANG,
    "outfits/generate_static.py": {"make_static_outfits"},
    "simulation/simulate.py": SIMULATE | HANG,
    "blender/cloth.py": {"simulate_outfit"},
    "xpbd/stepping.py": {"simulate_learning"} | HANG,
    "dataset/writer.py": {"write_sample", "simulate_learning", "reconstruct_garment"},
    "dataset/card.py": {"collect_dataset"},
    "dataset/gltf.py": {
        *("export_sample", "export_reconstructed", "sample_garments", "plot_gcvae_samples"),
        *GALLERY,
    },
    "registration/to_body/nicp.py": REGISTER_TO_BODY,
    "registration/to_body/samples.py": REGISTER_SAMPLES,
    "registration/to_template/make_template.py": {"make_garment_template"},
    "registration/to_template/template_fit.py": FIT_TEMPLATES,
    "learning_data/skinned.py": {"skin_static", "collect_garment4d"},
    "learning_data/sequences.py": TRAIN_GARMENT4D
    | USE_GARMENT4D
    | {"collect_garment4d", "plot_skinning"},
    "learning_data/dynamic.py": TRAIN_DVAE
    | {"collect_dynamic", "evaluate_dynamic", "fit_dynamic_ppca"}
    | {"plot_gcvae_errors", "plot_gcvae_wrinkles"},
    "metrics/baselines.py": {"evaluate_baselines", "compare_gcvae"},
    "metrics/dynamic.py": {"evaluate_dynamic", "evaluate_dynamic_baselines"},
    "models/contract.py": {
        *("compare_gcvae", "compare_garment4d", "compare_smplicit", "evaluate_scans_gcvae"),
        *("evaluate_scans_garment4d", "evaluate_scans_smplicit"),
    },
    "models/gcvae/train.py": {"train_svae", "train_dvae"},
    "models/gcvae/static_model.py": set(),
    "models/load.py": set(),
    # A new variant is trained, and nothing else: the rules hand its settings on.
    "models/gcvae/variants.py": set(),
    "models/garment4d/variants.py": set(),
    "models/gcvae/train_conditioning.py": {"train_svae_conditioning", "train_dvae_conditioning"},
    # A dynamic model takes codes of a static one, which may be of either kind.
    "models/gcvae/garment_ppca.py": {"fit_static_ppca", "fit_dynamic_ppca", "evaluate_dynamic"}
    | TRAIN_DVAE
    | USE_SVAE,
    "models/gcvae/evaluate_dynamic.py": {"evaluate_dynamic"},
    "models/garment4d/canonical_stage.py": TRAIN_GARMENT4D | USE_GARMENT4D,
    "models/garment4d/posed_stage.py": {"train_garment4d_posed"} | USE_GARMENT4D,
    "models/garment4d/evaluate.py": {"evaluate_garment4d"},
    "registration/to_points.py": USE_GARMENT4D | FIT_SCANS | {"evaluate_scans_gcvae"},
    "models/smplicit/train.py": {"train_smplicit"},
    "models/smplicit/decoder.py": {"train_smplicit", "train_displacement", "evaluate_displacement"}
    | USE_SMPLICIT,
    "models/smplicit/train_displacement.py": {"train_displacement"},
    "models/smplicit/displacement_network.py": {"train_displacement"} | USE_DISPLACEMENT,
    "models/smplicit/displacement_baselines.py": {"evaluate_displacement"},
    "models/smplicit/evaluate_displacement.py": {"evaluate_displacement"},
    "learning_data/pose_displacements.py": {"collect_displacements", "train_displacement"}
    | USE_DISPLACEMENT,
    "models/smplicit/sheet.py": USE_SMPLICIT,
    "models/smplicit/fit_images.py": FIT_IMAGES | FIT_SCANS,
    "models/smplicit/hanging.py": FIT_IMAGES | FIT_SCANS,
    "models/smplicit/fit_scans.py": FIT_SCANS,
    "bodies/scan_fit.py": FIT_SCANS | {"scan_sample", "scan_learning"},
    "models/compare_scans.py": {
        *("evaluate_scans_gcvae", "evaluate_scans_garment4d", "evaluate_scans_smplicit"),
    },
    "models/smplicit/fitting.py": set(),
    "models/smplicit/evaluate_images.py": {"evaluate_images"},
    "learning_data/occlusion.py": {"sample_fields", "collect_fields"}
    | {"train_smplicit"}
    | TRAIN_DISPLACEMENT
    | USE_SMPLICIT,
    "models/training/lightning.py": {"train_svae", "train_svae_conditioning", "train_smplicit"}
    | {"train_displacement"}
    | TRAIN_DVAE
    | TRAIN_GARMENT4D,
    "rendering/modalities.py": FIT_IMAGES
    | FIT_SCANS
    | {"render_modalities", "plot_fit_images", "plot_fitted_picture"},
    "report/dataset/gallery.py": {"render_gallery", "plot_learning"},
    "report/dataset/viewer.py": {"view_sample", "view_example"},
    "report/registration/registration_sheet.py": {"plot_registration"},
    "report/models/gcvae/codes.py": {"plot_gcvae_codes"},
    "report/models/garment4d/curves.py": {"plot_garment4d_curves"},
    "report/models/representations.py": {"tabulate_representations"},
    "report/times.py": {"plot_time"},
}


@pytest.fixture(scope="module")
def files():
    """Rule -> files of the library that its job's code consists of."""
    return {
        rule: {
            str(path.relative_to(LIBRARY))
            for path in SOURCES.imported_files(
                ROOT / "scripts" / f"{script}.py", *NAMED.get(script, [])
            )
        }
        for rule, script in SCRIPTS.items()
    }


@pytest.mark.parametrize("file", RERUN)
def test_a_change_reaches_exactly_these_rules(files, file):
    assert (LIBRARY / file).is_file()
    assert {rule for rule, own in files.items() if file in own} == RERUN[file]


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


def planned_jobs(project: Path, *configs: str) -> dict[str, str]:
    """The rules that run, each with Snakemake's reason."""
    run = snakemake(project, "all", "--dry-run", "--configfile", *configs)
    assert run.returncode == 0, run.stderr[-2000:]
    text = run.stdout + run.stderr
    return dict(re.findall(r"^(?:local)?rule (\w+):\n(?:    .*\n)*?    reason: (.*)$", text, re.M))


@pytest.fixture
def planned(finished):
    """planned(file): the rules that run after a change of it, each with Snakemake's reason."""
    changed = []

    def plan(file: str) -> dict[str, str]:
        path = finished / "src/drapeline" / file
        changed.append((path, path.read_text()))
        path.write_text(path.read_text() + "\nADDED = 1\n")
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
    for block in re.split(r"^(?=rule \w+:$)", text, flags=re.MULTILINE)[1:]:
        script = re.search(r'"../../scripts/(\w+)\.py"', block)
        if script and "    output:" in block:
            assert re.search(rf'code=source_hash\(\s*"{script[1]}"', block), block.split(":")[0]


def rules_of(file: Path) -> set[str]:
    return set(re.findall(r"^rule (\w+):", file.read_text(), re.MULTILINE))


GARMENT4D = rules_of(ROOT / "workflow/rules/garment4d.smk")


@pytest.mark.parametrize(
    ("file", "never"),
    [
        (
            "models/gcvae/garment_ppca.py",
            GARMENT4D | {"train_svae", "train_svae_conditioning", "register_static"},
        ),
        (
            "registration/to_body/nicp.py",
            # All models are compared on garments that could be registered to the body.
            GARMENT4D - {"compare_garment4d"}
            | {"simulate_outfit", "build_super_body", "sample_clouds"},
        ),
    ],
)
def test_what_follows_a_change_leaves_other_work_alone(planned, file, never):
    jobs = planned(file)
    # Of a job that runs in any case since its input is new, Snakemake gives that reason alone.
    changed = {rule for rule, reason in jobs.items() if "Params have changed" in reason}
    assert changed
    assert changed <= RERUN[file]
    assert all("Input files updated" in jobs[rule] for rule in jobs.keys() - changed)
    assert RERUN[file] <= jobs.keys()
    assert not jobs.keys() & never


def test_a_module_of_the_report_makes_its_page_and_the_overview_alone(planned):
    pages = {"plot_health", "write_overview", "plot_time"}
    assert planned("report/dataset/health.py").keys() == {*pages, "all"}


def test_outfits_that_are_to_settle_are_made_anew(finished, tmp_path):
    (tmp_path / "settle.yaml").write_text("static: {settle_frames: 3}")
    jobs = planned_jobs(finished, CONFIG, str(tmp_path / "settle.yaml"))
    assert "Params have changed" in jobs["make_static_outfits"]
    assert jobs.keys().isdisjoint({"make_outfit", "simulate_outfit", "simulate_learning"})
