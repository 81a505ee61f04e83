rule fit_picture:
    input:
        unpack(own_picture),
        models=SMPLICIT.models,
    output:
        folder=directory(f"{SMPLICIT.folder}/images/{{picture}}"),
        shown=f"{SMPLICIT.folder}/images/{{picture}}_shown.npz",
    log:
        f"{LOGS}/fit_picture/{{picture}}.log",
    benchmark:
        f"{BENCHMARKS}/fit_picture/{{picture}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        **SMPLICIT.draping("fit_images"),
        code=source_hash("fit_picture", QUICK_SOLVER.code),
    script:
        "../../scripts/fit_picture.py"


rule fit_images:
    # The garments in the pictures that the config names, and the pictures with them.
    input:
        pictures_by("smplicit"),
