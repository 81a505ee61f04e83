include: "pictures_common.smk"


rule plot_fitted_picture:
    input:
        f"{RESULTS}/{{model}}/images/{{picture}}_shown.npz",
    output:
        f"{RESULTS}/{{model}}/images/{{picture}}.png",
    log:
        f"{LOGS}/plot_fitted_picture/{{model}}/{{picture}}.log",
    benchmark:
        f"{BENCHMARKS}/plot_fitted_picture/{{model}}/{{picture}}.tsv"
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
