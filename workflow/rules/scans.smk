rule scan_samples:
    # Segmented scans of some frames, and the bodies that fit them, for all models alike.
    input:
        **WHOLE_BODIES,
        samples=SAMPLE,
    output:
        FILES.scans,
    log:
        f"{LOGS}/scan_samples/{{kind}}_{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/scan_samples/{{kind}}_{{group}}_{{shard}}.tsv"
    wildcard_constraints:
        kind="|".join(SCAN_KINDS),
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=shard_minutes(15),
    params:
        samples=scanned_of_shard,
        scans=lookup(dpath="scans/{kind}", within=config),
        body=lookup(dpath="scans/body", within=config),
        seed=config["seed"],
        code=source_hash("scan_samples"),
    script:
        "../../scripts/scan_samples.py"
