RECONSTRUCTED = f"{RESULTS}/reconstructed/{RECONSTRUCT['garment']}"


rule reconstruct_garment:
    input:
        unpack(own_scans),
        model=f"{GARMENT4D.folder}/{RECONSTRUCT['garment']}/ours",
    output:
        sample=directory(RECONSTRUCTED),
        metrics=f"{RESULTS}/metrics/reconstructed_{RECONSTRUCT['garment']}.tsv",
        shown=f"{RECONSTRUCTED}_shown.npz",
    log:
        f"{LOGS}/reconstruct_garment/{RECONSTRUCT['garment']}.log",
    benchmark:
        f"{BENCHMARKS}/reconstruct_garment/{RECONSTRUCT['garment']}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=240,
    params:
        garment=RECONSTRUCT["garment"],
        up=RECONSTRUCT["up"],
        fps=RECONSTRUCT["fps"],
        refine=lookup(dpath="garment4d/refine", within=config),
        colour=[0.45, 0.55, 0.75],
        seed=config["seed"],
        code=source_hash("reconstruct_garment", OUR_SOLVER),
    script:
        "../../scripts/reconstruct_garment.py"


rule plot_reconstructed:
    input:
        f"{RECONSTRUCTED}_shown.npz",
    output:
        steps=f"{RECONSTRUCTED}_steps.png",
        moving=f"{RECONSTRUCTED}_moving.png",
        page=f"{RECONSTRUCTED}.html",
    log:
        f"{LOGS}/plot_reconstructed/{RECONSTRUCT['garment']}.log",
    benchmark:
        f"{BENCHMARKS}/plot_reconstructed/{RECONSTRUCT['garment']}.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_reconstructed"),
    script:
        "../../scripts/plot_reconstructed.py"


rule export_reconstructed:
    input:
        RECONSTRUCTED,
    output:
        directory(
            f"{RESULTS}/exports/reconstructed/{RECONSTRUCT['garment']}/{{format}}"
        ),
    log:
        f"{LOGS}/export_reconstructed/{RECONSTRUCT['garment']}_{{format}}.log",
    benchmark:
        f"{BENCHMARKS}/export_reconstructed/{RECONSTRUCT['garment']}_{{format}}.tsv"
    conda:
        "../../envs/blender.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        code=source_hash("export_sample"),
    script:
        "../../scripts/export_sample.py"


rule reconstruct:
    # The garment in the scans that the config names: errors, pictures, every format.
    input:
        rules.reconstruct_garment.output,
        rules.plot_reconstructed.output,
        expand(rules.export_reconstructed.output, format=EXPORT_FORMATS),
