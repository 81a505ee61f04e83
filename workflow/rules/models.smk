include: "models_common.smk"


rule train:
    input:
        unpack(task_input),
    output:
        directory(f"{RESULTS}/{{model}}/{{task}}"),
    log:
        f"{LOGS}/train/{{model}}/{{task}}.log",
    benchmark:
        f"{BENCHMARKS}/train/{{model}}/{{task}}.tsv"
    wildcard_constraints:
        task=folders("trainings"),
    priority: task_priority
    conda:
        task_environment
    threads: task_threads
    resources:
        gpu=task_gpus,
        mem_mb=task_mb,
        runtime=task_minutes,
    params:
        run=task_function,
        told=task_told,
        progress=task_progress,
        code=task_code,
    script:
        "../../scripts/run_job.py"


use rule train as collect_data with:
    log:
        f"{LOGS}/collect_data/{{model}}/{{task}}.log",
    benchmark:
        f"{BENCHMARKS}/collect_data/{{model}}/{{task}}.tsv"
    wildcard_constraints:
        task=folders("data"),


use rule train as evaluate with:
    log:
        f"{LOGS}/evaluate/{{model}}/{{task}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate/{{model}}/{{task}}.tsv"
    wildcard_constraints:
        task=folders("evaluations"),


use rule train as sample_model with:
    log:
        f"{LOGS}/sample_model/{{model}}/{{task}}.log",
    benchmark:
        f"{BENCHMARKS}/sample_model/{{model}}/{{task}}.tsv"
    wildcard_constraints:
        task=folders("samples"),


for figure_name, (figure_model, figure) in FIGURES.items():

    rule:
        name:
            figure_name
        input:
            unpack(figure_input(figure.task)),
        output:
            **figure_output(figure_model, figure),
        log:
            f"{LOGS}/{figure_name}.log",
        benchmark:
            f"{BENCHMARKS}/{figure_name}.tsv"
        conda:
            f"../../envs/{figure.task.environment}.yaml"
        threads: 1
        resources:
            mem_mb=memory(figure.task.megabytes),
            runtime=minutes(figure.task.seconds),
        params:
            run=figure.task.run,
            told=figure.task.params,
            progress="",
            code=task_digest(figure.task),
        script:
            "../../scripts/run_job.py"


for target_name, target_files in [
    item for plan in PLANS.values() for item in plan.targets.items()
]:

    rule:
        name:
            target_name
        input:
            target_files,
