from drapeline.models.smplicit.variants import FIELD_MODELS, MODEL_OF_GARMENT

# Where the fields of each garment type are defined.
FIELD_BOXES = {
    garment: FIELD_MODELS[model].box for garment, model in MODEL_OF_GARMENT.items()
}


wildcard_constraints:
    version="posed|unposed",
    field="|".join(FIELD_MODELS),


def field_garments(wildcards):
    """Params function: the garment types of a model of fields."""
    return FIELD_MODELS[wildcards.field].garments


def field_shards(wildcards):
    """Input function: fields of all outfits, once the plan is known to fill the splits."""
    static_data("train", "val")(wildcards)
    return expand(f"{RESULTS}/static/fields/{{shard}}.npz", shard=STATIC)


rule collect_static:
    input:
        **SUPER_BODIES,
        shards=expand(f"{RESULTS}/registration/static/{{shard}}.npz", shard=STATIC),
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


rule collect_dynamic:
    input:
        **SUPER_BODIES,
        samples=per_sample(f"{RESULTS}/samples/{{sample}}"),
        registrations=per_sample(f"{RESULTS}/registration/samples/{{sample}}"),
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
        mem_mb=4000,
        runtime=240,
    params:
        frame_step=lookup(dpath="gcvae/dvae/frame_step", within=config),
        code=source_hash("collect_dynamic"),
    script:
        "../../scripts/collect_dynamic.py"


rule sample_fields:
    input:
        **WHOLE_BODIES,
        outfits=f"{RESULTS}/static/outfits/{{shard}}.npz",
    output:
        f"{RESULTS}/static/fields/{{shard}}.npz",
    log:
        f"{LOGS}/sample_fields/{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/sample_fields/{{shard}}.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        seed=config["seed"],
        near=lookup(dpath="smplicit/data/near", within=config),
        space=lookup(dpath="smplicit/data/space", within=config),
        resolution=lookup(dpath="smplicit/data/resolution", within=config),
        boxes=FIELD_BOXES,
        code=source_hash("sample_fields"),
    script:
        "../../scripts/sample_fields.py"


rule collect_fields:
    input:
        **WHOLE_BODIES,
        shards=field_shards,
    output:
        directory(f"{RESULTS}/smplicit/data/{{field}}"),
    log:
        f"{LOGS}/collect_fields/{{field}}.log",
    benchmark:
        f"{BENCHMARKS}/collect_fields/{{field}}.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        garments=field_garments,
        resolution=lookup(dpath="smplicit/data/resolution", within=config),
        clusters=lookup(dpath="smplicit/data/clusters", within=config),
        code=source_hash("collect_fields"),
    script:
        "../../scripts/collect_fields.py"
