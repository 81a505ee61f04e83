DEFAULT_TARGETS += expand(
    f"{RESULTS}/report/{{name}}",
    name=["registration.html", "registration.png", "topologies.png", "hierarchy.png"],
)


rule build_super_body:
    input:
        **WHOLE_BODIES,
    output:
        **FILES.super_bodies,
        topology=FILES.topology,
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
        topology=FILES.topology,
    output:
        FILES.hierarchy("{pooling}"),
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
        topology=FILES.topology,
        segments=FILES.hierarchy("segments"),
        uniform=FILES.hierarchy("uniform"),
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


rule register_outfits:
    input:
        **FILES.super_bodies,
        outfits=OUTFITS,
        topology=FILES.topology,
    output:
        directory(REGISTRATION),
    log:
        f"{LOGS}/register_outfits/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/register_outfits/{{group}}_{{shard}}.tsv"
    wildcard_constraints:
        group=group_names(RESTING),
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=shard_memory(360, 3),
        runtime=shard_minutes(0.36),
    params:
        code=source_hash("register_outfits"),
    script:
        "../../scripts/register_outfits.py"


rule register_samples:
    input:
        **FILES.super_bodies,
        samples=SAMPLE,
        topology=FILES.topology,
    output:
        directory(REGISTRATION),
    log:
        f"{LOGS}/register_samples/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/register_samples/{{group}}_{{shard}}.tsv"
    wildcard_constraints:
        group=group_names(MOVING),
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=shard_minutes(0.6),
    params:
        code=source_hash("register_samples"),
    script:
        "../../scripts/register_samples.py"


rule tabulate_registration:
    input:
        **{group.name: per_shard(REGISTRATION, [group]) for group in GROUPS.values()},
    output:
        table=f"{RESULTS}/report/registration.tsv",
        page=report(
            f"{RESULTS}/report/registration.html",
            caption="../report/registration.rst",
            category="Registration",
            labels={"shows": "errors of the round trip"},
        ),
    log:
        f"{LOGS}/tabulate_registration.log",
    benchmark:
        f"{BENCHMARKS}/tabulate_registration.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        groups=list(GROUPS),
        code=source_hash("tabulate_registration"),
    script:
        "../../scripts/tabulate_registration.py"


rule plot_registration:
    input:
        **FILES.super_bodies,
        outfits=FILES.outfits_at_rest,
        topology=FILES.topology,
    output:
        report(
            f"{RESULTS}/report/registration.png",
            caption="../report/registration_sheet.rst",
            category="Registration",
            labels={"shows": "a registered garment of each type"},
        ),
    log:
        f"{LOGS}/plot_registration.log",
    benchmark:
        f"{BENCHMARKS}/plot_registration.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        rays=lookup(dpath="renders/rays", within=config),
        garments=FILES.types_at_rest(),
        code=source_hash("plot_registration"),
    script:
        "../../scripts/plot_registration.py"
