"""tests/unit mirrors src/drapeline: every module has a test file of its own or a named one."""

import re
from pathlib import Path

import pytest

from imported_modules import imported_modules

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
    "bodies/bake_surface": "unit/bodies/test_bake.py",
    "bodies/parts": "unit/bodies/test_self_collision.py",
    "bodies/placement": "unit/bodies/test_sequence.py",
    "bodies/rest_body": "unit/outfits/test_fit.py",
    "bodies/sampling": "unit/bodies/test_sequence.py",
    "bodies/skinning": "unit/bodies/test_kinematics.py",
    "errors": "unit/test_rule_log.py",
    "learning_data/dynamic": "rules/test_evaluate_dynamic.py",
    "learning_data/moving": "unit/metrics/test_dynamic.py",
    "learning_data/vertex_moments": "unit/learning_data/test_static.py",
    "metrics/predictions": "unit/report/models/test_gcvae_figures.py",
    "models/gcvae/train_conditioning": "unit/models/gcvae/test_vae.py",
    "models/gcvae/settings": "unit/models/gcvae/test_vae.py",
    "models/gcvae/static_template": "rules/test_train_svae.py",
    "models/gcvae/dynamic_template": "rules/test_train_dvae.py",
    "models/gcvae/evaluate_dynamic": "rules/test_evaluate_dynamic.py",
    "models/gcvae/dynamic_garments": "rules/test_evaluate_dynamic.py",
    "models/gcvae/load": "unit/models/gcvae/test_vae.py",
    "models/gcvae/train": "unit/models/gcvae/test_vae.py",
    "models/training/module": "unit/models/training/test_lightning.py",
    "motions/deepmimic": "unit/motions/test_clips.py",
    "motions/grounding": "unit/motions/test_floor.py",
    "outfits/distributions": "unit/outfits/patterns/test_cutting.py",
    "outfits/patterns/curves": "unit/outfits/patterns/test_width_profile.py",
    "outfits/static_plan": "unit/outfits/test_static.py",
    "outfits/templates": "unit/outfits/test_outfit.py",
    "registration/to_body/inner_legs": "unit/registration/to_body/test_topology.py",
    "registration/to_body/registrar": "unit/registration/to_body/test_skirt_tube.py",
    "registration/to_body/samples": "rules/test_register_sample.py",
    "registration/to_body/segments": "unit/registration/to_body/test_hierarchy.py",
    "registration/to_template/front_opening": "unit/registration/to_template/test_template_fit.py",
    "registration/to_template/remesh": "unit/registration/to_template/test_garment_template.py",
    "rendering/camera": "unit/rendering/test_modalities.py",
    "rendering/contact_sheet": "unit/report/dataset/test_gallery.py",
    "report/dataset/records": "unit/report/dataset/test_statistics.py",
    "report/registration/hierarchy_sheet": "rules/test_build_hierarchy.py",
    "report/registration/registration_table": "rules/test_make_static_outfits.py",
    "simulation/solver": "unit/simulation/test_simulate.py",
}

# Modules that no test file imports: to be tested or removed.
UNTESTED = {
    "geometry/closest",
    "geometry/sparse",
    "models/compare",
    "models/gcvae/posed_points",
    "models/gcvae/refiner",
    "outfits/patterns/lower",
    "outfits/patterns/panels",
    "outfits/patterns/separation",
    "outfits/patterns/upper",
    "outfits/settling",
    "report/registration/registration_sheet",
    "report/style",
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
    if module not in COVERED_BY and module not in UNTESTED:
        wanted = mirrored_test(module).relative_to(ROOT)
        assert mirrored_test(module).is_file(), f"no {wanted}, and COVERED_BY names none"


@pytest.mark.parametrize(("module", "test"), COVERED_BY.items())
def test_a_named_test_file_covers_the_module(module, test):
    assert f"drapeline.{module.replace('/', '.')}" in modules_covered_by(TESTS / test)


@pytest.mark.parametrize("module", [*COVERED_BY, *UNTESTED])
def test_exceptions_are_needed(module):
    assert module in MODULES, f"{module} is no module"
    assert not mirrored_test(module).is_file(), f"{module} has a test file of its own"
