rule simulate_outfits:
    # Nothing is judged here, so that other bounds simulate nothing again that is within them.
    input:
        **WHOLE_BODIES,
        bodies=f"{RESULTS}/bodies/{{group}}/{{shard}}",
        outfits=OUTFITS,
    output:
        directory(f"{RESULTS}/simulation/{{group}}/{{shard}}"),
    log:
        f"{LOGS}/simulate_outfits/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/simulate_outfits/{{group}}_{{shard}}.tsv"
    priority: sample_priority
    conda:
        solver_environment
    threads: 1
    resources:
        mem_mb=simulation_mb,
        runtime=simulation_minutes,
        gpu=simulation_gpus,
    params:
        samples=shard_ids,
        solver=solver_module,
        accelerator=config["simulation"]["accelerator"],
        settings=attempt_settings,
        code=solver_hash("simulate_outfits"),
    script:
        "../../scripts/simulate_outfits.py"


rule write_samples:
    # Judges what was simulated, and simulates again what is out of bounds.
    input:
        **WHOLE_BODIES,
        bodies=f"{RESULTS}/bodies/{{group}}/{{shard}}",
        outfits=OUTFITS,
        simulations=f"{RESULTS}/simulation/{{group}}/{{shard}}",
    output:
        directory(SAMPLE),
    log:
        f"{LOGS}/write_samples/{{group}}_{{shard}}.log",
    benchmark:
        f"{BENCHMARKS}/write_samples/{{group}}_{{shard}}.tsv"
    priority: sample_priority
    conda:
        solver_environment
    threads: 1
    resources:
        mem_mb=simulation_mb,
        runtime=retrial_minutes,
        gpu=simulation_gpus,
    params:
        seed=config["seed"],
        splits=shard_splits,
        solver=solver_module,
        accelerator=config["simulation"]["accelerator"],
        settings=group_settings("simulation"),
        bounds=lookup(dpath="simulation/bounds", within=config),
        code=solver_hash("write_samples"),
    script:
        "../../scripts/write_samples.py"
