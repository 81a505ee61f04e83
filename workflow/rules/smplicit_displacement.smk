rule collect_displacements:
    input:
        **WHOLE_BODIES,
        samples=per_sample(f"{RESULTS}/samples/{{sample}}"),
        learning=LEARNING_SAMPLES,
    output:
        directory(f"{SMPLICIT}/displacement_data/{{field}}"),
    log:
        f"{LOGS}/collect_displacements/{{field}}.log",
    benchmark:
        f"{BENCHMARKS}/collect_displacements/{{field}}.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=240,
    params:
        garments=field_garments,
        frame_step=lookup(dpath="smplicit/displacement/frame_step", within=config),
        code=source_hash("collect_displacements"),
    script:
        "../../scripts/collect_displacements.py"


rule train_displacement:
    input:
        **WHOLE_BODIES,
        data=f"{SMPLICIT}/displacement_data/{{field}}",
        fields=f"{SMPLICIT}/data/{{field}}",
    output:
        directory(f"{SMPLICIT}/displacement/{{field}}"),
    log:
        f"{LOGS}/train_displacement/{{field}}.log",
    benchmark:
        f"{BENCHMARKS}/train_displacement/{{field}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        gpu=gpus("smplicit"),
        mem_mb=2000,
        runtime=240,
    params:
        settings=displacement_settings,
        trainer=lookup(dpath="smplicit/trainer", within=config),
        progress=in_progress("smplicit_displacement"),
        code=source_hash("train_displacement"),
    script:
        "../../scripts/train_displacement.py"


rule evaluate_displacement:
    input:
        **WHOLE_BODIES,
        model=f"{SMPLICIT}/displacement/{{field}}",
        data=f"{SMPLICIT}/displacement_data/{{field}}",
        fields=f"{SMPLICIT}/data/{{field}}",
        samples=per_sample(f"{RESULTS}/samples/{{sample}}"),
        learning=LEARNING_SAMPLES,
    output:
        f"{RESULTS}/metrics/smplicit_displacement_{{field}}.tsv",
    log:
        f"{LOGS}/evaluate_displacement/{{field}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_displacement/{{field}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=240,
    params:
        split=EVALUATED_SPLITS[0],
        garments=field_garments,
        frame_step=lookup(
            dpath="smplicit/displacement/evaluated_frame_step", within=config
        ),
        seed=config["seed"],
        code=source_hash("evaluate_displacement"),
    script:
        "../../scripts/evaluate_displacement.py"


rule tabulate_displacement:
    input:
        displacement_metrics,
    output:
        report(
            f"{RESULTS}/report/smplicit_displacement.html",
            caption="../report/smplicit_displacement.rst",
            category="SMPLicit",
            labels={"shows": "garments in motion"},
        ),
    log:
        f"{LOGS}/tabulate_displacement.log",
    benchmark:
        f"{BENCHMARKS}/tabulate_displacement.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        code=source_hash("tabulate_displacement"),
    script:
        "../../scripts/tabulate_displacement.py"


rule smplicit_displacement:
    # What poses do to cloth beside the skinning: networks and their evaluation.
    input:
        rules.tabulate_displacement.output,
