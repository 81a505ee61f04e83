METRIC_TABLES["metrics"] += ["representations"]
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


rule compare_representations:
    input:
        **SEQUENCES,
        data=static_data(*EVALUATED_SPLITS),
        outfits=expand(f"{RESULTS}/static/outfits/{{shard}}.npz", shard=STATIC),
        fits=expand(f"{G4D}/fits/static/{{shard}}", shard=STATIC),
        models=[f"{RESULTS}/gcvae/svae", f"{RESULTS}/gcvae/svae_ours"],
    output:
        f"{RESULTS}/metrics/representations.tsv",
    log:
        f"{LOGS}/compare_representations.log",
    benchmark:
        f"{BENCHMARKS}/compare_representations.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        components=lookup(dpath="gcvae/evaluation/pca_components", within=config),
        split=EVALUATED_SPLITS[0],
        seed=config["seed"],
        code=source_hash("compare_representations"),
    script:
        "../../scripts/compare_representations.py"


rule tabulate_representations:
    input:
        f"{RESULTS}/metrics/representations.tsv",
    output:
        report(
            f"{RESULTS}/report/representations.html",
            caption="../report/representations.rst",
            category="Garment4D",
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
