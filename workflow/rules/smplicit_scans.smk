rule fit_own_scans:
    input:
        unpack(segmented_scans),
        models=scan_models,
    output:
        folder=directory(f"{SMPLICIT.folder}/own_scans"),
        scans=f"{SMPLICIT.folder}/own_scans.npz",
        shown=f"{SMPLICIT.folder}/own_scans_shown.npz",
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
        **SMPLICIT.draping("fit_scans"),
        garments=SEGMENTED["garments"],
        up=SEGMENTED["up"],
        fps=SEGMENTED["fps"],
        body=lookup(dpath="scans/body", within=config),
        code=source_hash("fit_own_scans", QUICK_SOLVER.code),
    script:
        "../../scripts/fit_own_scans.py"


rule plot_own_scans:
    input:
        scans=f"{SMPLICIT.folder}/own_scans.npz",
        shown=f"{SMPLICIT.folder}/own_scans_shown.npz",
    output:
        f"{SMPLICIT.folder}/own_scans.png",
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
