include: "garment4d_common.smk"


rule make_garment_template:
    input:
        unpack(own_template),
        **DRESS_FORMS,
    output:
        GARMENT4D.template("{garment}"),
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
        template=GARMENT4D.template("{garment}"),
        shard=shard_garments,
    output:
        directory(GARMENT4D.fits("{garment}")),
    log:
        f"{LOGS}/fit_templates/{{garment}}_{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/fit_templates/{{garment}}_{{group}}_{{shard}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=shard_minutes(0.15),
    params:
        simulated=is_simulated,
        settings=lookup(dpath="garment4d/registration", within=config),
        code=source_hash("fit_templates"),
    script:
        "../../scripts/fit_templates.py"


rule sample_clouds:
    input:
        SAMPLE,
    output:
        directory(GARMENT4D.clouds("{protocol}")),
    log:
        f"{LOGS}/sample_clouds/{{protocol}}_{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/sample_clouds/{{protocol}}_{{group}}_{{shard}}.tsv"
    priority: LONG_CHAIN
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=shard_minutes(0.75),
    params:
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
        directory(GARMENT4D.skinned),
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
        frames=lookup(dpath="garment4d/skinned/frames", within=config),
        step=lookup(dpath="garment4d/skinned/step", within=config),
        clouds=cloud_settings,
        code=source_hash("skin_outfits"),
    script:
        "../../scripts/skin_outfits.py"


include: "garment4d_reconstruct.smk"
