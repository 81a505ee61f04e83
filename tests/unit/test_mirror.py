"""tests/unit mirrors src/drapeline: every module has a test file of its own or a named one."""

import re
from pathlib import Path

import pytest

from toys.imported_modules import imported_modules

TESTS = Path(__file__).parents[1]
ROOT = TESTS.parent
SOURCE = ROOT / "src" / "drapeline"
MODULES = sorted(
    str(path.relative_to(SOURCE).with_suffix(""))
    for path in SOURCE.rglob("*.py")
    if path.name != "__init__.py"
)

# Modules that the tests of another one, or of a rule, cover.
COVERED_BY = {
    "generation/body": "rules/test_body_rules.py",
    "generation/outfit": "rules/test_outfit_rules.py",
    "generation/sample": "rules/test_learning_samples.py",
    "generation/settled": "rules/test_make_static_outfits.py",
    "dataset/tables": "unit/dataset/test_collect.py",
    "metrics/garment4d": "unit/metrics/test_registry.py",
    "metrics/gcvae": "unit/metrics/test_registry.py",
    "metrics/metric": "unit/metrics/test_registry.py",
    "metrics/predictions": "unit/report/models/gcvae/test_views.py",
    "metrics/shared": "unit/metrics/test_registry.py",
    "metrics/smplicit": "unit/metrics/test_registry.py",
    "models/garment4d/scans": "rules/test_garment4d.py",
    "models/gcvae/evaluate_dynamic": "rules/test_evaluate_dynamic.py",
    "models/gcvae/static_model": "rules/test_train_svae.py",
    "models/gcvae/static_template": "rules/test_train_svae.py",
    "models/gcvae/truth": "unit/models/gcvae/test_evaluate_static.py",
    "models/smplicit/figure_cases": "rules/test_smplicit.py",
    "models/smplicit/scan_fitter": "rules/test_smplicit_scans.py",
    "motions/pieces": "unit/motions/test_variation.py",
    "registration/to_body/samples": "rules/test_register_sample.py",
    "registration/worn_garments": "unit/registration/test_to_points.py",
    "report/registration_sheets": "rules/test_build_hierarchy.py",
    "simulation/solver": "unit/simulation/test_simulate.py",
}


def mirrored_test(module: str) -> Path:
    folder, _, name = module.rpartition("/")
    return TESTS / "unit" / folder / f"test_{name}.py"


def modules_covered_by(path: Path) -> set[str]:
    """What a test file imports, and what the scripts import whose rules it runs."""
    text = path.read_text()
    found = set(imported_modules(text))
    for rule in re.findall(r'run_rule\(\s*"(\w+)"', text):
        found |= set(imported_modules((ROOT / "scripts" / f"{rule}.py").read_text()))
    return found


@pytest.mark.parametrize("module", MODULES)
def test_every_module_has_a_test_file(module):
    if module not in COVERED_BY:
        wanted = mirrored_test(module).relative_to(ROOT)
        assert mirrored_test(module).is_file(), f"no {wanted}, and COVERED_BY names none"


@pytest.mark.parametrize(("module", "test"), COVERED_BY.items())
def test_a_named_test_file_covers_the_module(module, test):
    assert f"drapeline.{module.replace('/', '.')}" in modules_covered_by(TESTS / test)


@pytest.mark.parametrize("module", COVERED_BY)
def test_exceptions_are_needed(module):
    assert module in MODULES, f"{module} is no module"
    assert not mirrored_test(module).is_file(), f"{module} has a test file of its own"
