# What garments are cut from and fitted to, for both genders at once.
DRESS_FORMS = {
    **{f"{gender}_body": body_file(gender) for gender in GENDERS},
    **{
        f"{gender}_templates": f"{RESULTS}/templates/{gender}.npz" for gender in GENDERS
    },
}


HANGING_MODULES = ["drapeline.generation.hung_outfits", QUICK_SOLVER.code]


def shard_bodies(wildcards):
    """Input function: bodies in motion; at rest, outfits have none but their own."""
    group = GROUPS[wildcards.group]
    folder = f"{RESULTS}/bodies/{wildcards.group}/{wildcards.shard}"
    return [] if group.at_rest else folder


def group_own_garments(wildcards):
    """Params function: the user's own garments, by gender and type."""
    return own_garments(GROUPS[wildcards.group].outfits["own_garments"])


def own_garment_files(wildcards):
    """Input function: the OBJ files of these."""
    own = group_own_garments(wildcards)
    return sorted({one["path"] for worn in own.values() for one in worn.values()})


def hanging(wildcards):
    """Params function: what lets outfits hang; nothing of it counts where they do not."""
    if not hangs(wildcards):
        return {}
    group = GROUPS[wildcards.group]
    return {
        "modules": HANGING_MODULES,
        "accelerator": config["simulation"]["accelerator"],
        "how": {
            "frames": group.outfits["hang_frames"],
            "settings": group.simulation,
            "bounds": config["simulation"]["bounds"],
        },
    }


def outfits_hash(wildcards):
    """Params function: digest of what makes a group's outfits."""
    return source_hash("make_outfits", *(HANGING_MODULES if hangs(wildcards) else []))


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
    priority: SAMPLES_FIRST
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
        shape_range=lookup(dpath="body/shape_range", within=config),
        settings=group_settings(
            "outfits",
            *("edge_length_m", "vertices_min"),
            *("tightness_range", "elastic_probability"),
        ),
        own_garments=group_own_garments,
        hanging=hanging,
        code=outfits_hash,
    script:
        "../../scripts/make_outfits.py"
