include: "garment4d_common.smk"


rule make_garment_template:
    input:
        unpack(own_template),
        **DRESS_FORMS,
    output:
        f"{G4D}/{{garment}}/template.npz",
    log:
        f"{LOGS}/make_garment_template/{{garment}}.log",
    benchmark:
        f"{BENCHMARKS}/make_garment_template/{{garment}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        edge_length_m=lookup(dpath="garment4d/template/edge_length_m", within=config),
        code=source_hash("make_garment_template"),
    script:
        "../../scripts/make_garment_template.py"


rule fit_templates:
    input:
        **TEMPLATES,
        shard=shard_garments,
    output:
        directory(FITS),
    log:
        f"{LOGS}/fit_templates/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/fit_templates/{{group}}_{{shard}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=shard_minutes(0.35),
    params:
        garments=G4D_GARMENTS,
        simulated=is_simulated,
        settings=lookup(dpath="garment4d/registration", within=config),
        code=source_hash("fit_templates"),
    script:
        "../../scripts/fit_templates.py"


rule sample_clouds:
    input:
        SAMPLE,
    output:
        directory(f"{G4D}/clouds_{{protocol}}/{{group}}/{{shard}}"),
    log:
        f"{LOGS}/sample_clouds_{{protocol}}/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/sample_clouds_{{protocol}}/{{group}}_{{shard}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=shard_minutes(0.75),
    params:
        garments=G4D_GARMENTS,
        settings=cloud_settings,
        code=source_hash("sample_clouds"),
    script:
        "../../scripts/sample_clouds.py"


rule skin_outfits:
    # Outfits at rest move as the samples of their split do.
    input:
        **WHOLE_BODIES,
        outfits=OUTFITS,
        samples=per_shard(SAMPLE, PUBLISHED or MOVING),
    output:
        directory(f"{G4D}/skinned/{{group}}/{{shard}}"),
    log:
        f"{LOGS}/skin_outfits/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/skin_outfits/{{group}}_{{shard}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=shard_minutes(0.2),
    params:
        garments=G4D_GARMENTS,
        frames=lookup(dpath="garment4d/skinned/frames", within=config),
        step=lookup(dpath="garment4d/skinned/step", within=config),
        clouds=cloud_settings,
        code=source_hash("skin_outfits"),
    script:
        "../../scripts/skin_outfits.py"


rule collect_garment4d:
    input:
        unpack(garment_sequences),
        **(WHOLE_BODIES if BODY_RELATIVE_POINTS else {}),
        template=f"{G4D}/{{garment}}/template.npz",
        fits=TEMPLATE_FITS,
    output:
        directory(f"{G4D}/{{garment}}/data_{{protocol}}"),
    log:
        f"{LOGS}/collect_garment4d/{{garment}}_{{protocol}}.log",
    benchmark:
        f"{BENCHMARKS}/collect_garment4d/{{garment}}_{{protocol}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=memory(400 + 20 * MOVING_SIZE),
        runtime=minutes(25 * MOVING_SIZE),
    params:
        components=lookup(dpath="garment4d/components", within=config),
        body_relative_points=BODY_RELATIVE_POINTS,
        code=source_hash("collect_garment4d"),
    script:
        "../../scripts/collect_garment4d.py"


rule train_garment4d_canonical:
    input:
        **WHOLE_BODIES,
        data=stage_sequences("canonical"),
    output:
        directory(f"{G4D}/{{garment}}/{{canonical}}"),
    log:
        f"{LOGS}/train_garment4d_canonical/{{garment}}_{{canonical}}.log",
    benchmark:
        f"{BENCHMARKS}/train_garment4d_canonical/{{garment}}_{{canonical}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        gpu=gpus("garment4d"),
        mem_mb=memory(batch_mb("garment4d", "canonical")),
        runtime=minutes(garment4d_seconds("canonical")),
    params:
        settings=stage_settings("canonical"),
        body_points=lookup(dpath="garment4d/body_points", within=config),
        trainer=lookup(dpath="garment4d/trainer", within=config),
        progress=in_progress("canonical"),
        code=source_hash("train_garment4d_canonical"),
    script:
        "../../scripts/train_garment4d_canonical.py"


rule train_garment4d_posed:
    input:
        **WHOLE_BODIES,
        data=stage_sequences(),
        canonical=f"{G4D}/{{garment}}/canonical",
    output:
        directory(f"{G4D}/{{garment}}/{{posed}}"),
    log:
        f"{LOGS}/train_garment4d_posed/{{garment}}_{{posed}}.log",
    benchmark:
        f"{BENCHMARKS}/train_garment4d_posed/{{garment}}_{{posed}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        gpu=gpus("garment4d"),
        mem_mb=memory(batch_mb("garment4d", "posed")),
        runtime=minutes(garment4d_seconds("posed")),
    params:
        settings=posed_settings,
        body_points=lookup(dpath="garment4d/body_points", within=config),
        trainer=lookup(dpath="garment4d/trainer", within=config),
        progress=in_progress("posed"),
        code=source_hash("train_garment4d_posed"),
    script:
        "../../scripts/train_garment4d_posed.py"


rule evaluate_garment4d:
    input:
        unpack(evaluated_sequences),
        **WHOLE_BODIES,
        canonical=f"{G4D}/{{garment}}/canonical",
        pointnet=f"{G4D}/{{garment}}/pointnet",
        mgn=f"{G4D}/{{garment}}/mgn",
        posed=posed_models,
    output:
        metrics=f"{RESULTS}/metrics/garment4d_{{garment}}_{{models}}.tsv",
        pictures=directory(f"{G4D}/{{garment}}/reconstructions_{{models}}"),
    log:
        f"{LOGS}/evaluate_garment4d/{{garment}}_{{models}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_garment4d/{{garment}}_{{models}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=memory(1200 + 20 * MOVING_SIZE),
        runtime=minutes(400 * MOVING_SIZE),
        gpu=min(gpus("garment4d"), 1),
    params:
        posed=posed_variants_of,
        splits=EVALUATED_SPLITS,
        settings=evaluation_settings,
        accelerator=lookup(dpath="garment4d/trainer/accelerator", within=config),
        refine=lookup(dpath="garment4d/refine", within=config),
        body_points=lookup(dpath="garment4d/body_points", within=config),
        code=source_hash("evaluate_garment4d"),
    script:
        "../../scripts/evaluate_garment4d.py"


rule compare_garment4d:
    input:
        **SEQUENCES,
        fits=FITS_AT_REST,
        data=static_data(*EVALUATED_SPLITS),
        outfits=ALL_OUTFITS_AT_REST,
    output:
        f"{RESULTS}/metrics/representations_garment4d.tsv",
    log:
        f"{LOGS}/compare_garment4d.log",
    benchmark:
        f"{BENCHMARKS}/compare_garment4d.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        garments=COMPARED_GARMENTS,
        split=EVALUATED_SPLITS[0],
        seed=config["seed"],
        code=source_hash("compare_garment4d"),
    script:
        "../../scripts/compare_garment4d.py"


rule evaluate_scans_garment4d:
    input:
        **WHOLE_BODIES,
        **KNOWN_SCANS,
        models=expand(f"{G4D}/{{garment}}/posed", garment=G4D_GARMENTS),
    output:
        metrics=f"{RESULTS}/metrics/scans_garment4d.tsv",
        shown=f"{RESULTS}/garment4d/fitted_scans.npz",
    log:
        f"{LOGS}/evaluate_scans_garment4d.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_scans_garment4d.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=240,
    params:
        split=EVALUATED_SPLITS[0],
        seed=config["seed"],
        code=source_hash("evaluate_scans_garment4d"),
    script:
        "../../scripts/evaluate_scans_garment4d.py"


include: "garment4d_figures.smk"
include: "garment4d_reconstruct.smk"
