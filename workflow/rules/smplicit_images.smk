if PICTURED or PICTURED_OTHERS:
    DEFAULT_TARGETS += [f"{RESULTS}/report/smplicit_images.png"]


rule fit_picture:
    input:
        unpack(own_picture),
        models=expand(f"{SMPLICIT}/{{field}}", field=SMPLICIT_MODELS),
    output:
        folder=directory(f"{SMPLICIT}/images/{{picture}}"),
        shown=f"{SMPLICIT}/images/{{picture}}_shown.npz",
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
        fit=lookup(dpath="smplicit/fit_images", within=config),
        meshing=lookup(dpath="smplicit/meshing", within=config),
        solver=QUICK_SOLVER.code,
        hanging=HANGING,
        seed=config["seed"],
        code=source_hash("fit_picture", QUICK_SOLVER.code),
    script:
        "../../scripts/fit_picture.py"


rule plot_fitted_picture:
    input:
        f"{SMPLICIT}/images/{{picture}}_shown.npz",
    output:
        f"{SMPLICIT}/images/{{picture}}.png",
    log:
        f"{LOGS}/plot_fitted_picture/{{picture}}.log",
    benchmark:
        f"{BENCHMARKS}/plot_fitted_picture/{{picture}}.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_fitted_picture"),
    script:
        "../../scripts/plot_fitted_picture.py"


rule fit_images:
    # The garments in the pictures that the config names, and the pictures with them.
    input:
        own_pictures,


rule evaluate_images:
    input:
        models=expand(f"{SMPLICIT}/{{field}}", field=SMPLICIT_MODELS),
        samples=shards_of(SAMPLE, PICTURED + PICTURED_OTHERS),
    output:
        metrics=f"{RESULTS}/metrics/smplicit_images.tsv",
        shown=directory(f"{SMPLICIT}/evaluated_images"),
    log:
        f"{LOGS}/evaluate_images.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_images.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=minutes(
            30
            * (config["smplicit"]["evaluate_images"]["count"] + len(PICTURED_OTHERS))
        ),
    params:
        split=EVALUATED_SPLITS[0],
        samples=PICTURED,
        pictures=lookup(dpath="smplicit/evaluate_images/count", within=config),
        others=PICTURED_OTHERS,
        size_px=lookup(dpath="smplicit/evaluate_images/size_px", within=config),
        fit=lookup(dpath="smplicit/fit_images", within=config),
        meshing=lookup(dpath="smplicit/meshing", within=config),
        solver=QUICK_SOLVER.code,
        hanging=HANGING,
        seed=config["seed"],
        code=source_hash("evaluate_images", QUICK_SOLVER.code),
    script:
        "../../scripts/evaluate_images.py"


rule plot_fit_images:
    input:
        f"{SMPLICIT}/evaluated_images",
    output:
        report(
            f"{RESULTS}/report/smplicit_images.png",
            caption="../report/smplicit_images.rst",
            category="SMPLicit",
            labels={"shows": "garments found in pictures of held-out samples"},
        ),
    log:
        f"{LOGS}/plot_fit_images.log",
    benchmark:
        f"{BENCHMARKS}/plot_fit_images.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=20,
    params:
        most=8,
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_fit_images"),
    script:
        "../../scripts/plot_fit_images.py"
