"""The models that an experiment has: those that come along, and those of other packages.

Another package adds a model by an entry point of the group `drapeline.models`, which names a
`Model`:

    [project.entry-points."drapeline.models"]
    mine = "mine.plan:MODEL"
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from drapeline.dataset.settings import CLEAN, NOISY, WORSE
from drapeline.errors import InputError
from drapeline.job import resolve
from drapeline.settings import Settings

if TYPE_CHECKING:  # jobs know what is declared here, and nothing of experiments
    from drapeline.experiment.files import ExperimentFiles

ENTRY_POINTS = "drapeline.models"
_OURS = ("gcvae", "garment4d", "smplicit")
# Tables of metrics that compare all models.
REPRESENTATIONS, SCANS, SYSTEMS = "representations", "scans", "systems"
# Table of the models that come with drapeline, and of what their cards compare them with.
PACKAGED = "packaged"
# Sizes at which codes are compared besides their own: SMPLicit's and CLOTH3D's, and one between.
CODE_SIZES = 18, 64, 128
# Folder of an evaluation that a model has -> kind of scans, and the table of its rows.
SCAN_EVALUATIONS = {
    "scans": (NOISY, SCANS),
    "clean_scans": (CLEAN, SYSTEMS),
    "worse_scans": (WORSE, SYSTEMS),
}


class Task(NamedTuple):
    """What one job of a model does.

    Attributes:
        run: `package.module:function`, which takes a `drapeline.job.Job`; another code of it makes
            the job run again.
        input: files by name.
        params: what else the function is told, JSON values; others make the job run again.
        seconds, megabytes: that it takes, for clusters.
        checks: raise an `InputError` where the experiment's plan is not enough for the task.
        modules: that the function imports by names which it is told.
        environment: file of `envs/` without its suffix.
        parallel: whether it has use for more than one thread.
        gpus: to ask a cluster for.
    """

    run: str
    input: Mapping[str, str | Sequence[str]]
    params: Mapping[str, Any]
    seconds: float
    megabytes: float
    checks: Sequence[Callable[[], None]] = ()
    modules: Sequence[str] = ()
    environment: str = "train"
    parallel: bool = False
    gpus: int = 0


class EvaluationTask(NamedTuple):
    """A task that leaves a folder with `metrics.tsv`, and whatever its figures are drawn from.

    Attributes:
        task: measures.
        tables: of metrics that its rows belong to: "metrics" is shown by default,
            `REPRESENTATIONS`, `SCANS` and `SYSTEMS` compare all models.
    """

    task: Task
    tables: Sequence[str]


class ReportFile(NamedTuple):
    """A page or picture of the report.

    Attributes:
        file: its name in the folder `report` of the results.
        title: says what it shows.
        caption: reStructuredText file without its suffix, in `workflow/report/` or with its path.
    """

    file: str
    title: str
    caption: str


class Figure(NamedTuple):
    """A task that draws pages or pictures of the report.

    Attributes:
        task: draws.
        output: name -> what is drawn; a bare file is made beside the report's.
        default: whether every experiment has it.
    """

    task: Task
    output: Mapping[str, ReportFile | str]
    default: bool = True


def figure(
    run: str,
    given: Mapping[str, str | Sequence[str]],
    told: Mapping[str, Any],
    *,
    seconds: float = 600,
    megabytes: float = 2000,
    environment: str = "train",
    checks: Sequence[Callable[[], None]] = (),
    modules: Sequence[str] = (),
    default: bool = True,
    **output: ReportFile | str,
) -> Figure:
    """A `Figure` from the parts of its task."""
    task = Task(run, given, told, seconds, megabytes, checks, modules, environment)
    return Figure(task, output, default)


def page(
    run: str,
    given: Mapping[str, str | Sequence[str]],
    told: Mapping[str, Any],
    *,
    default: bool = True,
    **output: ReportFile | str,
) -> Figure:
    """The same of tables and curves, which take hardly anything."""
    task = Task(run, given, told, seconds=60, megabytes=300, environment="report")
    return Figure(task, output, default)


class Package(NamedTuple):
    """A trained model that comes with drapeline.

    Attributes:
        folder: of its training.
        title: says what it does.
        use: a line of Python, in which `model` is the loaded one.
        models: of its rows in the table of metrics.
        variants: of the same, and of what it is compared with.
        metrics: of the same.
        garments: types that it knows.
    """

    folder: str
    title: str
    use: str
    models: Sequence[str]
    variants: Sequence[str]
    metrics: Sequence[str]
    garments: Sequence[str]


class ModelPlan(NamedTuple):
    """What an experiment does with a model, each task by the folder that it leaves.

    Folders are named within the model's own, `<results>/<model>/`.

    Attributes:
        data: collected for trainings.
        trainings: by any way of learning.
        evaluations: of what was trained, and of what it is compared with.
        samples: of what was trained.
        figures: by the names of their rules.
        targets: name of a rule that gathers more -> files.
        packages: what of it comes with drapeline, by the names that `drapeline.load` takes.
        priority: of its jobs where several models' could run.
    """

    data: Mapping[str, Task] = MappingProxyType({})
    trainings: Mapping[str, Task] = MappingProxyType({})
    evaluations: Mapping[str, EvaluationTask] = MappingProxyType({})
    samples: Mapping[str, Task] = MappingProxyType({})
    figures: Mapping[str, Figure] = MappingProxyType({})
    targets: Mapping[str, Sequence[str]] = MappingProxyType({})
    packages: Mapping[str, Package] = MappingProxyType({})
    priority: int = 0


class Model(NamedTuple):
    """A model as the rest of the project knows it.

    Attributes:
        name: of its block in a config, and of its folder of results.
        title: of its part of the report.
        settings: the block.
        plan: what an experiment does with it.
        loaders: `checkpoint_type` -> `package.module:class`, which takes the folder of a training.
    """

    name: str
    title: str
    settings: type[Settings]
    plan: Callable[["ExperimentFiles"], ModelPlan]
    loaders: Mapping[str, str]


@cache
def models() -> dict[str, Model]:
    """All models by name, ours first.

    Raises:
        InputError: two have one name, or one of another package cannot be imported.
    """
    ours = [resolve(f"drapeline.models.{name}.plan:MODEL") for name in _OURS]
    others = [resolve(point.value) for point in entry_points(group=ENTRY_POINTS)]
    found: dict[str, Model] = {}
    for model in (*ours, *others):
        if model.name in found:
            raise InputError(f"two models are called '{model.name}', expected names of their own")
        found[model.name] = model
    return found
