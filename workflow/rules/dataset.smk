EXPORT_FORMATS = ["usdc", "glb", "abc", "mdd", "pc2", "obj"]
DEFAULT_TARGETS += [f"{RESULTS}/dataset"]
SAMPLE_STEPS += [
    SampleStep("write_sample", f"{RESULTS}/samples/{{sample}}", set(SAMPLES))
]


wildcard_constraints:
    format="|".join(EXPORT_FORMATS),


rule write_sample:
    input:
        body=sample_body,
        animation=f"{RESULTS}/bodies/{{sample}}.npz",
        outfit=f"{RESULTS}/outfits/{{sample}}.npz",
        parameters=f"{RESULTS}/outfits/{{sample}}.json",
        simulation=f"{RESULTS}/simulation/{{sample}}",
    output:
        directory(f"{RESULTS}/samples/{{sample}}"),
    log:
        f"{LOGS}/write_sample/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/write_sample/{{sample}}.tsv"
    wildcard_constraints:
        sample=SINGLE_SAMPLE,
    priority: SAMPLES_FIRST
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        seed=config["seed"],
        split=plan("split"),
        code=source_hash("write_sample"),
    script:
        "../../scripts/write_sample.py"


rule collect_dataset:
    input:
        per_sample(f"{RESULTS}/samples/{{sample}}"),
    output:
        dataset=directory(f"{RESULTS}/dataset"),
    log:
        f"{LOGS}/collect_dataset.log",
    benchmark:
        f"{BENCHMARKS}/collect_dataset.tsv"
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
        f"{RESULTS}/samples/{{sample}}",
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
