REGISTRATION_FILES = expand(
    f"{RESULTS}/report/{{name}}",
    name=["registration.html", "registration.png", "topologies.png", "hierarchy.png"],
)


rule build_super_body:
    input:
        female=body_file("female"),
        male=body_file("male"),
    output:
        female=f"{RESULTS}/registration/body/female.npz",
        male=f"{RESULTS}/registration/body/male.npz",
        topology=f"{RESULTS}/registration/topology.npz",
    log:
        f"{LOGS}/build_super_body.log",
    benchmark:
        f"{BENCHMARKS}/build_super_body.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        vertices=lookup(dpath="registration/vertices", within=config),
        code=source_hash("build_super_body"),
    script:
        "../../scripts/build_super_body.py"


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


rule plot_hierarchy:
    input:
        topology=f"{RESULTS}/registration/topology.npz",
        segments=f"{RESULTS}/registration/hierarchy_segments.npz",
        uniform=f"{RESULTS}/registration/hierarchy_uniform.npz",
    output:
        topologies=report(
            f"{RESULTS}/report/topologies.png",
            caption="../report/topologies.rst",
            category="Registration",
            labels={"shows": "the two topologies, as figure 5"},
        ),
        hierarchy=report(
            f"{RESULTS}/report/hierarchy.png",
            caption="../report/hierarchy.rst",
            category="Registration",
            labels={"shows": "mesh hierarchy for pooling, as figure 6"},
        ),
    log:
        f"{LOGS}/plot_hierarchy.log",
    benchmark:
        f"{BENCHMARKS}/plot_hierarchy.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_hierarchy"),
    script:
        "../../scripts/plot_hierarchy.py"
