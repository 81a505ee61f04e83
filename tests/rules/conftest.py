"""Run a rule's script file exactly as Snakemake would, with a stand-in job object."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

from drapeline.models.smplicit.model import SmplicitModel
from toys.gallery import TubeField, save_toy_model, training_codes
from toys.jobs import Named
from toys.threads import THREADS

SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture(scope="session")
def run_rule(tmp_path_factory):
    """run_rule("make_outfit", input=..., output=..., params=..., wildcards=...)

    Of a model's task, run_rule("package.module:function", ...) with what it is told as params.
    """
    logs = tmp_path_factory.mktemp("logs")

    def run(rule, *, input=(), output=(), params=None, wildcards=None, threads=THREADS):
        def files(given):
            return Named(**given) if isinstance(given, dict) else Named(*given)

        script, params = rule, dict(params or {})
        if ":" in rule:
            own = {key: params.pop(key, "") for key in ("code", "progress")}
            script, params = "run_job", {"run": rule, "told": params, **own}
        job = SimpleNamespace(
            input=files(input),
            output=files(output),
            params=SimpleNamespace(**params),
            wildcards=SimpleNamespace(**(wildcards or {})),
            log=[str(logs / f"{script}.log")],
            scriptdir=str(SCRIPTS),
            threads=threads,
        )
        runpy.run_path(str(SCRIPTS / f"{script}.py"), {"snakemake": job}, "__main__")
        return job

    return run


@pytest.fixture(scope="module")
def skirt(tmp_path_factory, toy_body):
    """Folder of a model of SMPLicit whose fields are those of tubes."""
    folder = tmp_path_factory.mktemp("models") / "skirt"
    save_toy_model(folder, toy_body, training_codes())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SmplicitModel, "field", lambda self, z, *, gender, shape: TubeField(z))
        yield folder
