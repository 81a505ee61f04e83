include: "gcvae_common.smk"


rule train_svae_conditioning:
    input:
        data=static_data("train", "val"),
    output:
        directory(f"{RESULTS}/gcvae/conditioning/static"),
    log:
        f"{LOGS}/train_svae_conditioning.log",
    benchmark:
        f"{BENCHMARKS}/train_svae_conditioning.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=minutes(6 * STATIC_SIZE),
    params:
        settings=conditioning_settings("svae"),
        progress=in_progress("conditioning"),
        code=source_hash("train_svae_conditioning"),
    script:
        "../../scripts/train_svae_conditioning.py"


rule train_svae:
    input:
        **SUPER_BODIES,
        data=static_data("train", "val"),
        topology=TOPOLOGY,
        hierarchy=svae_hierarchy,
        conditioning=f"{RESULTS}/gcvae/conditioning/static",
    output:
        directory(f"{RESULTS}/gcvae/{{svae}}"),
    log:
        f"{LOGS}/train_svae/{{svae}}.log",
    benchmark:
        f"{BENCHMARKS}/train_svae/{{svae}}.tsv"
    wildcard_constraints:
        svae="|".join(SVAE_VARIANTS),
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        gpu=gpus("gcvae"),
        mem_mb=memory(batch_mb("gcvae", "svae")),
        runtime=minutes(vae_seconds("svae")),
    params:
        settings=svae_settings,
        trainer=lookup(dpath="gcvae/trainer", within=config),
        progress=in_progress("svae"),
        code=source_hash("train_svae"),
    script:
        "../../scripts/train_svae.py"


rule fit_static_ppca:
    input:
        **SUPER_BODIES,
        data=static_data("train", "val"),
        topology=TOPOLOGY,
        hierarchy=f"{RESULTS}/super_body/hierarchy_segments.npz",
    output:
        directory(f"{RESULTS}/gcvae/static_ppca"),
    log:
        f"{LOGS}/fit_static_ppca.log",
    benchmark:
        f"{BENCHMARKS}/fit_static_ppca.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=memory(2000 + 300 * STATIC_SIZE),
        runtime=minutes(40 * STATIC_SIZE),
    params:
        settings=ppca_settings("svae"),
        code=source_hash("fit_static_ppca"),
    script:
        "../../scripts/fit_static_ppca.py"


rule train_dvae_conditioning:
    input:
        data=conditioning_frames,
        static=static_model(),
    output:
        directory(f"{RESULTS}/gcvae/conditioning/{{version}}_{{frames}}"),
    log:
        f"{LOGS}/train_dvae_conditioning/{{version}}_{{frames}}.log",
    benchmark:
        f"{BENCHMARKS}/train_dvae_conditioning/{{version}}_{{frames}}.tsv"
    wildcard_constraints:
        frames="[14]",
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=minutes(10 * MOVING_SIZE),
    params:
        settings=conditioning_settings("dvae"),
        progress=in_progress("conditioning"),
        code=source_hash("train_dvae_conditioning"),
    script:
        "../../scripts/train_dvae_conditioning.py"


rule train_dvae:
    input:
        **SUPER_BODIES,
        static=static_model(),
        topology=TOPOLOGY,
        hierarchy=f"{RESULTS}/super_body/hierarchy_segments.npz",
        data=dvae_frames,
        conditioning=dvae_conditioning,
    output:
        directory(f"{RESULTS}/gcvae/{{dvae}}"),
    log:
        f"{LOGS}/train_dvae/{{dvae}}.log",
    benchmark:
        f"{BENCHMARKS}/train_dvae/{{dvae}}.tsv"
    wildcard_constraints:
        dvae="|".join(DVAE_VARIANTS),
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        gpu=gpus("gcvae"),
        mem_mb=memory(batch_mb("gcvae", "dvae")),
        runtime=minutes(vae_seconds("dvae")),
    params:
        settings=dvae_settings,
        frames=dvae_poses,
        trainer=lookup(dpath="gcvae/trainer", within=config),
        progress=in_progress("dvae"),
        code=source_hash("train_dvae"),
    script:
        "../../scripts/train_dvae.py"


rule fit_dynamic_ppca:
    input:
        **SUPER_BODIES,
        static=static_model(),
        topology=TOPOLOGY,
        hierarchy=f"{RESULTS}/super_body/hierarchy_segments.npz",
        data=dynamic_ppca_frames,
    output:
        directory(f"{RESULTS}/gcvae/dynamic_ppca"),
    log:
        f"{LOGS}/fit_dynamic_ppca.log",
    benchmark:
        f"{BENCHMARKS}/fit_dynamic_ppca.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=memory(3000 + 100 * MOVING_SIZE),
        runtime=minutes(90 * MOVING_SIZE),
    params:
        settings=ppca_settings("dvae"),
        frames=dynamic_conditions(DYNAMIC_PPCA)[1],
        code=source_hash("fit_dynamic_ppca"),
    script:
        "../../scripts/fit_dynamic_ppca.py"


rule evaluate_baselines:
    input:
        **SUPER_BODIES,
        data=f"{RESULTS}/static",
        topology=TOPOLOGY,
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
        mem_mb=memory(500 + 100 * STATIC_SIZE),
        runtime=minutes(35 * STATIC_SIZE),
    params:
        splits=EVALUATED_SPLITS,
        components=lookup(dpath="gcvae/evaluation/pca_components", within=config),
        seed=config["seed"],
        code=source_hash("evaluate_baselines"),
    script:
        "../../scripts/evaluate_baselines.py"


rule evaluate_static:
    input:
        model=f"{RESULTS}/gcvae/{{static}}",
        data=f"{RESULTS}/static",
    output:
        metrics=f"{RESULTS}/metrics/{{static}}.tsv",
        codes=f"{RESULTS}/codes/{{static}}.npz",
    log:
        f"{LOGS}/evaluate_static/{{static}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_static/{{static}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=memory(700 + 100 * STATIC_SIZE),
        runtime=minutes(22 * STATIC_SIZE),
    params:
        splits=EVALUATED_SPLITS,
        code=source_hash("evaluate_static"),
    script:
        "../../scripts/evaluate_static.py"


rule evaluate_dynamic_baselines:
    input:
        **SAMPLES_WITH_REGISTRATIONS,
        **SUPER_BODIES,
        topology=TOPOLOGY,
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
        mem_mb=memory(700 + 50 * MOVING_SIZE),
        runtime=minutes(32 * MOVING_SIZE),
    params:
        splits=EVALUATED_SPLITS,
        step=lookup(dpath="gcvae/dvae/frame_step", within=config),
        seed=config["seed"],
        code=source_hash("evaluate_dynamic_baselines"),
    script:
        "../../scripts/evaluate_dynamic_baselines.py"


rule evaluate_dynamic:
    input:
        **SAMPLES_WITH_REGISTRATIONS,
        **SUPER_BODIES,
        topology=TOPOLOGY,
        model=f"{RESULTS}/gcvae/{{dynamic}}",
        data=dvae_data,
        static=static_model(),
    output:
        f"{RESULTS}/metrics/{{dynamic}}.tsv",
    log:
        f"{LOGS}/evaluate_dynamic/{{dynamic}}.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_dynamic/{{dynamic}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=memory(800 + 50 * MOVING_SIZE),
        runtime=minutes(50 * MOVING_SIZE),
    params:
        splits=EVALUATED_SPLITS,
        frames=dynamic_poses,
        code=source_hash("evaluate_dynamic"),
    script:
        "../../scripts/evaluate_dynamic.py"


rule compare_gcvae:
    input:
        models=[f"{RESULTS}/gcvae/svae", f"{RESULTS}/gcvae/static_ppca"],
        data=static_data(*EVALUATED_SPLITS),
        outfits=ALL_OUTFITS_AT_REST,
    output:
        f"{RESULTS}/metrics/representations_gcvae.tsv",
    log:
        f"{LOGS}/compare_gcvae.log",
    benchmark:
        f"{BENCHMARKS}/compare_gcvae.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        components=lookup(dpath="gcvae/evaluation/pca_components", within=config),
        garments=COMPARED_GARMENTS,
        split=EVALUATED_SPLITS[0],
        seed=config["seed"],
        code=source_hash("compare_gcvae"),
    script:
        "../../scripts/compare_gcvae.py"


rule evaluate_scans_gcvae:
    input:
        **WHOLE_BODIES,
        **KNOWN_SCANS,
        models=[f"{RESULTS}/gcvae/svae", f"{RESULTS}/gcvae/static_ppca"],
    output:
        metrics=f"{RESULTS}/metrics/scans_gcvae.tsv",
        shown=f"{RESULTS}/gcvae/fitted_scans.npz",
    log:
        f"{LOGS}/evaluate_scans_gcvae.log",
    benchmark:
        f"{BENCHMARKS}/evaluate_scans_gcvae.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=240,
    params:
        split=EVALUATED_SPLITS[0],
        seed=config["seed"],
        code=source_hash("evaluate_scans_gcvae"),
    script:
        "../../scripts/evaluate_scans_gcvae.py"


include: "gcvae_figures.smk"
