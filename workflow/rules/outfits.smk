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


rule make_outfit:
    input:
        body=sample_body,
        animation=f"{RESULTS}/bodies/{{sample}}.npz",
        templates=sample_templates,
        own=own_garment_files,
    output:
        arrays=f"{RESULTS}/outfits/{{sample}}.npz",
        parameters=f"{RESULTS}/outfits/{{sample}}.json",
    log:
        f"{LOGS}/make_outfit/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/make_outfit/{{sample}}.tsv"
    priority: SAMPLES_FIRST
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=minutes(2 * CLOTH),
    params:
        seed=config["seed"],
        plan=unsplit_plan,
        settings=OUTFIT_SETTINGS,
        own_garments=sample_own_garments,
        code=source_hash("make_outfit"),
    script:
        "../../scripts/make_outfit.py"


# What lets outfits hang on their bodies; nothing of it counts where they do not.
SETTLING = {}
if config["static"]["settle_frames"]:
    SETTLING = {
        "modules": ["drapeline.generation.settled", "drapeline.xpbd.solver"],
        "accelerator": config["simulation"]["accelerator"],
        "frames": config["static"]["settle_frames"],
        "settings": {**config["simulation"]["settings"], "pose_frames": 1},
        "bounds": config["simulation"]["bounds"],
    }


rule make_static_outfits:
    input:
        **DRESS_FORMS,
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
        runtime=minutes((40 + 10 * config["static"]["settle_frames"]) * STATIC_SHARD),
        gpu=simulation_gpus("xpbd") if SETTLING else 0,
    params:
        seed=config["seed"],
        plans=shard_plans,
        shape_range=lookup(dpath="body/shape_range", within=config),
        edge_length_m=lookup(dpath="static/edge_length_m", within=config),
        tightness_range=lookup(dpath="outfits/tightness_range", within=config),
        elastic_probability=lookup(dpath="outfits/elastic_probability", within=config),
        settling=SETTLING,
        code=source_hash("make_static_outfits", *SETTLING.get("modules", ())),
    script:
        "../../scripts/make_static_outfits.py"
