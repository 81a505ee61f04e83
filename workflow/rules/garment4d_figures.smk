DEFAULT_TARGETS += expand(
    f"{RESULTS}/report/garment4d_{{name}}",
    name=[
        *["metrics.html", "steps.png", "results.png", "moving.png"],
        *["explained.svg", "modes.png", "skinning.png"],
    ],
)


rule tabulate_garment4d:
    input:
        metrics=f"{RESULTS}/{{table}}.tsv",
        fits=TEMPLATE_FITS,
    output:
        page=report(
            f"{RESULTS}/report/garment4d_{{table}}.html",
            caption="../report/garment4d_tables.rst",
            category="Garment4D",
            labels={"shows": "tables 2 to 4 ({table})"},
        ),
        table=f"{RESULTS}/report/garment4d_{{table}}_beside_paper.tsv",
    log:
        f"{LOGS}/tabulate_garment4d/{{table}}.log",
    benchmark:
        f"{BENCHMARKS}/tabulate_garment4d/{{table}}.tsv"
    wildcard_constraints:
        table="metrics|metrics_garment4d_ablations",
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        departures=departures(),
        code=source_hash("tabulate_garment4d"),
    script:
        "../../scripts/tabulate_garment4d.py"


rule plot_garment4d_steps:
    input:
        reconstructions=expand(
            f"{G4D}/{{garment}}/reconstructions_default", garment=G4D_GARMENTS
        ),
    output:
        steps=report(
            f"{RESULTS}/report/garment4d_steps.png",
            caption="../report/garment4d_steps.rst",
            category="Garment4D",
            labels={"shows": "figure 4: from points to the garment"},
        ),
        results=report(
            f"{RESULTS}/report/garment4d_results.png",
            caption="../report/garment4d_steps.rst",
            category="Garment4D",
            labels={"shows": "figure 5: reconstructions"},
        ),
    log:
        f"{LOGS}/plot_garment4d_steps.log",
    benchmark:
        f"{BENCHMARKS}/plot_garment4d_steps.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_garment4d_steps"),
    script:
        "../../scripts/plot_garment4d_steps.py"


rule animate_garment4d:
    input:
        rules.plot_garment4d_steps.input,
    output:
        report(
            f"{RESULTS}/report/garment4d_moving.png",
            caption="../report/garment4d_steps.rst",
            category="Garment4D",
            labels={"shows": "a reconstruction in motion"},
        ),
    log:
        f"{LOGS}/animate_garment4d.log",
    benchmark:
        f"{BENCHMARKS}/animate_garment4d.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("animate_garment4d"),
    script:
        "../../scripts/animate_garment4d.py"


rule plot_garment_spaces:
    input:
        **SEQUENCES,
    output:
        explained=report(
            f"{RESULTS}/report/garment4d_explained.svg",
            caption="../report/garment4d_spaces.rst",
            category="Garment4D",
            labels={"shows": "variance of the principal components"},
        ),
        modes=report(
            f"{RESULTS}/report/garment4d_modes.png",
            caption="../report/garment4d_spaces.rst",
            category="Garment4D",
            labels={"shows": "the first principal components"},
        ),
    log:
        f"{LOGS}/plot_garment_spaces.log",
    benchmark:
        f"{BENCHMARKS}/plot_garment_spaces.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_garment_spaces"),
    script:
        "../../scripts/plot_garment_spaces.py"


rule plot_skinning:
    input:
        **WHOLE_BODIES,
        data=SEQUENCES[SHOWN_GARMENT],
    output:
        report(
            f"{RESULTS}/report/garment4d_skinning.png",
            caption="../report/garment4d_skinning.rst",
            category="Garment4D",
            labels={"shows": "figure 7: K = 1 against interpolated skinning"},
        ),
    log:
        f"{LOGS}/plot_skinning.log",
    benchmark:
        f"{BENCHMARKS}/plot_skinning.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        skinning=lookup(dpath="garment4d/skinning", within=config),
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_skinning"),
    script:
        "../../scripts/plot_skinning.py"


rule plot_garment4d_curves:
    input:
        f"{RESULTS}/metrics_garment4d_ablations.tsv",
    output:
        **{
            name: report(
                f"{RESULTS}/report/garment4d_{name}.svg",
                caption="../report/garment4d_curves.rst",
                category="Garment4D",
                labels={"shows": shown},
            )
            for name, shown in {
                "ablation": "figure 6: without single parts",
                "neighbours": "figure 8: neighbours K",
                "missing": "figure 9: missing points",
                "accuracy": "figure 10: segmentation errors",
            }.items()
        },
    log:
        f"{LOGS}/plot_garment4d_curves.log",
    benchmark:
        f"{BENCHMARKS}/plot_garment4d_curves.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        garment=SHOWN_GARMENT,
        code=source_hash("plot_garment4d_curves"),
    script:
        "../../scripts/plot_garment4d_curves.py"


rule garment4d_ablations:
    # Trains and evaluates figures 6 and 8 to 10; nothing of it is part of the default.
    input:
        f"{RESULTS}/metrics_garment4d_ablations.tsv",
        f"{RESULTS}/report/garment4d_metrics_garment4d_ablations.html",
        rules.plot_garment4d_curves.output,
