wildcard_constraints:
    version="posed|unposed",


rule collect_static:
    input:
        **SUPER_BODIES,
        registrations=per_shard(REGISTRATION, RESTING),
    output:
        directory(f"{RESULTS}/static"),
    log:
        f"{LOGS}/collect_static.log",
    benchmark:
        f"{BENCHMARKS}/collect_static.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=memory(300 * STATIC_SIZE),
        runtime=minutes(2 * STATIC_SIZE),
    params:
        code=source_hash("collect_static"),
    script:
        "../../scripts/collect_static.py"


rule collect_dynamic:
    input:
        **SUPER_BODIES,
        **SAMPLES_WITH_REGISTRATIONS,
    output:
        directory(f"{RESULTS}/dynamic/{{version}}"),
    log:
        f"{LOGS}/collect_dynamic/{{version}}.log",
    benchmark:
        f"{BENCHMARKS}/collect_dynamic/{{version}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=memory(600 + 50 * MOVING_SIZE),
        runtime=minutes(6 * MOVING_SIZE),
    params:
        frame_step=lookup(dpath="gcvae/dvae/frame_step", within=config),
        code=source_hash("collect_dynamic"),
    script:
        "../../scripts/collect_dynamic.py"
