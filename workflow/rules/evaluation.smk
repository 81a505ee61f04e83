METRIC_TABLES["metrics"] += METRIC_TABLES["representations"]
DEFAULT_TARGETS += [f"{RESULTS}/metrics.tsv", f"{RESULTS}/report/representations.html"]


rule collect_metrics:
    input:
        metric_files,
    output:
        f"{RESULTS}/{{table}}.tsv",
    log:
        f"{LOGS}/collect_metrics/{{table}}.log",
    benchmark:
        f"{BENCHMARKS}/collect_metrics/{{table}}.tsv"
    wildcard_constraints:
        table="|".join(METRIC_TABLES),
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        code=source_hash("collect_metrics"),
    script:
        "../../scripts/collect_metrics.py"


rule tabulate_representations:
    input:
        f"{RESULTS}/representations.tsv",
    output:
        report(
            f"{RESULTS}/report/representations.html",
            caption="../report/representations.rst",
            category="Models",
            labels={"shows": "the same garments through all codes"},
        ),
    log:
        f"{LOGS}/tabulate_representations.log",
    benchmark:
        f"{BENCHMARKS}/tabulate_representations.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        code=source_hash("tabulate_representations"),
    script:
        "../../scripts/tabulate_representations.py"
