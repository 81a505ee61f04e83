EXPORT_FORMATS = ["usdc", "glb", "abc", "mdd", "pc2", "obj"]
DEFAULT_TARGETS += [f"{RESULTS}/dataset"]


wildcard_constraints:
    format="|".join(EXPORT_FORMATS),


rule collect_dataset:
    # Of the groups that are published.
    input:
        per_shard(SAMPLE, PUBLISHED),
    output:
        dataset=directory(f"{RESULTS}/dataset"),
    log:
        f"{LOGS}/collect_dataset.log",
    benchmark:
        f"{BENCHMARKS}/collect_dataset.tsv"
    priority: PICTURES_FIRST
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=60,
    params:
        code=source_hash("collect_dataset"),
    script:
        "../../scripts/collect_dataset.py"


rule dataset:
    # The dataset and nothing else: no pictures, no training, no report.
    input:
        rules.collect_dataset.output,


rule verify:
    # Makes nothing, not even a benchmark, so that it runs whenever it is asked for; and nothing is
    # made for it: it compares what is there, also what would be made anew.
    log:
        f"{LOGS}/verify.log",
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=240,
    params:
        results=RESULTS,
    script:
        "../../scripts/verify.py"


rule export_sample:
    input:
        sample_shard,
    output:
        directory(f"{RESULTS}/exports/{{sample}}/{{format}}"),
    log:
        f"{LOGS}/export_sample/{{sample}}-{{format}}.log",
    benchmark:
        f"{BENCHMARKS}/export_sample/{{sample}}-{{format}}.tsv"
    conda:
        "../../envs/blender.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        code=source_hash("export_sample"),
    script:
        "../../scripts/export_sample.py"


rule export_animated:
    # A sampled outfit in motion, see `animate_sampled`.
    input:
        f"{RESULTS}/gcvae/animated",
    output:
        directory(f"{RESULTS}/exports/{{sample}}/{{format}}"),
    log:
        f"{LOGS}/export_animated/{{sample}}-{{format}}.log",
    benchmark:
        f"{BENCHMARKS}/export_animated/{{sample}}-{{format}}.tsv"
    wildcard_constraints:
        sample=r"drawn\d+_\w+",
    conda:
        "../../envs/blender.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        code=source_hash("export_sample"),
    script:
        "../../scripts/export_sample.py"
