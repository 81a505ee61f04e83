from drapeline.models.gcvae.variants import DVAE_VARIANTS, SVAE_VARIANTS


wildcard_constraints:
    svae="|".join(SVAE_VARIANTS),
    version="posed|unposed",
    dvae="|".join(DVAE_VARIANTS),
    conditions="static|(posed|unposed)_[14]",


rule train_conditioning:
    input:
        unpack(conditions_input),
    output:
        directory(f"{RESULTS}/gcvae/conditioning/{{conditions}}"),
    log:
        f"{LOGS}/train_conditioning/{{conditions}}.log",
    benchmark:
        f"{BENCHMARKS}/train_conditioning/{{conditions}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        frames=condition_frames,
        settings=conditioning_settings,
        progress=in_progress("conditioning"),
        code=source_hash("train_conditioning"),
    script:
        "../../scripts/train_conditioning.py"


rule train_svae:
    input:
        unpack(svae_inputs),
        data=f"{RESULTS}/static/data",
        female=f"{RESULTS}/registration/body/female.npz",
        male=f"{RESULTS}/registration/body/male.npz",
        topology=f"{RESULTS}/registration/topology.npz",
        hierarchy=svae_hierarchy,
    output:
        directory(f"{RESULTS}/gcvae/{{svae}}"),
    log:
        f"{LOGS}/train_svae/{{svae}}.log",
    benchmark:
        f"{BENCHMARKS}/train_svae/{{svae}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=12000,
        runtime=1440,
    params:
        settings=trained_settings("svae"),
        trainer=lookup(dpath="gcvae/trainer", within=config),
        progress=in_progress("svae"),
        code=source_hash("train_svae"),
    script:
        "../../scripts/train_svae.py"


rule collect_dynamic:
    input:
        samples=per_sample("{results}/samples/{sample}"),
        registrations=per_sample("{results}/registration/samples/{sample}"),
        female=f"{RESULTS}/registration/body/female.npz",
        male=f"{RESULTS}/registration/body/male.npz",
    output:
        directory(f"{RESULTS}/dynamic/{{version}}"),
    log:
        f"{LOGS}/collect_dynamic/{{version}}.log",
    benchmark:
        f"{BENCHMARKS}/collect_dynamic/{{version}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=240,
    params:
        frame_step=lookup(dpath="gcvae/dvae/frame_step", within=config),
        code=source_hash("collect_dynamic"),
    script:
        "../../scripts/collect_dynamic.py"


rule train_dvae:
    input:
        unpack(dvae_inputs),
        data=dvae_data,
        svae=static_model(),
        female=f"{RESULTS}/registration/body/female.npz",
        male=f"{RESULTS}/registration/body/male.npz",
        topology=f"{RESULTS}/registration/topology.npz",
        hierarchy=f"{RESULTS}/registration/hierarchy_segments.npz",
    output:
        directory(f"{RESULTS}/gcvae/{{dvae}}"),
    log:
        f"{LOGS}/train_dvae/{{dvae}}.log",
    benchmark:
        f"{BENCHMARKS}/train_dvae/{{dvae}}.tsv"
    conda:
        "../../envs/train.yaml"
    threads: NETWORK_THREADS
    resources:
        mem_mb=12000,
        runtime=1440,
    params:
        settings=trained_settings("dvae"),
        trainer=lookup(dpath="gcvae/trainer", within=config),
        progress=in_progress("dvae"),
        code=source_hash("train_dvae"),
    script:
        "../../scripts/train_dvae.py"
