"""Every model fulfils the contract of `models.registry` and `models.contract`."""

import importlib
import inspect
import json
import sys
from importlib.metadata import EntryPoint
from types import SimpleNamespace

import pytest
import yaml

from drapeline.dataset.settings import CLEAN
from drapeline.errors import InputError
from drapeline.job import resolve
from drapeline.models import compare, contract, protocol, registry
from drapeline.models.compare import SCANNED
from drapeline.models.registry import (
    REPRESENTATIONS,
    SCAN_EVALUATIONS,
    SCANS,
    SYSTEMS,
    Model,
    ModelPlan,
    models,
)
from drapeline.settings import Settings
from toys.imported_modules import imported_modules, loaded_modules
from toys.plans import files_of, tasks_of
from toys.schema import SCHEMA
from toys.snakemake_run import ROOT

MODELS = list(models())


@pytest.fixture(scope="module", params=MODELS)
def plan(request):
    return models()[request.param].plan(files_of())


def test_what_tasks_run_and_what_loads_models_is_there(plan):
    for task in tasks_of(plan).values():
        assert callable(resolve(task.run))
    for model in models().values():
        for loader in model.loaders.values():
            assert isinstance(resolve(loader), type)


def test_tasks_ask_for_what_jobs_can_be_given(plan):
    kinds = (plan.data, plan.trainings, plan.evaluations, plan.samples)
    assert len({name for kind in kinds for name in kind}) == sum(map(len, kinds))
    for task in tasks_of(plan).values():
        json.dumps(dict(task.params))
        assert (ROOT / f"envs/{task.environment}.yaml").is_file()
        assert task.seconds > 0
        assert task.megabytes > 0
        assert not {"get", "index", "items", "keys", "sort"} & set(task.input)  # of any list


def test_a_model_trains_and_is_evaluated_and_compared(plan):
    assert plan.trainings
    tables = {table for evaluation in plan.evaluations.values() for table in evaluation.tables}
    assert {"metrics", REPRESENTATIONS, SCANS, SYSTEMS} <= tables
    assert plan.evaluations["evaluated/representations"].tables == (REPRESENTATIONS, SYSTEMS)


def test_all_models_are_fitted_to_the_same_scans_and_move_the_same_garments(plan):
    files = files_of()
    asked = {**SCAN_EVALUATIONS, "moved": (CLEAN, SYSTEMS)}
    for name, (kind, table) in asked.items():
        evaluation = plan.evaluations[f"evaluated/{name}"]
        assert evaluation.tables == (table,)
        for key, expected in files.known_scans(kind).items():
            assert evaluation.task.input[key] == expected != []
        for key, expected in files.compared.items():
            assert evaluation.task.params[key] == expected
        if name != "moved":
            assert evaluation.task.params["kind"] == kind
            assert kind in SCANNED


def test_without_scans_nothing_is_asked_about_them():
    config = yaml.safe_load((ROOT / "config.yaml").read_text())
    files = files_of({**config, "scans": {"count": 0}})
    for model in models().values():
        evaluations = model.plan(files).evaluations
        for name in (*SCAN_EVALUATIONS, "moved", "moved_again"):
            assert f"evaluated/{name}" not in evaluations


def test_pages_and_pictures_have_captions(plan):
    for figure in plan.figures.values():
        for shown in figure.output.values():
            if not isinstance(shown, str):
                assert (ROOT / f"workflow/report/{shown.caption}.rst").is_file()


@pytest.mark.parametrize("model", MODELS)
def test_a_model_has_its_block_of_the_schema(model):
    assert model in SCHEMA["properties"]


def test_plans_load_nothing_that_takes_long():
    loaded = loaded_modules("from drapeline.models.registry import models\nmodels()")
    assert not loaded & {"torch", "bpy", "warp", "trimesh", "pandas", "matplotlib", "snakemake"}


def test_two_models_of_one_name_and_one_that_is_missing_are_refused(monkeypatch):
    twin = Model("gcvae", "Twin", Settings, lambda files: ModelPlan(), {})

    def add(value):
        point = EntryPoint("twin", value, registry.ENTRY_POINTS)
        monkeypatch.setattr(registry, "entry_points", lambda group: [point])

    monkeypatch.setitem(sys.modules, "twins", SimpleNamespace(MODEL=twin))
    add("twins:MODEL")
    with pytest.raises(InputError, match="two models are called 'gcvae'"):
        models.__wrapped__()
    add("nowhere.plan:MODEL")
    with pytest.raises(InputError, match="nowhere.plan:MODEL: cannot be imported"):
        models.__wrapped__()


def test_a_function_that_is_not_there_is_named():
    for name, reason in (("nowhere:train", "cannot be imported"), ("job:train", "no such name")):
        with pytest.raises(InputError, match=f"drapeline.{name}: {reason}"):
            resolve(f"drapeline.{name}")


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


FULFIL = {
    contract.Mover: {
        "gcvae.representation:LearnedMover",
        "garment4d.scans:InterpolatedMover",
        "smplicit.scans.evaluate:SkinningMover",
    },
    contract.ScanFitter: {
        "gcvae.representation:CodeScanFitter",
        "garment4d.scans:Garment4dScanFitter",
        "smplicit.scans.evaluate:SmplicitScanFitter",
    },
}


@pytest.mark.parametrize(
    ("wanted", "name"), [(one, name) for one, names in FULFIL.items() for name in sorted(names)]
)
def test_what_finds_and_moves_garments_fulfils_its_protocol(wanted, name):
    found = resolve(f"drapeline.models.{name}")
    (method,) = (one for one in ("move", "fit") if hasattr(wanted, one))
    own, theirs = (inspect.signature(getattr(one, method)) for one in (found, wanted))
    assert own.parameters == theirs.parameters


@pytest.mark.parametrize("shared", [contract, compare, protocol])
def test_the_comparison_names_no_model(shared):
    imported = set(imported_modules(inspect.getsource(shared)))
    assert not any(f"models.{model}" in name for name in imported for model in MODELS)
