# The models' plans, and what the rules of their tasks ask of them.
for unknown in [
    f"groups.{group}.learned_by names '{name}', expected some of {', '.join(MODELS)}"
    for group, settings in config["groups"].items()
    for name in settings["learned_by"] or ()
    if name not in MODELS
]:
    raise WorkflowError(unknown)
PLANS = {name: model.plan(FILES.learned_by(name)) for name, model in MODELS.items()}
FIGURES = {
    name: (model, figure)
    for model, plan in PLANS.items()
    for name, figure in plan.figures.items()
}
# Model -> folder within its own -> the task that leaves it.
TASKS = {
    name: {
        **plan.data,
        **plan.trainings,
        **{folder: one.task for folder, one in plan.evaluations.items()},
        **plan.samples,
    }
    for name, plan in PLANS.items()
}
DEFAULT_TARGETS += [
    f"{RESULTS}/report/{getattr(shown, 'file', shown)}"
    for _, figure in FIGURES.values()
    for shown in figure.output.values()
    if figure.default
]


def evaluations_of(table):
    """The folders of all evaluations whose rows a table of metrics holds."""
    return [
        f"{RESULTS}/{name}/{folder}"
        for name, plan in PLANS.items()
        for folder, evaluation in plan.evaluations.items()
        if table in evaluation.tables
    ]


METRIC_TABLES = {
    table: evaluations_of(table)
    for plan in PLANS.values()
    for evaluation in plan.evaluations.values()
    for table in evaluation.tables
}
# Of a method that answers with a folder of meshes.
SCORE = f"{RESULTS}/scores/{Path(config['predictions'] or '-').resolve().name}"
if config["predictions"]:
    METRIC_TABLES["systems"] += [SCORE]
METRIC_TABLES["metrics"] += [
    *METRIC_TABLES["representations"],
    *METRIC_TABLES.get("scans", []),
]


def table_evaluations(wildcards):
    """Input function: the evaluations whose rows a table holds."""
    return METRIC_TABLES[wildcards.table]


wildcard_constraints:
    model="|".join(MODELS),


def folders(kind):
    """Constraint of the wildcard `task`: those of a kind, of whatever model."""
    found = {folder for plan in PLANS.values() for folder in getattr(plan, kind)}
    return "|".join(map(re.escape, sorted(found)))


def task_of(wildcards):
    """The task that leaves a model's folder."""
    try:
        return TASKS[wildcards.model][wildcards.task]
    except KeyError:
        raise WorkflowError(
            f"{wildcards.model} has no '{wildcards.task}', expected one of"
            f" {', '.join(TASKS[wildcards.model])}"
        ) from None


def checked_input(task):
    """Files of a task, once the experiment is known to be enough for it."""
    for check in task.checks:
        check()
    return dict(task.input)


def task_input(wildcards):
    """Input function: `checked_input` of a task."""
    return checked_input(task_of(wildcards))


def figure_input(task):
    """Input function of a figure."""

    def checked(wildcards):
        return checked_input(task)

    return checked


def task_digest(task):
    """Digest of the code that a task runs."""
    return source_hash("run_job", task.run, *task.modules)


def task_function(wildcards):
    """Params function: the name of what a task runs."""
    return task_of(wildcards).run


# All at once, since what is found out once jobs are planned is not remembered.
TASK_CODES = {
    name: {folder: task_digest(task) for folder, task in tasks.items()}
    for name, tasks in TASKS.items()
}


def task_code(wildcards):
    """Params function: `task_digest` of a task."""
    return TASK_CODES[wildcards.model][wildcards.task]


def task_told(wildcards):
    """Params function: what a task is told."""
    return task_of(wildcards).params


def task_progress(wildcards, output):
    """Params function: where a task keeps its state, which outlives the job."""
    return str(Path(output[0]).parent / ".progress" / Path(output[0]).name)


def task_priority(wildcards):
    """Priority of a model's tasks."""
    return PLANS[wildcards.model].priority


def task_environment(wildcards):
    """The environment of a task."""
    return f"../../envs/{task_of(wildcards).environment}.yaml"


def task_threads(wildcards):
    """Threads of a task."""
    return NETWORK_THREADS if task_of(wildcards).parallel else 1


def task_gpus(wildcards):
    """GPUs that a task asks for."""
    return task_of(wildcards).gpus


def task_mb(wildcards, attempt):
    """Resources function: megabytes that a task asks for."""
    return asked_mb(task_of(wildcards).megabytes, attempt)


def task_minutes(wildcards, attempt):
    """Resources function: minutes that a task asks for."""
    return asked_minutes(task_of(wildcards).seconds, attempt)


def figure_output(model, figure):
    """Files of a figure, marked for the report."""
    return {
        name: (
            f"{RESULTS}/report/{shown}"
            if isinstance(shown, str)
            else report(
                f"{RESULTS}/report/{shown.file}",
                caption=os.path.join("../report", f"{shown.caption}.rst"),
                category=MODELS[model].title,
                labels={"shows": shown.title},
            )
        )
        for name, shown in figure.output.items()
    }


# Stages in the tables of times: the files that rules stand in, up to an underscore, put together.
STAGES = {
    **dict.fromkeys(["bodies", "outfits"], "bodies, motion, outfits"),
    **dict.fromkeys(
        ["dataset", "renders", "report", "evaluation"], "dataset, pictures, report"
    ),
    **dict.fromkeys(["registration", "learning"], "registration, data for learning"),
    **{name: model.title for name, model in MODELS.items()},
}


def stages_of_jobs():
    """What the names of benchmark files begin with, and the stage of the jobs they are of."""
    stages = {}
    for made_by in workflow.rules:
        name = Path(made_by.snakefile).stem.split("_")[0]
        stages[f"{made_by.name}/"] = STAGES.get(name, name)
        if name == "simulation":
            for group in MOVING:
                stages[f"{made_by.name}/{group.name}_"] = f"simulation, {group.solver}"
        for model in MODELS if name == "models" else ():
            stages[f"{made_by.name}/{model}/"] = MODELS[model].title
    for name, (model, _) in FIGURES.items():
        stages[f"{name}/"] = MODELS[model].title
    return stages


# What all models are asked.
PICTURED = pictured_samples(FILES)
PROTOCOL_INPUT = {
    **WHOLE_BODIES,
    "data": FILES.static,
    "outfits": FILES.outfits_at_rest,
    "samples": sorted(
        {
            *FILES.known_scans(CLEAN)["samples"],
            *FILES.shards_of(
                FILES.samples,
                [name for key in ("samples", "others") for name in PICTURED[key]],
            ),
        }
    ),
    **{f"{kind}_scans": FILES.known_scans(kind)["scans"] for kind in (CLEAN, WORSE)},
}
PROTOCOL_TOLD = {**PICTURED, **FILES.compared}


def scored(wildcards):
    """Input function: the page of a method that answers with a folder of meshes."""
    if not config["predictions"]:
        raise WorkflowError(
            "predictions is not set, expected a folder of meshes; docs/how-to/compare.md"
        )
    return f"{RESULTS}/report/score.html"


# Trained models that come with drapeline, by name, and what they were trained on.
PACKAGES = {
    name: package for plan in PLANS.values() for name, package in plan.packages.items()
}
PACKAGED_FROM = {
    "config": " + ".join(map(os.path.basename, workflow.configfiles)) or "config.yaml",
    "seed": config["seed"],
    "body_files": sorted(config["body"]["files"].values()),
    "learned": sorted(
        plan.sample
        for plan in (*FILES.moving_plans.values(), *FILES.resting_plans.values())
        if plan.split == "train"
    ),
    "samples": {
        split: {
            "sequences": sum(
                plan.split == split for plan in FILES.moving_plans.values()
            ),
            "outfits at rest": sum(
                plan.split == split for plan in FILES.resting_plans.values()
            ),
        }
        for split in SPLITS
    },
    "clips": {
        split: sorted(
            {
                plan.sequence
                for plan in FILES.moving_plans.values()
                if plan.split == split
            }
        )
        for split in SPLITS
    },
}


def tell_starts():
    """Say which networks begin with the weights of models that come with drapeline."""
    if config["init"] == "random":
        return
    for name, plan in PLANS.items():
        for folder, task in plan.trainings.items():
            start = task.params.get("start")
            if start is not None:
                logger.info(
                    f"{name}/{folder} begins with"
                    + (
                        f" {start['folder']}."
                        if start["folder"]
                        else f" random weights: {start['reason']}."
                    )
                )
