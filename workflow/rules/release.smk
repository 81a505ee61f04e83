# What is there to be passed on: trained models, and the dataset.
rule pack_models:
    input:
        [package.folder for package in PACKAGES.values()],
        metrics=f"{RESULTS}/packaged.tsv",
    output:
        directory(f"{RESULTS}/weights"),
    log:
        f"{LOGS}/pack_models.log",
    benchmark:
        f"{BENCHMARKS}/pack_models.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        told={
            "models": {name: package._asdict() for name, package in PACKAGES.items()},
            "about": PACKAGED_FROM,
        },
        code=source_hash("pack_models"),
    script:
        "../../scripts/pack_models.py"


rule weights:
    # Trained models, small and described, as they come with drapeline.
    input:
        rules.pack_models.output,


rule release_dataset:
    input:
        rules.collect_dataset.output,
    output:
        directory(f"{RESULTS}/release"),
    log:
        f"{LOGS}/release_dataset.log",
    benchmark:
        f"{BENCHMARKS}/release_dataset.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=120,
    params:
        about=lookup(dpath="release", within=config),
        code=source_hash("release_dataset"),
    script:
        "../../scripts/release_dataset.py"


rule release:
    # The dataset, ready to be published: with an index, a licence, checksums and metadata.
    input:
        rules.release_dataset.output,
