SUPER_BODIES = {
    gender: f"{RESULTS}/registration/body/{gender}.npz" for gender in GENDERS
}
TOPOLOGY = f"{RESULTS}/registration/topology.npz"
SAMPLE_STEPS += [
    SampleStep(
        "register_sample", f"{RESULTS}/registration/samples/{{sample}}", set(SAMPLES)
    )
]
DEFAULT_TARGETS += expand(
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
        topology=TOPOLOGY,
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
        topology=TOPOLOGY,
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


rule register_static:
    input:
        **SUPER_BODIES,
        outfits=f"{RESULTS}/static/outfits/{{shard}}.npz",
        parameters=f"{RESULTS}/static/outfits/{{shard}}.json",
        topology=TOPOLOGY,
    output:
        offsets=f"{RESULTS}/registration/static/{{shard}}.npz",
        errors=f"{RESULTS}/registration/static/{{shard}}.tsv",
    log:
        f"{LOGS}/register_static/{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/register_static/{{shard}}.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=memory(360 + 300 * STATIC_SHARD),
        runtime=minutes(36 * STATIC_SHARD),
    params:
        code=source_hash("register_static"),
    script:
        "../../scripts/register_static.py"


rule register_sample:
    input:
        **SUPER_BODIES,
        sample=f"{RESULTS}/samples/{{sample}}",
        topology=TOPOLOGY,
    output:
        directory(f"{RESULTS}/registration/samples/{{sample}}"),
    log:
        f"{LOGS}/register_sample/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/register_sample/{{sample}}.tsv"
    wildcard_constraints:
        sample=SINGLE_SAMPLE,
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=minutes(2 * CLOTH),
    params:
        code=source_hash("register_sample"),
    script:
        "../../scripts/register_sample.py"


rule tabulate_registration:
    input:
        static=expand(f"{RESULTS}/registration/static/{{shard}}.tsv", shard=STATIC),
        samples=per_sample(f"{RESULTS}/registration/samples/{{sample}}"),
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
        code=source_hash("tabulate_registration"),
    script:
        "../../scripts/tabulate_registration.py"


rule plot_registration:
    input:
        **SUPER_BODIES,
        outfits=expand(f"{RESULTS}/static/outfits/{{shard}}.npz", shard=STATIC),
        topology=TOPOLOGY,
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
        code=source_hash("plot_registration"),
    script:
        "../../scripts/plot_registration.py"
