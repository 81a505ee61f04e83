rule simulate_outfit:
    input:
        body=sample_body,
        animation=f"{RESULTS}/bodies/{{sample}}.npz",
        outfit=f"{RESULTS}/outfits/{{sample}}.npz",
        parameters=f"{RESULTS}/outfits/{{sample}}.json",
    output:
        directory(f"{RESULTS}/simulation/{{sample}}"),
    log:
        f"{LOGS}/simulate_outfit/{{sample}}.log",
    benchmark:
        f"{BENCHMARKS}/simulate_outfit/{{sample}}.tsv"
    priority: SAMPLES_FIRST
    conda:
        "../../envs/blender.yaml"
    threads: 1
    resources:
        mem_mb=3000,
        runtime=240,
    params:
        settings=lookup(dpath="simulation/settings", within=config),
        bounds=lookup(dpath="simulation/bounds", within=config),
        code=source_hash("simulate_outfit"),
    script:
        "../../scripts/simulate_outfit.py"
