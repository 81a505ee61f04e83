# Garments are registered to the super-body for GCVAE, whose data others are compared on.
REGISTERED = FILES.learned_by("gcvae")


wildcard_constraints:
    version="posed|unposed",


rule collect_static:
    input:
        **FILES.super_bodies,
        registrations=per_shard(REGISTRATION, REGISTERED.resting),
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
        mem_mb=memory(300 * REGISTERED.static_size),
        runtime=minutes(2 * REGISTERED.static_size),
    params:
        code=source_hash("collect_static"),
    script:
        "../../scripts/collect_static.py"


rule collect_dynamic:
    input:
        **FILES.super_bodies,
        **REGISTERED.registered_samples,
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
        mem_mb=memory(600 + 50 * REGISTERED.moving_size),
        runtime=minutes(6 * REGISTERED.moving_size),
    params:
        frame_step=lookup(dpath="gcvae/dvae/frame_step", within=config),
        code=source_hash("collect_dynamic"),
    script:
        "../../scripts/collect_dynamic.py"
