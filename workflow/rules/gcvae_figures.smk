# The dynamic model that figures are made with.
SHOWN_DVAE = {
    "dvae": f"{RESULTS}/gcvae/dynamic_ppca",
    "dynamic": f"{RESULTS}/dynamic/unposed",
    "static": static_model(),
}
DEFAULT_TARGETS += [
    f"{RESULTS}/report/gcvae_metrics.html",
    *expand(
        f"{RESULTS}/report/gcvae_{{name}}.png",
        name=[
            *["errors", "codes_svae", "codes_static_ppca"],
            *["walks", "walk_moving", "wrinkles", "samples"],
        ],
    ),
]


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
    wildcard_constraints:
        table="metrics|metrics_gcvae_ablations",
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


rule gcvae_ablations:
    # Trains and evaluates every row of tables 3a and 4; nothing of it is part of the default.
    input:
        f"{RESULTS}/metrics_gcvae_ablations.tsv",
        f"{RESULTS}/report/gcvae_metrics_gcvae_ablations.html",


rule sample_garments:
    input:
        **WHOLE_BODIES,
        model=f"{RESULTS}/gcvae/{shown_static()}",
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
        f"{RESULTS}/codes/{{static}}.npz",
    output:
        report(
            f"{RESULTS}/report/gcvae_codes_{{static}}.png",
            caption="../report/gcvae_codes.rst",
            category="Garment VAE",
            labels={"shows": "figure 8: codes of static garments ({static})"},
        ),
    log:
        f"{LOGS}/plot_gcvae_codes/{{static}}.log",
    benchmark:
        f"{BENCHMARKS}/plot_gcvae_codes/{{static}}.tsv"
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
        model=f"{RESULTS}/gcvae/{shown_static()}",
        codes=f"{RESULTS}/codes/{shown_static()}.npz",
        data=f"{RESULTS}/static",
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
        frames=24,
        rays=lookup(dpath="renders/rays", within=config),
        code=source_hash("plot_gcvae_walks"),
    script:
        "../../scripts/plot_gcvae_walks.py"


rule plot_gcvae_errors:
    input:
        **SAMPLES_WITH_REGISTRATIONS,
        **SHOWN_DVAE,
        **WHOLE_BODIES,
        **{f"super_{gender}": path for gender, path in SUPER_BODIES.items()},
        topology=TOPOLOGY,
        svae=f"{RESULTS}/gcvae/{shown_static()}",
        codes=f"{RESULTS}/codes/{shown_static()}.npz",
        data=static_data(*EVALUATED_SPLITS),
        outfits=ALL_OUTFITS_AT_REST,
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
        **SAMPLES_WITH_REGISTRATIONS,
        **SHOWN_DVAE,
        **WHOLE_BODIES,
        **{f"super_{gender}": path for gender, path in SUPER_BODIES.items()},
        topology=TOPOLOGY,
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
