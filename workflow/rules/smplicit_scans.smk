rule evaluate_scans_smplicit:
    input:
        **KNOWN_SCANS,
        models=expand(f"{SMPLICIT}/{{field}}", field=SMPLICIT_MODELS),
    output:
        metrics=f"{RESULTS}/metrics/scans_smplicit.tsv",
        shown=f"{RESULTS}/smplicit/fitted_scans.npz",
    log:
        f"{LOGS}/evaluate_scans_smplicit.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_scans_smplicit.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=240,
    params:
        split=EVALUATED_SPLITS[0],
        body=lookup(dpath="scans/body", within=config),
        fit=lookup(dpath="smplicit/fit_scans", within=config),
        meshing=lookup(dpath="smplicit/meshing", within=config),
        solver=QUICK_SOLVER.code,
        hanging=HANGING,
        seed=config["seed"],
        code=source_hash("evaluate_scans_smplicit", QUICK_SOLVER.code),
    script:
        "../../scripts/evaluate_scans_smplicit.py"


rule fit_own_scans:
    input:
        unpack(segmented_scans),
        models=scan_models,
    output:
        folder=directory(f"{SMPLICIT}/own_scans"),
        scans=f"{SMPLICIT}/own_scans.npz",
        shown=f"{SMPLICIT}/own_scans_shown.npz",
    log:
        f"{LOGS}/fit_own_scans.log",
    benchmark:
        f"{BENCHMARKS}/fit_own_scans.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=240,
    params:
        garments=SEGMENTED["garments"],
        up=SEGMENTED["up"],
        fps=SEGMENTED["fps"],
        body=lookup(dpath="scans/body", within=config),
        fit=lookup(dpath="smplicit/fit_scans", within=config),
        meshing=lookup(dpath="smplicit/meshing", within=config),
        solver=QUICK_SOLVER.code,
        hanging=HANGING,
        seed=config["seed"],
        code=source_hash("fit_own_scans", QUICK_SOLVER.code),
    script:
        "../../scripts/fit_own_scans.py"


rule plot_own_scans:
    input:
        scans=f"{SMPLICIT}/own_scans.npz",
        shown=f"{SMPLICIT}/own_scans_shown.npz",
    output:
        f"{SMPLICIT}/own_scans.png",
    log:
        f"{LOGS}/plot_own_scans.log",
    benchmark:
        f"{BENCHMARKS}/plot_own_scans.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=20,
    params:
        most=8,
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_own_scans"),
    script:
        "../../scripts/plot_own_scans.py"


rule fit_scans:
    # The garments and the body in the segmented scans that the config names, with a picture.
    input:
        rules.fit_own_scans.output,
        rules.plot_own_scans.output,
