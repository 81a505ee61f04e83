rule plot_statistics:
    input:
        dataset=f"{RESULTS}/dataset",
    output:
        **{
            name: report(
                f"{RESULTS}/report/{name}.svg",
                caption=f"../report/{name}.rst",
                category="Dataset",
                labels={"shows": shown},
            )
            for name, shown in {
                "garments": "garments by type and fabric",
                "actions": "frames per action",
                "splits": "splits and genders",
                "bodies": "body shapes and tightness",
                "vertices": "vertices per garment",
            }.items()
        },
    log:
        f"{LOGS}/plot_statistics.log",
    benchmark:
        f"{BENCHMARKS}/plot_statistics.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        code=source_hash("plot_statistics"),
    script:
        "../../scripts/plot_statistics.py"


rule tabulate_dataset:
    input:
        dataset=f"{RESULTS}/dataset",
    output:
        report(
            f"{RESULTS}/report/tables.html",
            caption="../report/tables.rst",
            category="Dataset",
            labels={"shows": "tables 1 and 2 beside the paper's"},
        ),
    log:
        f"{LOGS}/tabulate_dataset.log",
    benchmark:
        f"{BENCHMARKS}/tabulate_dataset.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        code=source_hash("tabulate_dataset"),
    script:
        "../../scripts/tabulate_dataset.py"


rule plot_health:
    input:
        dataset=f"{RESULTS}/dataset",
    output:
        **{
            name: report(
                f"{RESULTS}/report/{name}.svg",
                caption=f"../report/{name}.rst",
                category="Health",
                labels={"shows": shown},
            )
            for name, shown in {
                "penetration": "vertices inside the body",
                "outside_folds": "vertices inside the body, outside its folds",
                "depth": "depth inside the body",
                "stretch": "edge stretch",
                "gap": "gap to the body",
                "acceleration": "mean acceleration",
                "self_crossing": "cloth through itself",
                "layers": "layers that cross",
                "slip": "slipping",
                "speed": "simulation speed",
            }.items()
        },
        page=report(
            f"{RESULTS}/report/health.html",
            caption="../report/health.rst",
            category="Health",
            labels={"shows": "all samples: goals, measures, reasons"},
        ),
    log:
        f"{LOGS}/plot_health.log",
    benchmark:
        f"{BENCHMARKS}/plot_health.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        code=source_hash("plot_health"),
    script:
        "../../scripts/plot_health.py"


rule view_sample:
    input:
        sample_shard,
    output:
        f"{RESULTS}/viewer/{{sample}}.html",
    log:
        f"{LOGS}/view_sample/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/view_sample/{{sample}}.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        code=source_hash("view_sample"),
    script:
        "../../scripts/view_sample.py"


rule view_example:
    input:
        dataset=f"{RESULTS}/dataset",
    output:
        report(
            f"{RESULTS}/report/viewer.html",
            caption="../report/viewer.rst",
            category="Viewer",
            labels={"shows": "a sample to turn and play"},
        ),
    log:
        f"{LOGS}/view_example.log",
    benchmark:
        f"{BENCHMARKS}/view_example.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        code=source_hash("view_example"),
    script:
        "../../scripts/view_example.py"


rule write_overview:
    input:
        dataset=f"{RESULTS}/dataset",
        pictures=GALLERY_PICTURES,
    output:
        # The front page, workflow.rst, shows what this page holds.
        report(
            f"{RESULTS}/report/overview.html",
            caption="../report/overview.rst",
            category="Dataset",
            labels={"shows": "overview: all samples"},
        ),
    log:
        f"{LOGS}/write_overview.log",
    benchmark:
        f"{BENCHMARKS}/write_overview.tsv"
    priority: PICTURES_FIRST
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        code=source_hash("write_overview"),
    script:
        "../../scripts/write_overview.py"


rule write_errors:
    input:
        registration=f"{RESULTS}/report/registration.tsv",
        metrics=f"{RESULTS}/metrics.tsv",
    output:
        # As above.
        report(
            f"{RESULTS}/report/errors.html",
            caption="../report/errors.rst",
            category="Models",
            labels={"shows": "errors of all models beside baselines"},
        ),
    log:
        f"{LOGS}/write_errors.log",
    benchmark:
        f"{BENCHMARKS}/write_errors.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        code=source_hash("write_errors"),
    script:
        "../../scripts/write_errors.py"


DEFAULT_TARGETS += [
    *rules.write_overview.output,
    *rules.write_errors.output,
    *rules.plot_statistics.output,
    *rules.tabulate_dataset.output,
    *rules.plot_health.output,
    *rules.view_example.output,
]


rule plot_time:
    # Comes after all the rest, for what it reads are the benchmark files of the other rules.
    input:
        list(DEFAULT_TARGETS),
    output:
        figure=report(
            f"{RESULTS}/report/times.svg",
            caption="../report/times.rst",
            category="Time",
            labels={"shows": "time and memory of each step"},
        ),
        page=report(
            f"{RESULTS}/report/times.html",
            caption="../report/times.rst",
            category="Time",
            labels={"shows": "time and memory, table"},
        ),
        table=f"{RESULTS}/report/times.tsv",
    log:
        f"{LOGS}/plot_time.log",
    benchmark:
        f"{BENCHMARKS}/plot_time.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        # The bodies' own benchmark is not this experiment's: all experiments share the bodies.
        folders=[BENCHMARKS, "benchmarks"],
        stages=stages_of_jobs(),
        code=source_hash("plot_time"),
    script:
        "../../scripts/plot_time.py"


DEFAULT_TARGETS += rules.plot_time.output
