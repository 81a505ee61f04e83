wildcard_constraints:
    version="posed|unposed",


rule collect_static:
    input:
        **FILES.super_bodies,
        registrations=per_shard(REGISTRATION, RESTING),
    output:
        directory(FILES.static),
    log:
        f"{LOGS}/collect_static.log",
    benchmark:
        f"{BENCHMARKS}/collect_static.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=memory(300 * FILES.static_size),
        runtime=minutes(2 * FILES.static_size),
    params:
        code=source_hash("collect_static"),
    script:
        "../../scripts/collect_static.py"


rule collect_dynamic:
    input:
        **FILES.super_bodies,
        **FILES.registered_samples,
    output:
        directory(FILES.dynamic("{version}")),
    log:
        f"{LOGS}/collect_dynamic/{{version}}.log",
    benchmark:
        f"{BENCHMARKS}/collect_dynamic/{{version}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=memory(600 + 50 * FILES.moving_size),
        runtime=minutes(6 * FILES.moving_size),
    params:
        frame_step=lookup(dpath="gcvae/dvae/frame_step", within=config),
        code=source_hash("collect_dynamic"),
    script:
        "../../scripts/collect_dynamic.py"
