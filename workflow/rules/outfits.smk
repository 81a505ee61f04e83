# What garments are cut from and fitted to, for both genders at once.
DRESS_FORMS = {
    **{f"{gender}_body": body_file(gender) for gender in GENDERS},
    **{
        f"{gender}_templates": f"{RESULTS}/templates/{gender}.npz" for gender in GENDERS
    },
}


rule build_templates:
    input:
        body=gender_body,
    output:
        f"{RESULTS}/templates/{{gender}}.npz",
    log:
        f"{LOGS}/build_templates/{{gender}}.log",
    benchmark:
        f"{BENCHMARKS}/build_templates/{{gender}}.tsv"
    priority: PICTURES_FIRST
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=20,
    params:
        code=source_hash("build_templates"),
    script:
        "../../scripts/build_templates.py"


rule body_obj:
    # Asked for by name: what users model garments of their own on.
    input:
        **WHOLE_BODIES,
    output:
        **{gender: f"{RESULTS}/body_obj/{gender}.obj" for gender in GENDERS},
    log:
        f"{LOGS}/body_obj.log",
    benchmark:
        f"{BENCHMARKS}/body_obj.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        code=source_hash("body_obj"),
    script:
        "../../scripts/body_obj.py"


rule make_outfits:
    input:
        **DRESS_FORMS,
        bodies=shard_bodies,
        own=own_garment_files,
    output:
        directory(OUTFITS),
    log:
        f"{LOGS}/make_outfits/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/make_outfits/{{group}}_{{shard}}.tsv"
    priority: sample_priority
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=outfit_minutes,
        gpu=hanging_gpus,
    params:
        seed=config["seed"],
        plans=shard_plans,
        bodies={key: config["body"][key] for key in ("shape_range", "bmi_range")},
        settings=group_settings(
            "outfits",
            *("edge_length_m", "vertices_min"),
            *("tightness_range", "fits", "fabrics", "elastic_probability"),
        ),
        own_garments=group_own_garments,
        hanging=hanging,
        code=outfits_hash,
    script:
        "../../scripts/make_outfits.py"
