# Test rows are read by the rules of this file, and by those of garment4d.smk that evaluate.
# Which models each table of metrics holds.
METRIC_TABLES = {
    "metrics": [
        *["baselines", "dynamic_baselines", "svae", "svae_ours"],
        *["dvae_unposed_4", "dvae_ours"],
        *[f"garment4d_{garment}_default" for garment in TEMPLATE_TYPES],
        "representations",
    ],
    "metrics_ablations": [
        *["baselines", "dynamic_baselines", *SVAE_VARIANTS, *DVAE_VARIANTS],
    ],
    "metrics_garment4d_ablations": [
        f"garment4d_{garment}_ablations" for garment in TEMPLATE_TYPES
    ],
}
EVALUATED_SPLITS = ["test"]
SUPER_BODIES = {g: f"{RESULTS}/registration/body/{g}.npz" for g in GENDERS}
WHOLE_BODIES = {g: body_file(g) for g in GENDERS}
MOVING_INPUTS = {
    "samples": per_sample("{results}/samples/{sample}"),
    "registrations": per_sample("{results}/registration/samples/{sample}"),
    "topology": f"{RESULTS}/registration/topology.npz",
}
# The dynamic model that figures are made with.
SHOWN_DVAE = {
    "dvae": f"{RESULTS}/gcvae/dvae_ours",
    "dynamic": f"{RESULTS}/dynamic/unposed",
    "static": static_model(),
}
GCVAE_FILES = [
    f"{RESULTS}/metrics.tsv",
    f"{RESULTS}/report/gcvae_metrics.html",
    *expand(
        f"{RESULTS}/report/gcvae_{{name}}.png",
        name=[
            *["errors", "codes_svae", "codes_svae_ours"],
            *["walks", "walk_moving", "wrinkles", "samples"],
        ],
    ),
]


wildcard_constraints:
    table="|".join(METRIC_TABLES),


rule evaluate_baselines:
    input:
        **SUPER_BODIES,
        data=f"{RESULTS}/static/data",
        topology=f"{RESULTS}/registration/topology.npz",
    output:
        f"{RESULTS}/metrics/baselines.tsv",
    log:
        f"{LOGS}/evaluate_baselines.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_baselines.tsv"
    conda:
        "../../envs/geometry.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        splits=EVALUATED_SPLITS,
        components=lookup(dpath="gcvae/evaluation/pca_components", within=config),
        seed=config["seed"],
        code=source_hash("evaluate_baselines"),
    script:
        "../../scripts/evaluate_baselines.py"


rule evaluate_svae:
    input:
        model=f"{RESULTS}/gcvae/{{svae}}",
        data=f"{RESULTS}/static/data",
    output:
        metrics=f"{RESULTS}/metrics/{{svae}}.tsv",
        codes=f"{RESULTS}/codes/{{svae}}.npz",
    log:
        f"{LOGS}/evaluate_svae/{{svae}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_svae/{{svae}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        splits=EVALUATED_SPLITS,
        code=source_hash("evaluate_svae"),
    script:
        "../../scripts/evaluate_svae.py"


rule evaluate_dynamic_baselines:
    input:
        **MOVING_INPUTS,
        **SUPER_BODIES,
    output:
        f"{RESULTS}/metrics/dynamic_baselines.tsv",
    log:
        f"{LOGS}/evaluate_dynamic_baselines.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_dynamic_baselines.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        splits=EVALUATED_SPLITS,
        step=lookup(dpath="gcvae/dvae/frame_step", within=config),
        seed=config["seed"],
        code=source_hash("evaluate_dynamic_baselines"),
    script:
        "../../scripts/evaluate_dynamic_baselines.py"


rule evaluate_dvae:
    input:
        **MOVING_INPUTS,
        **SUPER_BODIES,
        model=f"{RESULTS}/gcvae/{{dvae}}",
        data=dvae_data,
        static=static_model(),
    output:
        f"{RESULTS}/metrics/{{dvae}}.tsv",
    log:
        f"{LOGS}/evaluate_dvae/{{dvae}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_dvae/{{dvae}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        splits=EVALUATED_SPLITS,
        code=source_hash("evaluate_dvae"),
    script:
        "../../scripts/evaluate_dvae.py"


rule collect_metrics:
    input:
        metric_files,
    output:
        f"{RESULTS}/{{table}}.tsv",
    log:
        f"{LOGS}/collect_metrics/{{table}}.log",
    benchmark:
        f"{BENCHMARKS}/collect_metrics/{{table}}.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        code=source_hash("collect_metrics"),
    script:
        "../../scripts/collect_metrics.py"


rule tabulate_gcvae:
    input:
        f"{RESULTS}/{{table}}.tsv",
    output:
        page=report(
            f"{RESULTS}/report/gcvae_{{table}}.html",
            caption="../report/gcvae_tables.rst",
            category="Garment VAE",
            labels={"shows": "tables 3 and 4 ({table})"},
        ),
        table=f"{RESULTS}/report/gcvae_{{table}}_beside_paper.tsv",
    log:
        f"{LOGS}/tabulate_gcvae/{{table}}.log",
    benchmark:
        f"{BENCHMARKS}/tabulate_gcvae/{{table}}.tsv"
    conda:
        "../../envs/report.yaml"
    threads: 1
    resources:
        mem_mb=500,
        runtime=10,
    params:
        code=source_hash("tabulate_gcvae"),
    script:
        "../../scripts/tabulate_gcvae.py"


rule ablations:
    # Trains and evaluates every row of tables 3a and 4; nothing of it is part of the default.
    input:
        f"{RESULTS}/metrics_ablations.tsv",
        f"{RESULTS}/report/gcvae_metrics_ablations.html",


rule sample_garments:
    input:
        **WHOLE_BODIES,
        data=f"{RESULTS}/static/data",
        model=f"{RESULTS}/gcvae/{shown_svae()}",
        codes=f"{RESULTS}/codes/{shown_svae()}.npz",
    output:
        directory(f"{RESULTS}/sampled_garments"),
    log:
        f"{LOGS}/sample_garments.log",
    benchmark:
        f"{BENCHMARKS}/sample_garments.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        seed=config["seed"],
        conditions={
            **{
                key: config["gcvae"]["sampling"][key]
                for key in ("count", "garments", "female_share", "shape", "tightness")
            },
            "shape_range": config["body"]["shape_range"],
            "tightness_range": config["outfits"]["tightness_range"],
        },
        settle=lookup(dpath="gcvae/sampling/settle", within=config),
        code=source_hash("sample_garments"),
    script:
        "../../scripts/sample_garments.py"


rule plot_gcvae_samples:
    input:
        **WHOLE_BODIES,
        samples=f"{RESULTS}/sampled_garments",
    output:
        report(
            f"{RESULTS}/report/gcvae_samples.png",
            caption="../report/gcvae_samples.rst",
            category="Garment VAE",
            labels={"shows": "sampled garments"},
        ),
    log:
        f"{LOGS}/plot_gcvae_samples.log",
    benchmark:
        f"{BENCHMARKS}/plot_gcvae_samples.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        shown=24,
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_gcvae_samples"),
    script:
        "../../scripts/plot_gcvae_samples.py"


rule plot_gcvae_codes:
    input:
        f"{RESULTS}/codes/{{svae}}.npz",
    output:
        report(
            f"{RESULTS}/report/gcvae_codes_{{svae}}.png",
            caption="../report/gcvae_codes.rst",
            category="Garment VAE",
            labels={"shows": "figure 8: codes of static garments ({svae})"},
        ),
    log:
        f"{LOGS}/plot_gcvae_codes/{{svae}}.log",
    benchmark:
        f"{BENCHMARKS}/plot_gcvae_codes/{{svae}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        code=source_hash("plot_gcvae_codes"),
    script:
        "../../scripts/plot_gcvae_codes.py"


rule plot_gcvae_walks:
    input:
        **WHOLE_BODIES,
        model=f"{RESULTS}/gcvae/{shown_svae()}",
        codes=f"{RESULTS}/codes/{shown_svae()}.npz",
        data=f"{RESULTS}/static/data",
    output:
        sheet=report(
            f"{RESULTS}/report/gcvae_walks.png",
            caption="../report/gcvae_walks.rst",
            category="Garment VAE",
            labels={"shows": "figure 9: transitions"},
        ),
        moving=report(
            f"{RESULTS}/report/gcvae_walk_moving.png",
            caption="../report/gcvae_walks.rst",
            category="Garment VAE",
            labels={"shows": "figure 9: a transition in motion"},
        ),
    log:
        f"{LOGS}/plot_gcvae_walks.log",
    benchmark:
        f"{BENCHMARKS}/plot_gcvae_walks.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        steps=7,
        frames=15,
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_gcvae_walks"),
    script:
        "../../scripts/plot_gcvae_walks.py"


rule plot_gcvae_errors:
    input:
        **MOVING_INPUTS,
        **SHOWN_DVAE,
        **WHOLE_BODIES,
        **{f"super_{gender}": path for gender, path in SUPER_BODIES.items()},
        svae=f"{RESULTS}/gcvae/{shown_svae()}",
        codes=f"{RESULTS}/codes/{shown_svae()}.npz",
        data=static_data(*EVALUATED_SPLITS),
        outfits=expand(f"{RESULTS}/static/outfits/{{shard}}.npz", shard=STATIC),
    output:
        report(
            f"{RESULTS}/report/gcvae_errors.png",
            caption="../report/gcvae_errors.rst",
            category="Garment VAE",
            labels={"shows": "figure 7: reconstructions and their errors"},
        ),
    log:
        f"{LOGS}/plot_gcvae_errors.log",
    benchmark:
        f"{BENCHMARKS}/plot_gcvae_errors.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        frames=4,
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_gcvae_errors"),
    script:
        "../../scripts/plot_gcvae_errors.py"


rule plot_gcvae_wrinkles:
    input:
        **MOVING_INPUTS,
        **SHOWN_DVAE,
        **WHOLE_BODIES,
        **{f"super_{gender}": path for gender, path in SUPER_BODIES.items()},
    output:
        report(
            f"{RESULTS}/report/gcvae_wrinkles.png",
            caption="../report/gcvae_wrinkles.rst",
            category="Garment VAE",
            labels={"shows": "figure 10: wrinkle codes elsewhere"},
        ),
    log:
        f"{LOGS}/plot_gcvae_wrinkles.log",
    benchmark:
        f"{BENCHMARKS}/plot_gcvae_wrinkles.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        frames=4,
        columns=6,
        seed=config["seed"],
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_gcvae_wrinkles"),
    script:
        "../../scripts/plot_gcvae_wrinkles.py"
