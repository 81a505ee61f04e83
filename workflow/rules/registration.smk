rule super_body:
    input:
        female=body_file("female"),
        male=body_file("male"),
    output:
        female=f"{RESULTS}/registration/body/female.npz",
        male=f"{RESULTS}/registration/body/male.npz",
        topology=f"{RESULTS}/registration/topology.npz",
    log:
        f"{LOGS}/super_body.log",
    benchmark:
        f"{BENCHMARKS}/super_body.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        vertices=lookup(dpath="registration/vertices", within=config),
        code=source_hash("super_body"),
    script:
        "../../scripts/super_body.py"


rule build_hierarchy:
    input:
        topology=f"{RESULTS}/registration/topology.npz",
    output:
        f"{RESULTS}/registration/hierarchy_{{pooling}}.npz",
    log:
        f"{LOGS}/build_hierarchy/{{pooling}}.log",
    benchmark:
        f"{BENCHMARKS}/build_hierarchy/{{pooling}}.tsv"
    wildcard_constraints:
        pooling="segments|uniform",
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        code=source_hash("build_hierarchy"),
    script:
        "../../scripts/build_hierarchy.py"
