include: "smplicit_common.smk"


rule sample_fields:
    input:
        **WHOLE_BODIES,
        outfits=OUTFITS,
    output:
        FIELDS,
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
        mem_mb=memory(200 * STATIC_SIZE),
        runtime=minutes(2 * STATIC_SIZE),
    params:
        garments=field_garments,
        resolution=lookup(dpath="smplicit/data/resolution", within=config),
        clusters=lookup(dpath="smplicit/data/clusters", within=config),
        code=source_hash("collect_fields"),
    script:
        "../../scripts/collect_fields.py"


rule train_smplicit:
    input:
        **WHOLE_BODIES,
        data=f"{SMPLICIT}/data/{{field}}",
        weights=encoder_weights,
    output:
        directory(f"{SMPLICIT}/{{field}}"),
    log:
        f"{LOGS}/train_smplicit/{{field}}.log",
    benchmark:
        f"{BENCHMARKS}/train_smplicit/{{field}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        gpu=gpus("smplicit"),
        mem_mb=memory(700 + 20 * STATIC_SIZE),
        runtime=minutes(smplicit_seconds()),
    params:
        settings=field_settings,
        trainer=lookup(dpath="smplicit/trainer", within=config),
        progress=in_progress("smplicit"),
        code=source_hash("train_smplicit"),
    script:
        "../../scripts/train_smplicit.py"


rule evaluate_smplicit:
    input:
        model=f"{SMPLICIT}/{{field}}",
        data=f"{SMPLICIT}/data/{{field}}",
        outfits=ALL_OUTFITS_AT_REST,
    output:
        metrics=f"{RESULTS}/metrics/smplicit_{{field}}.tsv",
        held_out=f"{SMPLICIT}/held_out/{{field}}.npz",
    log:
        f"{LOGS}/evaluate_smplicit/{{field}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_smplicit/{{field}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=4000,
        runtime=minutes(120 * STATIC_SIZE),
    params:
        split=EVALUATED_SPLITS[0],
        meshing=lookup(dpath="smplicit/meshing", within=config),
        fit=lookup(dpath="smplicit/evaluation", within=config),
        seed=config["seed"],
        code=source_hash("evaluate_smplicit"),
    script:
        "../../scripts/evaluate_smplicit.py"


rule compare_smplicit:
    input:
        held_out=expand(
            f"{SMPLICIT}/held_out/{{field}}.npz",
            field=sorted({MODEL_OF_GARMENT[garment] for garment in SMPLICIT_COMPARED}),
        ),
        data=static_data(*EVALUATED_SPLITS),
        outfits=ALL_OUTFITS_AT_REST,
    output:
        f"{RESULTS}/metrics/representations_smplicit.tsv",
    log:
        f"{LOGS}/compare_smplicit.log",
    benchmark:
        f"{BENCHMARKS}/compare_smplicit.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        garments=SMPLICIT_COMPARED,
        split=EVALUATED_SPLITS[0],
        seed=config["seed"],
        code=source_hash("compare_smplicit"),
    script:
        "../../scripts/compare_smplicit.py"


include: "smplicit_figures.smk"
include: "smplicit_gallery.smk"
include: "smplicit_images.smk"
include: "smplicit_scans.smk"
