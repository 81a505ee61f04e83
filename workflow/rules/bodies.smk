rule copy_body:
    output:
        female="resources/body/female.npz",
        male="resources/body/male.npz",
    log:
        "logs/copy_body.log",
    benchmark:
        "benchmarks/copy_body.tsv"
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
        f"{RESULTS}/motions/{{sequence}}.npz",
    log:
        f"{LOGS}/import_motion/{{sequence}}.log",
    benchmark:
        f"{BENCHMARKS}/import_motion/{{sequence}}.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        motion=motion_parameters,
        code=source_hash("import_motion"),
    script:
        "../../scripts/import_motion.py"


rule animate_body:
    input:
        body=sample_body,
        motion=sample_motion,
    output:
        f"{RESULTS}/bodies/{{sample}}.npz",
    log:
        f"{LOGS}/animate_body/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/animate_body/{{sample}}.tsv"
    priority: SAMPLES_FIRST
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=minutes(4 * FRAMES),
    params:
        seed=config["seed"],
        plan=unsplit_plan,
        settings=BODY_SETTINGS,
        code=source_hash("animate_body"),
    script:
        "../../scripts/animate_body.py"
