"""Run a rule's script file exactly as Snakemake would, with a stand-in job object."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

from drapeline.models.smplicit.model import SmplicitModel
from toys.gallery import TubeField, save_toy_model, training_codes
from toys.threads import THREADS

SCRIPTS = Path(__file__).parents[2] / "scripts"


class Named(list):
    """Files of a job: by position and by name, as Snakemake's own; a name may have a list."""

    def __init__(self, *files, **named):
        self._named = {
            name: [*map(str, path)] if isinstance(path, list) else str(path)
            for name, path in named.items()
        }
        super().__init__(map(str, files))
        for path in self._named.values():
            self.extend(path if isinstance(path, list) else [path])

    def __getattr__(self, name):
        try:
            return self._named[name]
        except KeyError:
            raise AttributeError(name) from None

    def __getitem__(self, key):
        return self._named[key] if isinstance(key, str) else super().__getitem__(key)

    def get(self, name, default=None):
        return self._named.get(name, default)


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
