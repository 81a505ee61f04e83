BODY_SETTINGS = {
    key: config["body"][key]
    for key in (
        "shape_range",
        "bmi_range",
        "shape_draws",
        "segment_gap_m",
        "fit_motion",
    )
}


rule copy_body:
    output:
        female="resources/body/female.npz",
        male="resources/body/male.npz",
    log:
        "logs/copy_body.log",
    benchmark:
        "benchmarks/copy_body.tsv"
    priority: PICTURES_FIRST
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        code=source_hash("copy_body"),
    script:
        "../../scripts/copy_body.py"


rule convert_body:
    input:
        baked_body,
    output:
        "resources/body/smpl/SMPL_{gender}.pkl",
    log:
        "logs/convert_body/{gender}.log",
    benchmark:
        "benchmarks/convert_body/{gender}.tsv"
    wildcard_constraints:
        gender="FEMALE|MALE",
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        code=source_hash("convert_body"),
    script:
        "../../scripts/convert_body.py"


rule import_motion:
    input:
        unpack(motion_files),
    output:
        f"{RESULTS}/motions/{{sequence}}/{{length}}.npz",
    log:
        f"{LOGS}/import_motion/{{sequence}}_{{length}}.log",
    benchmark:
        f"{BENCHMARKS}/import_motion/{{sequence}}_{{length}}.tsv"
    priority: clip_priority
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        motion=motion_parameters,
        sums=motion_sums,
        code=source_hash("import_motion"),
    script:
        "../../scripts/import_motion.py"


rule plot_skeleton:
    input:
        unpack(skeleton_files),
    output:
        f"{RESULTS}/skeletons/{{sequence}}.svg",
    log:
        f"{LOGS}/plot_skeleton/{{sequence}}.log",
    benchmark:
        f"{BENCHMARKS}/plot_skeleton/{{sequence}}.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        code=source_hash("plot_skeleton"),
    script:
        "../../scripts/plot_skeleton.py"


rule animate_bodies:
    input:
        **WHOLE_BODIES,
        motions=shard_motions,
    output:
        directory(f"{RESULTS}/bodies/{{group}}/{{shard}}"),
    log:
        f"{LOGS}/animate_bodies/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/animate_bodies/{{group}}_{{shard}}.tsv"
    priority: sample_priority
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=shard_minutes(3),
    params:
        seed=config["seed"],
        plans=shard_plans,
        settings=BODY_SETTINGS,
        code=source_hash("animate_bodies"),
    script:
        "../../scripts/animate_bodies.py"
