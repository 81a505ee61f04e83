# Each solver's module, which has `cloth_solver(threads)`, and the environment that it runs in.
CLOTH_SOLVERS = {
    "blender": ("drapeline.blender.solver", "../../envs/blender.yaml"),
    "xpbd": ("drapeline.xpbd.solver", "../../envs/geometry.yaml"),
}
SOLVER_MODULE, SOLVER_ENVIRONMENT = CLOTH_SOLVERS[config["simulation"]["solver"]]
LEARNING_SOLVER, LEARNING_ENVIRONMENT = CLOTH_SOLVERS[config["learning"]["solver"]]


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
        SOLVER_ENVIRONMENT
    threads: 1
    resources:
        mem_mb=memory(550 * CLOTH_MEMORY),
        runtime=minutes(SIMULATION_S),
        gpu=simulation_gpus(config["simulation"]["solver"]),
    params:
        solver=SOLVER_MODULE,
        accelerator=config["simulation"]["accelerator"],
        settings=lookup(dpath="simulation/settings", within=config),
        bounds=lookup(dpath="simulation/bounds", within=config),
        code=source_hash("simulate_outfit", SOLVER_MODULE),
    script:
        "../../scripts/simulate_outfit.py"
