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
        scans=FILES.known_scans(NOISY)["scans"],
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


rule write_protocol:
    # What models are asked and are told, for methods from elsewhere.
    input:
        **PROTOCOL_INPUT,
    output:
        directory(f"{RESULTS}/protocol"),
    log:
        f"{LOGS}/write_protocol.log",
    benchmark:
        f"{BENCHMARKS}/write_protocol.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        told=PROTOCOL_TOLD,
        code=source_hash("write_protocol"),
    script:
        "../../scripts/write_protocol.py"


rule protocol:
    # The questions that all models are asked, as files, for a method from elsewhere.
    input:
        rules.write_protocol.output,


rule tabulate_systems:
    input:
        METRIC_TABLES["systems"],
    output:
        report(
            f"{RESULTS}/report/systems.html",
            caption="../report/systems.rst",
            category="Models",
            labels={"shows": "all systems on the same samples"},
        ),
    log:
        f"{LOGS}/tabulate_systems.log",
    benchmark:
        f"{BENCHMARKS}/tabulate_systems.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        code=source_hash("tabulate_systems"),
    script:
        "../../scripts/tabulate_systems.py"


rule compare_systems:
    # All systems asked the same questions on the same held-out samples.
    input:
        rules.tabulate_systems.output,
        f"{RESULTS}/systems.tsv",


if config["predictions"]:

    rule score_predictions:
        input:
            **PROTOCOL_INPUT,
            meshes=sorted(glob(f"{config['predictions']}/*/*/*.obj")),
        output:
            directory(SCORE),
        log:
            f"{LOGS}/score_predictions.log",
        benchmark:
            f"{BENCHMARKS}/score_predictions.tsv"
        conda:
            "../../envs/geometry.yaml"
        threads: 1
        resources:
            mem_mb=1500,
            runtime=60,
        params:
            told={**PROTOCOL_TOLD, "predictions": config["predictions"]},
            code=source_hash("score_predictions"),
        script:
            "../../scripts/score_predictions.py"

    use rule tabulate_systems as tabulate_score with:
        input:
            SCORE,
        output:
            f"{RESULTS}/report/score.html",
        log:
            f"{LOGS}/tabulate_score.log",
        benchmark:
            f"{BENCHMARKS}/tabulate_score.tsv"


rule score:
    # A method from elsewhere, measured by the folder of meshes that predictions names.
    input:
        scored,
