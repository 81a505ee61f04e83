DEFAULT_TARGETS += [
    f"{RESULTS}/report/smplicit_metrics.html",
    f"{RESULTS}/report/smplicit_garments.png",
]


rule tabulate_smplicit:
    input:
        f"{RESULTS}/metrics.tsv",
    output:
        report(
            f"{RESULTS}/report/smplicit_metrics.html",
            caption="../report/smplicit_metrics.rst",
            category="SMPLicit",
            labels={"shows": "held-out garments through their codes"},
        ),
    log:
        f"{LOGS}/tabulate_smplicit.log",
    benchmark:
        f"{BENCHMARKS}/tabulate_smplicit.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        code=source_hash("tabulate_smplicit"),
    script:
        "../../scripts/tabulate_smplicit.py"


rule plot_smplicit:
    input:
        models=expand(f"{SMPLICIT}/{{field}}", field=SMPLICIT_MODELS),
        data=expand(f"{SMPLICIT}/data/{{field}}", field=SMPLICIT_MODELS),
        held_out=expand(f"{SMPLICIT}/held_out/{{field}}.npz", field=SMPLICIT_MODELS),
        outfits=ALL_OUTFITS_AT_REST,
    output:
        report(
            f"{RESULTS}/report/smplicit_garments.png",
            caption="../report/smplicit_garments.rst",
            category="SMPLicit",
            labels={"shows": "held-out garments rebuilt from their codes"},
        ),
    log:
        f"{LOGS}/plot_smplicit.log",
    benchmark:
        f"{BENCHMARKS}/plot_smplicit.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        meshing=lookup(dpath="smplicit/meshing", within=config),
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_smplicit"),
    script:
        "../../scripts/plot_smplicit.py"
