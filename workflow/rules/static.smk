rule make_static_outfits:
    input:
        **{f"{gender}_body": body_file(gender) for gender in GENDERS},
        **{
            f"{gender}_templates": f"{RESULTS}/templates/{gender}.npz"
            for gender in GENDERS
        },
    output:
        arrays=f"{RESULTS}/static/outfits/{{shard}}.npz",
        parameters=f"{RESULTS}/static/outfits/{{shard}}.json",
    log:
        f"{LOGS}/make_static_outfits/{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/make_static_outfits/{{shard}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        seed=config["seed"],
        plans=shard_plans,
        shape_range=lookup(dpath="body/shape_range", within=config),
        edge_length_m=lookup(dpath="static/edge_length_m", within=config),
        tightness_range=lookup(dpath="outfits/tightness_range", within=config),
        code=source_hash("make_static_outfits"),
    script:
        "../../scripts/make_static_outfits.py"


rule register_static:
    input:
        outfits=f"{RESULTS}/static/outfits/{{shard}}.npz",
        parameters=f"{RESULTS}/static/outfits/{{shard}}.json",
        female=f"{RESULTS}/registration/body/female.npz",
        male=f"{RESULTS}/registration/body/male.npz",
        topology=f"{RESULTS}/registration/topology.npz",
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
        mem_mb=2000,
        runtime=60,
    params:
        code=source_hash("register_static"),
    script:
        "../../scripts/register_static.py"


rule collect_static:
    input:
        shards=expand(f"{RESULTS}/registration/static/{{shard}}.npz", shard=STATIC),
        female=f"{RESULTS}/registration/body/female.npz",
        male=f"{RESULTS}/registration/body/male.npz",
    output:
        directory(f"{RESULTS}/static/data"),
    log:
        f"{LOGS}/collect_static.log",
    benchmark:
        f"{BENCHMARKS}/collect_static.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        code=source_hash("collect_static"),
    script:
        "../../scripts/collect_static.py"


rule register_sample:
    input:
        sample=f"{RESULTS}/samples/{{sample}}",
        female=f"{RESULTS}/registration/body/female.npz",
        male=f"{RESULTS}/registration/body/male.npz",
        topology=f"{RESULTS}/registration/topology.npz",
    output:
        directory(f"{RESULTS}/registration/samples/{{sample}}"),
    log:
        f"{LOGS}/register_sample/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/register_sample/{{sample}}.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        code=source_hash("register_sample"),
    script:
        "../../scripts/register_sample.py"


rule tabulate_registration:
    input:
        static=expand(f"{RESULTS}/registration/static/{{shard}}.tsv", shard=STATIC),
        samples=per_sample("{results}/registration/samples/{sample}"),
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
        outfits=expand(f"{RESULTS}/static/outfits/{{shard}}.npz", shard=STATIC),
        female=f"{RESULTS}/registration/body/female.npz",
        male=f"{RESULTS}/registration/body/male.npz",
        topology=f"{RESULTS}/registration/topology.npz",
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
