include: "smplicit_common.smk"


rule sample_fields:
    input:
        **WHOLE_BODIES,
        outfits=OUTFITS,
    output:
        SMPLICIT.fields,
    log:
        f"{LOGS}/sample_fields/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/sample_fields/{{group}}_{{shard}}.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=shard_memory(420, 1),
        runtime=shard_minutes(0.08),
    params:
        seed=config["seed"],
        near=lookup(dpath="smplicit/data/near", within=config),
        space=lookup(dpath="smplicit/data/space", within=config),
        resolution=lookup(dpath="smplicit/data/resolution", within=config),
        boxes=FIELD_BOXES,
        code=source_hash("sample_fields"),
    script:
        "../../scripts/sample_fields.py"


include: "smplicit_images.smk"
include: "smplicit_scans.smk"
