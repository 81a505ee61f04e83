"""Every model fulfils the contract of `models.contract`, and none knows another."""

import importlib
import inspect

import pytest

from drapeline.models import compare, contract
from toys.imported_modules import imported_modules
from toys.schema import SCHEMA
from toys.snakemake_run import ROOT

MODELS_FOLDER = ROOT / "src/drapeline/models"
SHARED = {"layers", "training"}
MODELS = sorted(
    path.name
    for path in MODELS_FOLDER.iterdir()
    if (path / "__init__.py").is_file() and path.name not in SHARED
)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("module", ["settings", "representation"])
def test_a_model_has_the_modules_of_the_contract(model, module):
    assert (MODELS_FOLDER / model / f"{module}.py").is_file()


@pytest.mark.parametrize("model", MODELS)
def test_a_model_has_its_rules_and_its_block_of_the_schema(model):
    rules = f"workflow/rules/{model}.smk"
    assert (ROOT / rules).is_file()
    assert f'include: "{rules}"\n' in (ROOT / "Snakefile").read_text()
    assert model in SCHEMA["properties"]


@pytest.mark.parametrize("model", MODELS)
def test_a_models_representations_fulfil_the_protocol(model):
    module = importlib.import_module(f"drapeline.models.{model}.representation")
    found = [
        cls for _, cls in inspect.getmembers(module, inspect.isclass) if hasattr(cls, "rebuild")
    ]
    assert found
    for cls in found:
        for name in ("rebuild", "code_numbers"):
            wanted = inspect.signature(getattr(contract.Representation, name))
            assert inspect.signature(getattr(cls, name)).parameters == wanted.parameters


@pytest.mark.parametrize("shared", [contract, compare])
def test_the_comparison_names_no_model(shared):
    imported = set(imported_modules(inspect.getsource(shared)))
    assert not any(f"models.{model}" in name for name in imported for model in MODELS)
