DEFAULT_TARGETS += [f"{RESULTS}/metrics.tsv", f"{RESULTS}/report/representations.html"]
if FILES.scanned:
    DEFAULT_TARGETS += [f"{RESULTS}/report/scans.html", f"{RESULTS}/report/scans.png"]


rule collect_metrics:
    input:
        table_evaluations,
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


rule tabulate_scans:
    input:
        f"{RESULTS}/scans.tsv",
    output:
        report(
            f"{RESULTS}/report/scans.html",
            caption="../report/scans.rst",
            category="Models",
            labels={"shows": "all models fitted to the same scans"},
        ),
    log:
        f"{LOGS}/tabulate_scans.log",
    benchmark:
        f"{BENCHMARKS}/tabulate_scans.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        code=source_hash("tabulate_scans"),
    script:
        "../../scripts/tabulate_scans.py"


rule plot_scans:
    input:
        scans=FILES.known_scans["scans"],
        evaluated=METRIC_TABLES.get("scans", []),
    output:
        report(
            f"{RESULTS}/report/scans.png",
            caption="../report/scans_sheet.rst",
            category="Models",
            labels={"shows": "garments fitted to scans by all models"},
        ),
    log:
        f"{LOGS}/plot_scans.log",
    benchmark:
        f"{BENCHMARKS}/plot_scans.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=20,
    params:
        most=6,
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_scans"),
    script:
        "../../scripts/plot_scans.py"
