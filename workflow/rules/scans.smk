include: "scans_common.smk"


SAMPLE_STEPS += [
    SampleStep(
        "scan_sample", f"{RESULTS}/scans/{{sample}}.npz", set(SCANNED_SAMPLES), False
    )
]


rule scan_sample:
    # Segmented scans of some frames, and the bodies that fit them, for all models alike.
    input:
        sample=f"{RESULTS}/samples/{{sample}}",
        body=sample_body,
    output:
        f"{RESULTS}/scans/{{sample}}.npz",
    log:
        f"{LOGS}/scan_sample/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/scan_sample/{{sample}}.tsv"
    wildcard_constraints:
        sample=SINGLE_SAMPLE,
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        scans=lookup(dpath="scans/samples", within=config),
        body=lookup(dpath="scans/body", within=config),
        seed=config["seed"],
        code=source_hash("scan_sample"),
    script:
        "../../scripts/scan_sample.py"


rule scan_learning:
    # Segmented scans of samples of the learning group, and the bodies that fit them.
    input:
        **WHOLE_BODIES,
        samples=SCANNED_SHARDS,
    output:
        f"{RESULTS}/scans/learning.npz",
    log:
        f"{LOGS}/scan_learning.log",
    benchmark:
        f"{BENCHMARKS}/scan_learning.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=minutes(15 * len(SCANNED_LEARNING)),
    params:
        samples=[sample for _, sample in SCANNED_LEARNING],
        scans=lookup(dpath="scans/samples", within=config),
        body=lookup(dpath="scans/body", within=config),
        seed=config["seed"],
        code=source_hash("scan_learning"),
    script:
        "../../scripts/scan_learning.py"
