include: "learning_samples_common.smk"


rule import_learning_motions:
    input:
        LEARNING_MOTION_FILES,
    output:
        directory(f"{LEARNED}/motions"),
    log:
        f"{LOGS}/import_learning_motions.log",
    benchmark:
        f"{BENCHMARKS}/import_learning_motions.tsv"
    priority: SAMPLES_FIRST
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=60,
    params:
        clips=LEARNING_CLIPS,
        code=source_hash("import_learning_motions"),
    script:
        "../../scripts/import_learning_motions.py"


rule simulate_learning:
    input:
        **DRESS_FORMS,
        motions=f"{LEARNED}/motions",
        own=OWN_GARMENT_FILES,
    output:
        directory(f"{LEARNED}/samples/{{shard}}"),
    log:
        f"{LOGS}/simulate_learning/{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/simulate_learning/{{shard}}.tsv"
    priority: SAMPLES_FIRST
    conda:
        LEARNING_ENVIRONMENT
    threads: 1
    resources:
        mem_mb=3000,
        runtime=minutes(LEARNING_S),
        gpu=simulation_gpus(config["learning"]["solver"]),
    params:
        seed=config["seed"],
        plans=learning_plans,
        solver=LEARNING_SOLVER,
        accelerator=config["simulation"]["accelerator"],
        bodies=BODY_SETTINGS,
        outfits={
            **OUTFIT_SETTINGS,
            "edge_length_m": config["learning"]["edge_length_m"],
            "vertices_min": 0,
        },
        own_garments=OWN_GARMENTS,
        settings={
            **config["simulation"]["settings"],
            "attempts": config["learning"]["attempts"],
        },
        bounds=lookup(dpath="simulation/bounds", within=config),
        code=source_hash("simulate_learning", LEARNING_SOLVER),
    script:
        "../../scripts/simulate_learning.py"


rule register_learning:
    input:
        **SUPER_BODIES,
        samples=f"{LEARNED}/samples/{{shard}}",
        topology=TOPOLOGY,
    output:
        directory(f"{LEARNED}/registration/{{shard}}"),
    log:
        f"{LOGS}/register_learning/{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/register_learning/{{shard}}.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=minutes(12 * LEARNING_SHARD),
    params:
        code=source_hash("register_learning"),
    script:
        "../../scripts/register_learning.py"


rule plot_learning:
    input:
        LEARNING_SAMPLES,
    output:
        report(
            f"{RESULTS}/report/learning.png",
            caption="../report/learning.rst",
            category="Dataset",
            labels={"shows": "samples to learn from"},
        ),
    log:
        f"{LOGS}/plot_learning.log",
    benchmark:
        f"{BENCHMARKS}/plot_learning.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=20,
    params:
        most=24,
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_learning"),
    script:
        "../../scripts/plot_learning.py"
